"""The index of a site: the leaderboard, plots, classes, runs, and what is left out."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest
from builders import damage_images, make_failed, read_all, write_all, write_run

from bench.report.site.board import row_kinds
from bench.report.site.words import letter_range, p_words
from bench.report.site.write import write_site
from data_prep.failures import BadInput

CHAIRS = [f"chair/{i:02d}" for i in range(12)]
METHODS = ["splat", "pc2pix", "pc2pix@all", "surface-apss", "true-mesh", "blank"]
COMMAND = ["bin/bench", "run", "--suite", "chair-robustness", "--seed", "7"]


def write_small(directory: Path, **changes) -> Path:
    """A run with a report, which a site copies instead of making one."""
    small = {"objects": CHAIRS, "methods": METHODS, "conditions": ["2048", "noise-0.10"]}
    write_run(directory, **(small | changes))
    (directory / "report.html").write_text("<p>report</p>")
    return directory


def words_of(html: str) -> str:
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def index_of(*runs: Path) -> str:
    out = runs[0].parent / f"site-{'-'.join(run.name for run in runs)}"
    write_site(runs, out)
    return (out / "index.html").read_text("utf-8").partition("<script>")[0]


@pytest.fixture(scope="module")
def index(tmp_path_factory):
    """The index of a run of chairs, of which pc2pix is best, and one of two classes."""
    root = tmp_path_factory.mktemp("index")
    versions = {"python": "3.11.7", "scipy": "1.17.1"}
    chairs = write_small(root / "chairs", command=COMMAND, seed=7, versions=versions)
    score = {"pc2pix": 0.9, "pc2pix@all": 0.8, "splat": 0.3, "surface-apss": 0.2, "blank": 0.25}
    records = [
        r
        if r.method == "true-mesh"
        else replace(r, ssim_object=score[r.method] + r.view / 100, lpips=1 - score[r.method])
        for r in read_all(chairs)
    ]
    write_all(chairs, records)
    objects = [*CHAIRS[:9], *(f"table/{i:02d}" for i in range(9))]
    classes = write_small(
        root / "classes", objects=objects, methods=["splat", "pc2pix", "blank"], conditions=["2048"]
    )
    return index_of(chairs, classes)


def section(html: str, title: str) -> str:
    return html.partition(f">{title}</h2>")[2].partition("<h2")[0]


def heads(html: str) -> list[str]:
    head = section(html, "All methods").partition("<thead>")[2].partition("</thead>")[0]
    return [words_of(th) for th in re.findall(r"<th .*?</th>", head, re.DOTALL)]


def rows(html: str) -> dict[str, list[str]]:
    """The cells of the leaderboard by the names of methods."""
    body = section(html, "All methods").partition("<tbody>")[2].partition("</tbody>")[0]
    cells = [re.findall(r"<t[dh].*?</t[dh]>", tr, re.DOTALL) for tr in body.split("<tr")[1:]]
    return {words_of(of_row[1]): [words_of(c) for c in of_row] for of_row in cells}


def test_columns_are_the_headline_of_each_run_and_what_no_run_has_alone(index):
    assert heads(index) == [
        *("rank", "method", "chairs", "classes", "mean rank of 4"),
        *("ms a view an unknown processor", "trained on", "runs of 2"),
        *("ssim-object", "lpips") * 2,
    ]
    titles = re.findall(
        r'<th scope="colgroup"[^>]*><a href="run-chairs.html" title="([^"]*)"', index
    )
    assert titles == [
        "12 objects of class chair × 2 views; mean over 2 conditions: 2,048 points, noise 10 % of "
        "the radius"
    ]


def test_rows_are_sorted_and_say_what_stands_behind_them(index):
    by_method = rows(index)
    assert [name.partition(" ")[0] for name in by_method][:2] == ["pc2pix", "pc2pix@all"]
    best, variant = by_method["pc2pix"], by_method["pc2pix@all"]
    assert best[0] == "1 a"
    assert best[2:4] == [".905 a", ".100 a"]  # means of two views
    assert best[-3:] == ["375", "chairs", "2"]  # prepare 250 ms, draw 125 ms
    assert variant[2:4] == [".805 b", ".200 b"]
    assert variant[4:6] == ["–", "–"]  # the other run has it not
    # Of its digits, those that survive rounding (results/rounding.csv).
    assert re.fullmatch(r"(≈\.21?|\.205) d worse than blank", by_method["surface-apss"][2])
    reference = by_method["true-mesh reference: the true mesh"]
    assert (reference[0], reference[-3]) == ("–", "–")  # no place, no cost
    assert re.search(r'title="against pc2pix: differs, p [^"]+">b</span>', index)


def test_variants_and_reference_methods_wait_for_a_switch(index):
    table = section(index, "All methods")
    assert re.findall(r'<tr class="(\w+)">', table) == ["variant", "reference", "reference"]
    switches = re.findall(r"<label>.*?</label>", table)
    assert [words_of(label) for label in switches] == [
        "1 more variant of the same methods",
        "2 reference methods",
    ]
    assert ":has(.show-variants:checked) tr.variant" in index


def test_the_answer_names_the_first_and_what_is_worse_than_blank(index):
    answer = words_of(section(index, "In short"))
    assert "First by mean rank pc2pix " in answer
    assert re.search(r"Worse than a white image in some run [^:]*surface-apss", answer)


def test_each_run_has_its_plots_and_those_have_words(index):
    plots = re.findall(r"<desc id=[^>]+>([^<]+)</desc>", index)
    titles = re.findall(r"<figcaption><strong[^>]+>([^<]+)</strong>", index)
    assert titles == [
        *("ssim-object against cost", "ssim-object along the conditions"),
        *("lpips along the conditions", "ssim-object against cost"),  # one condition: no curves
    ]
    assert "pc2pix: 375 ms, 0.905, on the frontier" in plots[0]
    assert "pc2pix: 2,048 points 0.905, noise 10 % of the radius 0.905." in plots[1]
    assert "pc2pix@all" not in " ".join(plots)


def test_classes_are_shown_where_a_run_has_several(index):
    classes = section(index, "Classes")
    assert words_of(classes).startswith("classes 2 classes, mean over conditions")
    assert re.findall(r'data-sort="number">(\w+)</th>', classes) == ["chair", "table"] * 2


def test_runs_have_seed_command_and_versions(index):
    runs = words_of(section(index, "Runs"))
    assert "seed 7 failed 0 of 288 images" in runs
    assert "bench run --suite chair-robustness --seed 7" in runs
    assert "python 3.11.7, scipy 1.17.1" in runs
    assert "conditions 2,048 points, noise 10 % of the radius" in runs
    assert "The run does not say its versions." in runs  # the other


def test_thumbnails_show_one_object_by_all_methods(index):
    table = section(index, "All methods")
    alts = re.findall(r'<img src="data:image/webp;base64,[^"]+" alt="([^"]+)"', table)
    assert alts[0] == "chair 00 by pc2pix, 2,048 points"
    assert len(alts) == len(METHODS)


def test_a_run_without_images_has_no_thumbnails(tmp_path):
    run = write_small(tmp_path / "run", objects=CHAIRS[:2])
    damage_images(run, data=None)
    table = section(index_of(run), "All methods")
    assert "<img" not in table


def test_a_run_whose_store_cannot_be_read_has_no_thumbnails(tmp_path, capsys):
    run = write_small(tmp_path / "run", objects=CHAIRS[:2])
    (run / "run.sqlite").write_bytes(b"no database" * 100)
    table = section(index_of(run), "All methods")
    assert "<img" not in table
    assert f"no thumbnails, {run / 'run.sqlite'}: not a store of a run" in capsys.readouterr().err


def test_a_run_without_a_metric_is_named_and_has_the_others(tmp_path):
    run = write_small(tmp_path / "run")
    write_all(run, [replace(record, lpips=None) for record in read_all(run)])
    html = index_of(run)
    assert "run has no lpips: " in words_of(html)
    assert "lpips" not in heads(html)
    assert "ssim-object" in heads(html)


def test_each_truth_has_a_leaderboard_and_an_answer_of_its_own(tmp_path):
    small = {"methods": ["splat", "alpha-shape", "blank"], "conditions": ["2048"]}
    runs = [
        write_small(tmp_path / name, **small, **entry)
        for name, entry in (("colours", {}), ("shapes", {"truth": "grey"}))
    ]
    ahead = ("splat", "alpha-shape")
    for run, best in zip(runs, ahead, strict=True):
        records = read_all(run)
        write_all(
            run,
            [replace(r, ssim_object=0.5 + 0.4 * (r.method == best), lpips=0.3) for r in records],
        )
    html = index_of(*runs)
    captions = re.findall(r"<caption id=[^>]+>(.*?)</caption>", section(html, "All methods"))
    truths = ("the true mesh in its colours", "the true mesh in grey")
    assert [words_of(caption) for caption in captions] == [
        f"All methods by their mean rank among the 2 that compete, against {truth}"
        for truth in truths
    ]
    answer = words_of(section(html, "In short"))
    for truth, best in zip(truths, ahead, strict=True):
        assert f"First by mean rank, against {truth} {best} " in answer
    first = words_of(section(html, "All methods").partition("</table>")[0])
    assert "colours ssim-object" not in first.partition("shapes")[2]  # one run in each table
    assert "shapes" not in first
    cards = section(html, "Runs")
    assert [f"truth {truth} objects" in words_of(cards) for truth in truths] == [True, True]


def test_a_run_of_one_method_ranks_nothing(tmp_path):
    html = index_of(write_small(tmp_path / "run", methods=["splat", "blank"]))
    assert "run ranks nothing; methods that compete: splat." in words_of(html)
    assert {name: cells[0] for name, cells in rows(html).items()}["splat"] == "–"


def test_a_run_without_scored_objects_is_left_out(tmp_path, capsys):
    good = write_small(tmp_path / "good", objects=CHAIRS[:2])
    empty = write_small(tmp_path / "empty", objects=[])
    failed = write_small(tmp_path / "failed", objects=CHAIRS[:2])
    write_all(
        failed, [make_failed(r.method, r.condition, r.object, r.view) for r in read_all(good)]
    )
    html = index_of(good, empty, failed)
    err = capsys.readouterr().err
    for run in (empty, failed):
        assert f"{run.name} is left out: no object has scored images." in words_of(html)
        assert f"{run}: no object has scored images; the run is left out" in err
        assert f"run-{run.name}.html" not in html
    with pytest.raises(BadInput, match="no run has an object with scored images"):
        write_site([empty], tmp_path / "site")
    assert not (tmp_path / "site").exists()


def test_the_best_of_a_family_stands_for_it_where_its_plain_method_is_missing():
    ranked = [
        "splat-net@chair-tiny",
        "splat-net@grey",
        "pc2pix@all",
        "pc2pix",
        "splat-net@chair-bf16",
        "blank",
    ]
    kinds = row_kinds(ranked, {name: name for name in ranked}, {"splat-net@grey"})
    assert kinds == {
        "splat-net@chair-tiny": "",
        "splat-net@grey": "",
        "pc2pix@all": "variant",
        "pc2pix": "",
        "splat-net@chair-bf16": "variant",
        "blank": "reference",
    }


def test_letters_and_p_values_are_short():
    assert [letter_range(text) for text in ("a", "ab", "abc", "acdef", "abz1")] == [
        *("a", "ab", "a–c", "ac–f", "abz1")
    ]
    assert [p_words(value) for value in (0.0004, 0.04, 0.25, 1.0)] == ["< .001", ".04", ".25", "1"]
