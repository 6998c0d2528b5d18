"""The site over several runs: leaderboards, pages and their links, and what is refused."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import pytest
from builders import make_failed, read_all, write_all, write_run

from bench.analysis.run import read_run
from bench.records.folder import locked_run
from bench.report.index import (
    BoardGroup,
    NamedRun,
    index_html,
    leaderboard,
    metric_column,
    run_groups,
    value_cell,
)
from bench.report.site import command_of, page_files, write_site

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


def test_equal_mean_places_share_a_rank():
    values = {"lpips": {"splat": 0.1, "pc2pix": 0.2, "alpha-wrap": 0.3}}
    values["ssim"] = {"splat": 0.8, "pc2pix": 0.9, "alpha-wrap": 0.7}
    columns = []
    for metric, by_method in values.items():
        one = {name: value_cell(value, metric, name) for name, value in by_method.items()}
        columns.append(metric_column(metric, one))
    board = leaderboard("", [BoardGroup(columns)], [], [*values["lpips"]], [])
    assert places(board) == {"splat": 1, "pc2pix": 1, "alpha-wrap": 3}


def test_a_small_run_has_a_board_of_its_own(tmp_path):
    """Over both, only splat-net and fused-net had places: those of fewer objects and conditions."""
    scores = {"splat-net@chair": 0.73, "splat-net": 0.67, "fused-net": 0.68, "blank": 0.2}
    complete = write_scores(tmp_path / "complete", scores)
    scores = {"splat-net": 0.8, "fused-net": 0.5, "blank": 0.0}
    small = write_scores(tmp_path / "small", scores, **(FEW | {"methods": [*scores]}))
    first, second = run_groups(named(complete, small))
    assert (first["title"], second["title"]) == ("complete", "small")
    assert first["about"] == (
        "12 chairs (procedural), 2 views of each, seed 0; 2,048 points, noise 10 % of the radius; "
        "against the true mesh in its colours; protocol 4."
    )
    names = [column.name for _, g in first["board"]["groups"] for column in g.columns]
    assert names == ["ssim-object", "lpips", "2 views (ms)", "mean place", "trained on"]
    groups = [[g.name for _, g in group["board"]["groups"]] for group in (first, second)]
    assert groups == [["mean over 2 conditions", ""], ["2,048 points", ""]]
    assert [places(group["board"]) for group in (first, second)] == [
        {"splat-net@chair": 1, "fused-net": 2, "splat-net": 3, "blank": None},
        {"splat-net": 1, "fused-net": 2, "blank": None},
    ]
    assert cells(first["board"], "splat-net@chair") == [".730 a", ".270 a", "500", "1.0", "chairs"]
    assert cells(second["board"], "blank") == [".000", "1.000", "–", "–", "–"]
    assert "No letters: too few objects to decide: at least 8." in second["board"]["notes"]


def test_values_say_who_is_not_shown_to_differ_and_what_is_worse_than_blank(chairs):
    (group,) = run_groups(named(chairs))
    by_method = {
        row["name"]: cells(group["board"], row["name"])[0] for row in group["board"]["rows"]
    }
    assert by_method["pc2pix"] == ".900 a"
    assert by_method["pc2pix@all"] == ".800 b"
    assert re.fullmatch(r"(≈\.20?|\.200) d worse than blank", by_method["surface-apss"])
    assert by_method["blank"] == ".250"


@pytest.mark.parametrize(
    "other",
    [
        {"dataset": "folder:/meshes"},
        {"truth": "grey"},
        {"seed": 1},
        {"conditions": ["noise-0.10"]},
        {"objects": CHAIRS[2:4]},
        {"condition_identities": {"2048": "another version"}},
        {"identities": {"pc2pix": [2, "other weights", "cpu"]}},
    ],
    ids=lambda other: str(*other),
)
def test_runs_that_are_not_alike_are_never_ranked_together(tmp_path, other):
    """In each run another method is ahead; over both together neither would be."""
    one = write_scores(tmp_path / "one", {"splat": 0.9, "pc2pix": 0.5, "blank": 0.1}, **FEW)
    changed = {**FEW, **other}
    two = write_scores(tmp_path / "two", {"splat": 0.3, "pc2pix": 0.4, "blank": 0.1}, **changed)
    groups = run_groups(named(one, two))
    assert [group["title"] for group in groups] == ["one", "two"]
    assert [places(group["board"]) for group in groups] == [
        {"splat": 1, "pc2pix": 2, "blank": None},
        {"pc2pix": 1, "splat": 2, "blank": None},
    ]


def test_other_true_images_of_the_same_names_are_not_ranked_together(tmp_path):
    one, two = write_run(tmp_path / "one", **FEW), write_run(tmp_path / "two", **FEW)
    write_all(two, [replace(r, ssim=r.ssim + 0.01) for r in read_all(two)])
    assert [group["title"] for group in run_groups(named(one, two))] == ["one", "two"]


def test_methods_of_runs_that_are_alike_stand_together(tmp_path):
    """Their letters and places are those of one run; what two have stands there once."""
    scores = {"pc2pix": 0.9, "splat": 0.3, "blank": 0.1}
    one = write_scores(tmp_path / "one", scores, machine={"cpu": "A"})
    scores = {"splat": 0.4, "surface-apss": 0.2, "blank": 0.1}
    two = write_scores(tmp_path / "two", scores, machine={"cpu": "B"})
    (group,) = run_groups(named(one, two))
    reports = [("one", "one/report.html"), ("two", "two/report.html")]
    assert (group["title"], [run[:2] for run in group["runs"]]) == ("one, two", reports)
    board = group["board"]
    assert places(board) == {"pc2pix": 1, "splat": 2, "surface-apss": 3, "blank": None}
    assert cells(board, "splat") == [".300 b", ".700 b", "500", "2.0", "nothing"]
    assert cells(board, "surface-apss")[0].split()[1:] == ["c"]
    assert [c.title[-5:] for _, g in board["groups"] for c in g.columns][2] == " A, B"
    assert "Of several runs, and here of the first that has it: splat, blank." in board["notes"]


STRANGE = ["splat", "ext:Mod", "ext@Mod", "é/" * 200, "../up", "report", "blank"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Two runs and their site."""
    root = tmp_path_factory.mktemp("runs")
    runs = [
        write_run(root / "a & b", **(FEW | {"methods": STRANGE})),
        write_run(root / "ラン #2", **FEW, seed=1),
    ]
    assert write_site(runs, root / "site") == root / "site" / "index.html"
    return runs, root / "site"


