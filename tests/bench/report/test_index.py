"""The index over several runs: leaderboards by data set and truth, cards, and what is refused."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest
from builders import make_failed, read_all, write_all, write_run

from bench.analysis.run import read_run
from bench.report.index import NamedRun, index_html, run_groups, write_index

CHAIRS = [f"chair/{i:02d}" for i in range(12)]
METHODS = ["splat", "pc2pix", "pc2pix@all", "surface-apss", "true-mesh", "blank"]
SMALL = {"objects": CHAIRS, "methods": METHODS, "conditions": ["2048", "noise-0.10"]}
FEW = {"objects": CHAIRS[:2], "methods": ["splat", "pc2pix", "blank"], "conditions": ["2048"]}


def write_scores(directory: Path, scores: dict[str, float], **changes) -> Path:
    """A run whose methods have these values of ssim-object, and 1 less these of lpips."""
    run = write_run(directory, **(SMALL | {"methods": [*scores]} | changes))
    records = [
        replace(r, ssim_object=scores[r.method], lpips=1 - scores[r.method]) for r in read_all(run)
    ]
    write_all(run, records)
    return run


def named(*runs: Path) -> list[NamedRun]:
    return [NamedRun(run.name, read_run(run), f"{run.name}/report.html") for run in runs]


def places(board) -> dict[str, int | None]:
    return {row["name"]: row["place"] for row in board["rows"]}


def cells(board, method: str) -> list[str]:
    (row,) = (row for row in board["rows"] if row["name"] == method)
    return [
        " ".join(filter(None, (cell.text, cell.letters, cell.beneath, cell.caveat)))
        for cell in row["cells"]
    ]


@pytest.fixture(scope="module")
def chairs(tmp_path_factory):
    scores = {"pc2pix": 0.9, "pc2pix@all": 0.8, "splat": 0.3, "surface-apss": 0.2, "blank": 0.25}
    return write_scores(tmp_path_factory.mktemp("index") / "chairs", {**scores, "true-mesh": 1.0})


def test_a_board_has_a_group_for_each_run_and_the_mean_of_places(chairs, tmp_path):
    few = write_scores(tmp_path / "few", {"splat": 0.9, "pc2pix": 0.5, "blank": 0.1}, **FEW)
    (group,) = run_groups(named(chairs, few))
    board = group["board"]
    assert group["title"] == "procedural, against the true mesh in its colours"
    assert [(g.name, g.about, g.link) for _, g in board["groups"]] == [
        ("chairs", "mean over 2 conditions", "chairs/report.html"),
        ("few", "2,048 points", "few/report.html"),
        ("", "", ""),
    ]
    names = [column.name for _, g in board["groups"] for column in g.columns]
    assert names == [*("ssim-object", "lpips", "2 views (ms)") * 2, "mean place", "trained on"]
    # Each is the better one in one of the runs; the others have not met them in both.
    assert places(board) == {
        **{"pc2pix": 1, "splat": 2},
        **dict.fromkeys(("pc2pix@all", "surface-apss", "blank", "true-mesh")),
    }
    few_cells = [".500", ".500", "500"]
    assert cells(board, "pc2pix") == [".900 a", ".100 a", "500", *few_cells, "1.5", "chairs"]
    assert cells(board, "pc2pix@all")[3:7] == ["–"] * 4
    assert cells(board, "true-mesh") == ["1.000", ".000", *["–"] * 6]  # neither letters nor cost
    assert "few has no letters: too few objects to decide: at least 8." in board["notes"]
    assert "No place, as they do not have every value: pc2pix@all, surface-apss." in board["notes"]


def test_values_say_who_is_not_shown_to_differ_and_what_is_worse_than_blank(chairs):
    (group,) = run_groups(named(chairs))
    by_method = {
        row["name"]: cells(group["board"], row["name"])[0] for row in group["board"]["rows"]
    }
    assert by_method["pc2pix"] == ".900 a"
    assert by_method["pc2pix@all"] == ".800 b"
    assert re.fullmatch(r"(≈\.20?|\.200) d worse than blank", by_method["surface-apss"])
    assert by_method["blank"] == ".250"


@pytest.mark.parametrize("other", [{"dataset": "folder:/meshes"}, {"truth": "grey"}])
def test_runs_of_other_data_or_truth_are_never_ranked_together(tmp_path, other):
    """In each run another method is ahead; over both together neither would be."""
    one = write_scores(tmp_path / "one", {"splat": 0.9, "pc2pix": 0.5, "blank": 0.1}, **FEW)
    two = write_scores(
        tmp_path / "two", {"splat": 0.3, "pc2pix": 0.4, "blank": 0.1}, **FEW, **other
    )
    groups = run_groups(named(one, two))
    assert [[card["name"] for card in group["cards"]] for group in groups] == [["one"], ["two"]]
    assert [places(group["board"]) for group in groups] == [
        {"splat": 1, "pc2pix": 2, "blank": None},
        {"pc2pix": 1, "splat": 2, "blank": None},
    ]
    assert [[g.name for _, g in group["board"]["groups"]] for group in groups] == [
        ["one", ""],
        ["two", ""],
    ]
    html = index_html(named(one, two))
    assert html.count('<table class="board">') == 2
    assert unescape(html).count(f">{groups[1]['title']}</h2>") == 1


def test_failed_images_are_counted_and_scored_as_blank(tmp_path):
    run = write_run(tmp_path / "run", **FEW)
    failed = ("splat", "00")
    write_all(
        run,
        [
            make_failed(r.method, r.condition, r.object, r.view)
            if (r.method, r.object) == failed
            else r
            for r in read_all(run)
        ],
    )
    (group,) = run_groups(named(run))
    assert cells(group["board"], "splat")[0].endswith(" 2 of 4 failed")
    assert ("failed", "2 of 12 images") in group["cards"][0]["facts"]


def test_other_weights_of_an_id_are_another_method(tmp_path):
    def drawn_with(weights, scipy):
        stated = {"pc2pix": [2, f"scipy {scipy}, weights {weights}", "cpu"]}
        stated["splat"] = [1, f"scipy {scipy}", "cpu"]
        return {"identities": stated, "versions": {"scipy": scipy}}

    one = write_run(tmp_path / "one", **FEW, **drawn_with("1" * 64, "1.17.1"))
    two = write_run(tmp_path / "two", **FEW, **drawn_with("2" * 64, "1.18.0"), seed=1)
    (group,) = run_groups(named(one, two))
    assert [*places(group["board"])] == [
        *("splat", "pc2pix (weights 1111111)", "pc2pix (weights 2222222)", "blank")
    ]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Two runs with their reports and the index, in the folder that they are in."""

    root = tmp_path_factory.mktemp("runs")
    runs = [write_run(root / "a & b", **FEW), write_run(root / "ラン #2", **FEW, seed=1)]
    assert write_index(runs) == root / "index.html"
    return runs


