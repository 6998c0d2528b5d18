"""Golden values of a user's own: any run, methods and dataset, in one file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pandas as pd
import pytest

from bench.check.golden import bless
from bench.records.folder import open_store, read_manifest, write_manifest

from ..builders import overwrite, rewrite, write_run, write_run_with_tables

OBJECTS = ["bench/a\u2028a", *(f"bench/{name}" for name in "bcdefghij")]
NAMES = {"methods": ["splat", "surface-fit", "mine", "blank"], "conditions": ["2048"]}


@pytest.fixture(scope="module")
def seed_folder(tmp_path_factory):
    """Return a folder with a run; `golden.json` beside it has its values."""
    folder = tmp_path_factory.mktemp("own")
    run = folder / "run"
    write_run_with_tables(run, objects=OBJECTS, dataset="folder:here", seed=5, **NAMES)
    bless(run, folder / "golden.json")
    return folder


@pytest.fixture
def run(seed_folder, tmp_path):
    """A run in a copy of that folder."""
    return Path(shutil.copytree(seed_folder, tmp_path, dirs_exist_ok=True)) / "run"


def alter(run, by, method="splat", score="lpips"):
    path = run / "records.parquet"
    frame = pd.read_parquet(path)
    frame.loc[frame["method"] == method, score] += by
    overwrite(run, frame)


def test_a_cell_that_is_worse_by_three_thousandths_is_a_regression(run, tmp_path, command):
    golden = tmp_path / "written.json"
    said = f"golden values written to {golden}\n"
    assert command("check", run, "--bless", golden) == (0, said, "")
    check = ("check", run, "--golden", golden)
    status, out, _ = command(*check)
    assert status == 0
    assert out.endswith(" golden values compared, 0 moved\n")
    alter(run, 0.003)
    status, out, _ = command(*check)
    assert status == 1
    (line,) = (line for line in out.splitlines() if line.startswith("moved "))
    assert line.startswith(
        "moved (worse) lpips of splat at 2048: 10 of 10 objects moved by more than 0.000001: bench/"
    )
    assert (line.count("golden "), line.endswith("; ...")) == (3, True)  # the largest moves alone
    assert (run / "figures" / "moved.png").exists()
    for width, status in (("0.0031", 0), ("0.0029", 1)):
        told, out, _ = command(*check, "--tolerance", f"lpips={width}")
        assert (told, "; but lpips as --tolerance says\n" in out) == (status, True)


def test_the_verdict_for_programs(run, tmp_path, command):
    check = ("check", run, "--golden", tmp_path / "golden.json")
    alter(run, 0.003)
    status, out, _ = command(*check, "--format", "json")
    told = json.loads(out)
    assert (status, told["agrees"]) == (1, False)
    (regression,) = told["moved"]
    assert [regression[n] for n in ("method", "condition", "metric")] == ["splat", "2048", "lpips"]
    assert len(told["objects"]) == 10
    moved = told["objects"][0]
    assert moved["value"] - moved["golden"] == pytest.approx(0.003, abs=2e-6)
    status, out, _ = command(*check, "--format", "junit")
    suite = ElementTree.fromstring(out)
    cases = suite.findall("testcase")
    assert (status, suite.get("tests"), suite.get("failures")) == (1, str(len(cases)), "1")
    failed = [
        (case.get("classname"), case.get("name"))
        for case in cases
        if case.find("failure") is not None
    ]
    assert failed == [("splat", "lpips at 2048")]
    values = [case for case in cases if not case.get("name", "").startswith("images at ")]
    assert told["compared"] == 10 * len(values)
    assert len(cases) - len(values) == len(NAMES["methods"])


def redraw(run, names):
    """Invert the images of splat of some objects, whose scores stay."""
    with open_store(run) as store:
        keys = {row.name.object_id: row.key for row in store.listed() if row.name.method == "splat"}
    for name in names:
        rewrite(run, keys[name], lambda result, a: (result, a | {"images": 255 - a["images"]}))


OTHER_IMAGES = "images of splat at 2048: {} of 10 objects have other images than the golden ones, "
AGREE = "though their values agree: "


def test_other_images_of_equal_values_are_a_regression(run, tmp_path, command):
    """Two views may move by as much, up and down: the mean over the views is the same."""
    check = ("check", run, "--golden", tmp_path / "golden.json")
    path = run / "records.parquet"
    frame = pd.read_parquet(path)
    of_b = (frame["method"] == "splat") & (frame["object"] == "b")
    frame.loc[of_b, "lpips"] += [0.5, -0.5]
    overwrite(run, frame)
    redraw(run, "b")
    status, out, _ = command(*check)
    assert status == 1
    said = f"{OTHER_IMAGES.format(1)}{AGREE}bench/b\n"
    assert f"moved {said}" in out
    status, out, _ = command(*check, "--tolerance", "lpips=0.01")  # other images are allowed then
    assert (status, f"\n{said}" in f"\n{out}") == (0, True)
    redraw(run, "cdefg")
    alter(run, 0.003)
    _, out, _ = command(*check)
    assert "moved images" not in out  # every object is named by its values
    alter(run, -0.003)
    write_manifest(run, read_manifest(run) | {"environment": {"gl": "another"}})
    assert command(*check)[0] == 0
    status, out, _ = command(*check, "--strict")
    assert status == 1
    assert f"{OTHER_IMAGES.format(6)}{AGREE}bench/b; bench/c; bench/d; ...\n" in out


def test_elsewhere_tolerances_are_wider_and_named_unless_strict(run, tmp_path, command):
    check = ("check", run, "--golden", tmp_path / "golden.json")
    write_manifest(run, read_manifest(run) | {"environment": {"gl": "another"}})
    alter(run, 0.002)
    status, out, _ = command(*check)
    assert status == 0
    assert out.splitlines()[0] == (
        "another environment than the golden values': gl another (golden: None); wider tolerances: "
        "ssim-object 0.0055, lpips 0.01 of splat, mine, blank; ssim-object 0.105, lpips 0.12 of "
        "surface-fit (--strict: to the last digit)"
    )
    status, out, _ = command(*check, "--strict")
    assert status == 1
    assert "gl another (golden: None)" in out


def test_elsewhere_the_mean_of_a_cell_may_move_less_than_an_object(run, tmp_path, command):
    check = ("check", run, "--golden", tmp_path / "golden.json")
    write_manifest(run, read_manifest(run) | {"environment": {"gl": "another"}})
    alter(run, 0.003)
    status, out, _ = command(*check)
    assert status == 1
    # 0.0015 of 24 objects, and of 10 by the root of 24 / 10 as much
    assert (
        "moved (worse) lpips of splat at 2048: the mean of 10 objects moved by +0.003000, more "
        "than 0.002324, though none of them by more than 0.010000\n"
    ) in out
    assert command(*check, "--tolerance", "lpips=0.01")[0] == 0


def test_what_only_one_side_has_is_named_and_left_out(run, tmp_path, command, refused):
    golden = tmp_path / "golden.json"
    fewer = {"methods": ["splat", "other"], "conditions": ["2048", "512"]}
    less = write_run(
        tmp_path / "less", objects=OBJECTS[:4], dataset="folder:there", seed=5, **fewer
    )
    status, out, _ = command("check", less, "--golden", golden)
    assert status == 0
    assert out.splitlines()[:6] == [
        "without golden values, left out: methods other",
        "without golden values, left out: conditions 512",
        "golden values of what this run has not, left out: methods blank, mine, surface-fit",
        "golden values of what this run has not, left out: objects " + ", ".join(OBJECTS[4:]),
        "4 of 40 lines of the golden values are compared: this run has no others",
        "same environment as the golden values: means of objects are compared to the last digit, "
        "images to the last bit",
    ]
    none = write_run(tmp_path / "none", objects=["bench/z"], dataset="folder:here", seed=5, **NAMES)
    assert refused("check", none, "--golden", golden).startswith(
        f"{golden}: has no method, condition and object of {none} in common; check a run with "
    )
    other = write_run(tmp_path / "other", objects=OBJECTS, views=3, **NAMES)
    assert refused("check", other, "--golden", golden) == (
        f"{golden}: of another protocol than {other}: dataset procedural (golden: folder), views 3 "
        "(golden: 2), seed 0 (golden: 5); check a run with the same options, or write golden "
        "values of this one with --bless FILE"
    )


@pytest.mark.parametrize(
    ("old", "new"), [("0.", "1."), ('"seed": 5', '"seed": 6'), ("splat", "splot"), ("sha", "sho")]
)
def test_an_altered_file_is_refused(run, tmp_path, refused, old, new):
    golden = tmp_path / "golden.json"
    golden.write_text(golden.read_text().replace(old, new, 1))
    assert refused("check", run, "--golden", golden) == (
        f"{golden}: damaged or altered since it was written; restore it, or write it again with "
        f"'bench check DIR --bless {golden}'"
    )


def test_a_run_that_is_worse_can_fail_a_comparison_and_one_that_is_equal_is_unchanged(
    run, tmp_path, command
):
    old = Path(shutil.copytree(run, tmp_path / "old"))
    compare = ("compare", old, run, "--fail-on", "worse")
    status, out, _ = command(*compare, "--format", "text")
    assert status == 0
    assert out.splitlines()[-1] == "Unchanged in 8 cells."
    alter(run, 0.003)
    status, out, _ = command(*compare, "--format", "text")
    assert status == 1
    assert "behind in 1, unchanged in 7 of 8 cells" in " ".join(out.split())
    alter(run, -0.006)
    assert command(*compare)[0] == 0