def test_no_link_leads_out_of_the_site_and_nothing_is_loaded(written):
    runs, site = written
    pages = {path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()}
    of_methods = {*page_files(STRANGE[:-1]).values()}
    assert len(of_methods) == 6
    assert pages == {
        "index.html",
        *(f"a & b/{name}" for name in ("report.html", *of_methods)),
        *(f"ラン #2/{name}.html" for name in ("report", "splat", "pc2pix")),
    }
    reached = set()
    for page in pages:
        html = (site / page).read_text("utf-8")
        for link in set(re.findall(r'href="([^"#][^"]*)"', html)) - {"data:,"}:
            target = ((site / page).parent / unquote(link)).resolve()
            reached.add(target.relative_to(site).as_posix())
        assert not re.search(r'(src|action)="(?!data:)|url\((?!#)|@import|" style=', html)
        assert "default-src 'none'; img-src data:; style-src 'sha256-" in html
    assert reached == pages
    assert not (runs[0] / "report.html").exists()  # runs stay as they are


@pytest.mark.slow
def test_what_is_current_is_not_written_again(written, command):
    runs, site = written
    before = {path: path.stat().st_mtime_ns for path in site.rglob("*.html")}
    changed = site / "a & b" / "splat.html"
    text = changed.read_text("utf-8")
    changed.write_text(text[:1500])  # its head says what it is
    assert command("report", *runs, "--out", site)[:2] == (0, f"{site / 'index.html'}\n")
    assert changed.read_text("utf-8") == text
    after = {path: path.stat().st_mtime_ns for path in site.rglob("*.html")}
    assert [path for path in before if before[path] != after.pop(path)] == [changed]
    assert after == {}


