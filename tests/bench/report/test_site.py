"""`bench site`: what its pages say, that all links lead somewhere, and what it refuses."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import pytest
from builders import write_run

from bench.catalogue.methods import METHODS
from bench.report.site.method_page import _card
from bench.report.site.page import card_html

OBJECTS = [f"chair/{i:02d}" for i in range(9)]  # enough for intervals
METHODS_OF_FIRST = ["splat", "pc2pix", "true-mesh", "blank"]
LINK = re.compile(r'(?:href|src)="([^"#][^"]*)"')


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    root = tmp_path_factory.mktemp("runs")
    first = write_run(root / "first", objects=OBJECTS, methods=METHODS_OF_FIRST)
    second = write_run(root / "second", objects=OBJECTS, methods=["splat", "blank"], seed=1)
    return first, second


@pytest.fixture(scope="module")
def site(runs, tmp_path_factory):
    from bench.report.site.write import write_site

    out = tmp_path_factory.mktemp("site") / "site"
    assert write_site(runs, out) == len(list(out.glob("*.html"))) - len(runs)
    return out


def text(path: Path) -> str:
    """What a page says, without tags."""
    body = path.read_text("utf-8").partition("<body>")[2].partition("<script>")[0]
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def board_rows(path: Path) -> dict[str, tuple[str, str]]:
    """The kinds and texts of the rows of the leaderboard, by the names of methods."""
    body = path.read_text("utf-8").partition('<table class="board">')[2].partition("</table>")[0]
    rows = {}
    for row in body.partition("<tbody>")[2].split("<tr")[1:]:
        kind = re.match(r' class="(\w+)"', row)
        name = re.search(r'class="name">(?:<a [^>]*>)?([^<]+)', row)
        assert name
        words = " ".join(unescape(re.sub(r"<[^>]+>", " ", row.partition(">")[2])).split())
        rows[unescape(name[1])] = (kind[1] if kind else "", words)
    return rows


def test_every_link_is_a_file_beside_the_page_and_no_file_is_lost(site):
    linked = {"index.html"}
    for page in site.glob("*.html"):
        if page.name.startswith("report-"):
            continue
        for target in LINK.findall(page.read_text("utf-8")):
            if target.startswith("https://"):
                assert page.name == "about.html"  # of the paper
            elif not target.startswith("data:"):
                assert "/" not in target, (page.name, target)
                linked.add(target)
    assert linked == {path.name for path in site.iterdir()}


def test_links_within_the_index_have_their_targets(site):
    index = (site / "index.html").read_text("utf-8")
    anchors = set(re.findall(r'href="#([^"]+)"', index))
    assert {"content", "runs", "means-rank", "means-cost", "means-lpips"} <= anchors
    assert anchors <= set(re.findall(r' id="([^"]+)"', index))


def test_a_page_for_each_run_method_and_pair(site):
    pairs = {path.name for path in site.glob("compare-*--*.html")}
    (best,) = pairs & {"compare-splat--pc2pix.html", "compare-pc2pix--splat.html"}
    (floor,) = pairs & {"compare-true-mesh--blank.html", "compare-blank--true-mesh.html"}
    assert pairs - {best, floor} == {  # reference methods come last
        f"compare-{method}--{reference}.html"
        for method in ("splat", "pc2pix")
        for reference in ("true-mesh", "blank")
    }
    assert {path.name for path in site.glob("*.html")} == {
        *("index.html", "compare.html", "cost.html", "about.html", *pairs),
        *("run-first.html", "run-second.html", "report-first.html", "report-second.html"),
        *(f"method-{method}.html" for method in METHODS_OF_FIRST),
    }


def test_downloads_are_those_of_the_run(site, runs):
    for run in runs:
        for path in (*(run / "tables").glob("*.csv"), run / "records.parquet"):
            assert (site / f"{run.name}-{path.name}").read_bytes() == path.read_bytes()


def test_ranks_have_letters_and_pairs_their_counts(site):
    ranks = text(site / "run-first.html")
    assert re.search(r"splat 0\.\d{3} \[?.*?a first", ranks)
    pair = site / "compare-splat--blank.html"
    found = re.search(r"is ahead (\d+) times, \w+ (\d+) times, and (\d+) times no", text(pair))
    assert found
    metrics, conditions, folders = 2, 2, 2
    assert sum(map(int, found.groups())) == metrics * conditions * folders


def test_differences_have_their_p_values_beside_them(site):
    (pair,) = (
        path
        for path in site.glob("compare-*--*.html")
        if {"splat", "pc2pix"} == set(path.stem.removeprefix("compare-").split("--"))
    )
    shown = re.findall(r"(?:not decided|ahead), p (?:< )?[\d.]+", text(pair))
    assert len(shown) == 2 * 2  # metrics and conditions of the run that has both


def test_costs_name_their_machine_and_are_not_pooled(site):
    assert text(site / "cost.html").count("an unknown processor") == 2


def test_only_the_index_has_a_script_and_no_page_an_inline_style(site):
    for page in site.glob("*.html"):
        if not page.name.startswith("report-"):
            body = page.read_text("utf-8").partition("<body>")[2]
            assert body.count("<script") == (page.name == "index.html")
            assert " style=" not in body


def test_the_same_runs_give_the_same_bytes(site, runs, tmp_path):
    from bench.report.site.write import write_site

    write_site(runs, tmp_path / "again")
    assert {p.name: p.read_bytes() for p in (tmp_path / "again").iterdir()} == {
        p.name: p.read_bytes() for p in site.iterdir()
    }


def test_a_card_is_shown_without_links_html_and_comments():
    table = "| | n |\n|---|---:|\n| d | 1 |\n"
    found = card_html(f"# T\n<!-- x -->\n[a](../b.md) <b>c</b>\n\n{table}\n```\nx<y\n```\n")
    assert "<h3>T</h3>" in found
    assert "href" not in found
    assert "&lt;b&gt;c&lt;/b&gt;" in found
    assert "x -->" not in found
    assert '<td></td>\n<th class="right">n</th>' in found
    assert "<code>x&lt;y\n</code>" in found


def test_a_card_is_found_by_its_name_or_its_heading(tmp_path):
    (tmp_path / "a.md").write_text("# Model card: `a` and `a-grey`\n\nnot `b`\n")
    (tmp_path / "b.md").write_text("# Other\n`c`\n")
    found = {name: _card(tmp_path / f"{name}.safetensors") for name in ("a", "a-grey", "b", "c")}
    assert [name for name, card in found.items() if card] == ["a", "a-grey", "b"]
    for bundled in filter(None, (method.weights_file for method in METHODS)):
        assert _card(bundled()), bundled()


def test_what_is_refused_writes_nothing(runs, command, tmp_path):
    first, second = runs
    out = tmp_path / "site"
    cases = [
        ((first, first), f"{first}: given twice"),
        ((first, tmp_path / "gone"), "no such folder"),
    ]
    for directories, message in cases:
        status, printed, err = command("site", *directories, "--out", out)
        assert (status, printed, err.count("\n")) == (2, "", 1)
        assert message in err
        assert not any(tmp_path.iterdir())
    status, _, err = command("site", second, "--out", tmp_path)
    assert status == 2
    assert "is there already" in err


def test_reference_methods_are_never_among_the_first(site):
    """A white image and the true mesh are shown with their values, and nobody ranks them."""
    rows = board_rows(site / "index.html")
    assert set(list(rows)[2:]) == {"true-mesh", "blank"}  # the last
    assert {name: kind for name, (kind, _) in rows.items()} == {
        "splat": "",
        "pc2pix": "",
        "true-mesh": "reference",
        "blank": "reference",
    }
    for reference in ("true-mesh", "blank"):
        assert rows[reference][1].startswith("– ")  # no place and no letters
    ranks = text(site / "run-first.html")
    assert re.search(r"true-mesh ceiling 1\.000 (?!a)", ranks)
    assert re.search(r"blank floor 0\.\d{3} (?!a)", ranks)


def test_few_objects_have_no_letters(tmp_path, command):
    """Five methods have ten pairs: 2^-7 x 10 is .078, 2^-8 x 10 is .039."""
    methods = ["splat", "pc2pix", "poisson", "pgr", "surface-fit", "blank"]
    run = write_run(tmp_path / "few", objects=OBJECTS[:8], methods=methods, conditions=["2048"])
    assert command("site", run, "--out", tmp_path / "site")[0] == 0
    words = "too few objects to decide: at least 9."
    index = text(tmp_path / "site" / "index.html")
    assert f"Mean ranks without letters: {words}" in index
    assert f"Whether it differs from others {words.removesuffix('.')} " in index
    for name, (_, words_of_row) in board_rows(tmp_path / "site" / "index.html").items():
        assert re.match(rf"(\d|–) {re.escape(name)} ", words_of_row)  # a place without letters
    assert f"Without letters: {words}" in text(tmp_path / "site" / "run-few.html")
    assert "untested" in text(tmp_path / "site" / "compare.html")
    assert f"Untested: {words}" in text(tmp_path / "site" / "compare.html")
    (pair,) = (path for path in (tmp_path / "site").glob("compare-*pgr*") if "splat" in path.name)
    assert f"There are {words}" in text(pair)