def test_the_index_links_to_the_reports_and_loads_nothing(written):
    html = (written[0].parent / "index.html").read_text("utf-8")
    links = set(re.findall(r'href="([^"#][^"]*)"', html))
    assert links == {
        "data:,",
        "a%20%26%20b/report.html",
        "%E3%83%A9%E3%83%B3%20%232/report.html",
    }
    for run in written:
        assert (run / "report.html").is_file()
    assert not re.search(r'(src|action)=|url\(|@import|" style=', html)
    assert "default-src 'none'; img-src data:; style-src 'sha256-" in html
    assert '<h3><a href="a%20%26%20b/report.html">a &amp; b</a></h3>' in html
    assert html.count("<article") == 2
    assert re.findall(r"<dt>objects</dt><dd>([^<]+)</dd>", html) == ["2 of class chair"] * 2
    assert re.findall(r"<dt>seed</dt><dd>([^<]+)</dd>", html) == ["0", "1"]


@pytest.mark.slow
def test_the_index_is_refreshed_and_elsewhere_links_to_where_the_reports_are(written, command):
    index = written[0].parent / "index.html"
    before = index.read_bytes()
    index.write_bytes(before[:1500])  # its head says what it is
    (written[0] / "report.html").unlink()
    assert command("report", *written)[:2] == (0, f"{index}\n")
    assert index.read_bytes() == before
    assert (written[0] / "report.html").is_file()
    out = index.parent / "pages" / "site"
    assert command("report", *written, "--out", out)[:2] == (0, f"{out / 'index.html'}\n")
    assert 'href="../../a%20%26%20b/report.html"' in (out / "index.html").read_text("utf-8")


def test_what_is_refused_writes_nothing(written, command, tmp_path):
    first, second = written
    copy = shutil.copytree(first, tmp_path / "copy")
    (copy / "report.html").unlink()
    (tmp_path / "index.html").write_text("<p>mine</p>")
    before = sorted(tmp_path.rglob("*"))
    for arguments, message in (
        ((first, second, first), f"{first}: given twice"),
        ((first, tmp_path / "gone", "--out", tmp_path / "new"), "no such folder"),
        ((first, copy, "--out", tmp_path / "new"), f"{copy}: a copy of the run in {first}"),
        ((first, copy), "the runs are in several folders; give --out"),
        ((first, second, "--out", tmp_path), "index.html: is there, and no index of runs"),
        ((first, second, "--out", tmp_path / "x.html"), "of several runs a folder is needed"),
        ((first, second, "--out", tmp_path / "index.html"), "of several runs a folder is needed"),
    ):
        status, printed, err = command("report", *arguments)
        assert (status, printed, err.count("\n")) == (2, "", 1), err
        assert message in err
        assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "index.html").read_text() == "<p>mine</p>"


def test_what_a_run_does_not_have_is_named(tmp_path):
    run = write_run(tmp_path / "run", **FEW)
    write_all(run, [replace(record, lpips=None) for record in read_all(run)])
    failed = write_run(tmp_path / "failed", **FEW)
    write_all(failed, [make_failed(r.method, r.condition, r.object, r.view) for r in read_all(run)])
    (group,) = run_groups(named(run, failed))
    assert [card["name"] for card in group["cards"]] == ["run", "failed"]
    notes = " ".join(group["board"]["notes"])
    assert "run has no lpips: " in notes
    assert "failed has no scored image." in notes
    assert [g.name for _, g in group["board"]["groups"]] == ["run", ""]
    assert sorted(filter(None, places(group["board"]).values())) == [1, 2]  # of the run with values
    assert run_groups(named(failed))[0]["board"] is None
    assert '<table class="board">' not in index_html(named(failed))