def test_a_command_repeats_a_method():
    manifest = {
        "request": {"suite": "chair-robustness", "methods": ["ours", "splat"], "seed": 3}
        | {"inception_weights": "my weights.pt", "conditions": ["512"]},
        "objects": ["chair/a", "table/b", "table/c"],
        "conditions": ["2048", "512"],
        "entered": {"ours": {"tree": "/images", "name": "ours"}},
    }
    assert command_of("ours", manifest) == (
        "bench run --suite chair-robustness --methods images:/images --seed 3 "
        "--inception-weights 'my weights.pt' --conditions 2048,512 --limit 2"
    )


def test_what_is_refused_writes_nothing(written, command, tmp_path):
    (first, second), site = written
    copy = shutil.copytree(first, tmp_path / "copy")
    namesake = shutil.copytree(second, tmp_path / "namesake" / "A & B")
    mine, other, to, linked = (shutil.copytree(site, tmp_path / name) for name in "abcd")
    (mine / first.name / "notes.html").write_text("<p>mine</p>")
    (other / "index.html").write_text("<p>mine</p>")
    shutil.move(linked / "index.html", to / "index.html")
    (linked / "index.html").symlink_to(to / "index.html")
    shutil.rmtree(to / first.name)
    (to / first.name).symlink_to(linked / first.name)
    before = sorted(tmp_path.rglob("*"))
    for arguments, message in (
        ((first, second), "several runs become a site; give --out"),
        ((first, second, first, "--out", site), f"{first}: given twice"),
        ((first, tmp_path / "gone", "--out", tmp_path / "new"), "no such folder"),
        ((first, copy, "--out", tmp_path / "new"), f"{copy}: a copy of the run in {first}"),
        ((first, namesake, "--out", tmp_path / "new"), f"{namesake}: has the name of {first}, "),
        ((first, second, "--out", other), f"{other / 'index.html'}: is there, and no index"),
        ((first, second, "--out", mine), "notes.html: is there, and no page of a site"),
        ((first, second, "--out", linked), f"{linked / 'index.html'}: is there, and no index"),
        ((first, second, "--out", to), f"{to / first.name}: is there, and no page"),
        ((first, second, "--out", first.parent), "lock: is there, and no page of a site"),
        ((first, second, "--out", tmp_path / "x.html"), "of several runs a folder is needed"),
    ):
        status, printed, err = command("report", *arguments)
        assert (status, printed, err.count("\n")) == (2, "", 1), err
        assert message in err
        assert sorted(tmp_path.rglob("*")) == before
    with locked_run(second, ""):
        status, _, err = command("report", first, second, "--out", tmp_path / "new")
    assert (status, str(second) in err) == (2, True)
    assert sorted(tmp_path.rglob("*")) == before


def test_what_a_run_does_not_have_is_named(tmp_path):
    run = write_run(tmp_path / "run", **FEW)
    write_all(run, [replace(record, lpips=None) for record in read_all(run)])
    failed = write_run(tmp_path / "failed", **FEW)
    write_all(failed, [make_failed(r.method, r.condition, r.object, r.view) for r in read_all(run)])
    first, second = run_groups(named(run, failed))
    assert (first["title"], second["title"]) == ("run", "failed")
    assert any(note.startswith("No lpips: ") for note in first["board"]["notes"])
    assert sorted(filter(None, places(first["board"]).values())) == [1, 2]
    assert second["board"] is None
    assert '<table class="board">' not in index_html(named(failed))
