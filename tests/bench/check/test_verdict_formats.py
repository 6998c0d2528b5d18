"""Verdicts of `bench check` for people and for programs: one table for all formats."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from xml.dom import minidom

import numpy as np
import pandas as pd
import pytest

from bench.analysis.run import read_run
from bench.check.golden import bless
from bench.records.folder import read_manifest, write_manifest
from bench.suites.stability.outcomes import COLUMNS, NAME
from bench.tables.build import write_outputs

from ..builders import make_manifest, overwrite, write_run, write_run_with_tables

OBJECTS = [f"chair/{name}" for name in "abcdefghij"]
FORMATS = ("text", "json", "junit")
LINE = re.compile(r"moved(?: \(\w+\))? (\S+) of (\S+) at (\S+): (.*)")


@pytest.fixture(scope="module")
def seed_folder(tmp_path_factory):
    """Return a folder with a run, and golden values of it in a file."""
    folder = tmp_path_factory.mktemp("seed")
    run = write_run_with_tables(folder / "run", objects=OBJECTS, methods=["splat", "blank"], seed=5)
    bless(run, folder / "golden.json")
    return folder


@pytest.fixture
def golden_run(seed_folder, tmp_path):
    return Path(shutil.copytree(seed_folder, tmp_path / "here")) / "run"


def moved(score, by, names="abcdefghij", elsewhere=False):
    """Return a change of a score of splat at 512, by so much or to nothing, of some objects."""

    def harm(run):
        frame = pd.read_parquet(run / "records.parquet")
        chosen = (frame["method"] == "splat") & (frame["condition"] == "512")
        frame.loc[chosen & frame["object"].isin([*names]), score] += by
        overwrite(run, frame)
        if elsewhere:
            write_manifest(run, read_manifest(run) | {"environment": {"gl": "another"}})

    return harm


def of_objects(count):
    return f"{count} of 10 objects moved by more than 0.000001: chair/"


def of_mean(by, allowed, each):
    return (
        f"the mean of 10 objects moved by {by}, more than {allowed}, though none of them by more "
        f"than {each}"
    )


# By what happens to the run: the change, and the cells of splat at 512 that fail, with the
# beginning of what is said. The mean of 24 chairs may move by 0.001 (ssim) and 0.0015 (lpips)
# elsewhere, and that of 10 by the root of 2.4 as much.
CASES = {
    "nothing": (lambda run: None, {}),
    "a metric that should rise falls": (moved("ssim", -0.1), {"ssim": of_objects(10)}),
    "a metric that should rise rises": (moved("ssim", 0.1), {"ssim": of_objects(10)}),
    "a metric that should fall rises": (moved("lpips", 0.1, "c"), {"lpips": of_objects(1)}),
    "a metric that should fall falls": (moved("lpips", -0.1, "c"), {"lpips": of_objects(1)}),
    "an object has lost its value": (moved("ssim", np.nan, "d"), {"ssim": of_objects(1)}),
    "another has lost its other value": (moved("lpips", np.nan, "e"), {"lpips": of_objects(1)}),
    "elsewhere an object has lost its value": (
        moved("ssim", np.nan, "d", elsewhere=True),
        {"ssim": "1 of 10 objects moved by more than 0.002200: chair/d no value, golden 0."},
    ),
    "elsewhere a mean that should rise falls": (
        moved("ssim", -0.002, elsewhere=True),
        {"ssim": of_mean("-0.002000", "0.001549", "0.002200")},
    ),
    "elsewhere a mean that should rise rises": (
        moved("ssim", 0.002, elsewhere=True),
        {"ssim": of_mean("+0.002000", "0.001549", "0.002200")},
    ),
    "elsewhere a mean that should fall falls": (
        moved("lpips", -0.003, elsewhere=True),
        {"lpips": of_mean("-0.003000", "0.002324", "0.010000")},
    ),
    "elsewhere a mean moves less": (moved("ssim", -0.0015, elsewhere=True), {}),
}


def told(form, out):
    """Return the cells that failed with what is said, and the lines on what is no cell."""
    if form == "text":
        lines = [line for line in out.splitlines() if line.startswith(("moved", "DIFFERS"))]
        cells = {tuple(found.groups()[:3]): found[4] for found in map(LINE.match, lines) if found}
        others = [line.removeprefix("DIFFERS ") for line in lines if not LINE.match(line)]
        assert out.splitlines()[-1 - ("moved most" in out)].endswith(f"{len(lines)} moved")
    elif form == "json":
        verdict = json.loads(out)
        names = ("metric", "method", "condition")
        cells = {tuple(map(c.get, names)): c["problem"] for c in verdict["moved"]}
        others = verdict["others"]
        assert verdict["agrees"] == (not cells and not others)
    else:
        suite = minidom.parseString(out.encode()).documentElement
        cases = suite.getElementsByTagName("testcase")
        failed = {case: case.getElementsByTagName("failure") for case in cases}
        cells, others = {}, []
        for case in (case for case in cases if failed[case]):
            (failure,) = failed[case]
            message = failure.getAttribute("message")
            if case.getAttribute("classname") == "tables":
                others.append(message)
                continue
            metric, _, condition = case.getAttribute("name").partition(" at ")
            key = metric, case.getAttribute("classname"), condition
            cells[key] = message.removeprefix("{} of {} at {}: ".format(*key))
        counted = [suite.getAttribute(name) for name in ("tests", "failures")]
        assert counted == [str(len(cases)), str(len(cells) + len(others))]
    return cells, others


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", CASES)
def test_each_format_says_what_moved_and_fails(golden_run, command, name, form):
    harm, failing = CASES[name]
    harm(golden_run)
    golden = golden_run.with_name("golden.json")
    status, out, err = command("check", golden_run, "--golden", golden, "--format", form)
    assert (status, err) == (int(bool(failing)), "")
    cells, others = told(form, out)
    assert others == []
    assert {*cells} == {(metric, "splat", "512") for metric in failing}
    for metric, said in failing.items():
        assert cells[metric, "splat", "512"].startswith(said)
        better = name.endswith(("rise rises", "fall falls"))
        verdict = f"moved ({'better' if better else 'worse'})"
        in_format = {"text": f"{verdict} {metric}", "junit": f'<failure type="{verdict}"'}
        assert in_format.get(form, f'"better": {str(better).lower()}') in out


@pytest.mark.parametrize("form", FORMATS)
def test_other_true_images_are_said_once(golden_run, command, form):
    frame = pd.read_parquet(golden_run / "records.parquet")
    frame.loc[frame["object"].isin(["a", "b"]), ["ssim", "lpips", "psnr"]] += 0.1
    overwrite(golden_run, frame)
    alter = moved("contrast", 0.1, "c")  # of an object with the same true images
    alter(golden_run)
    golden = golden_run.with_name("golden.json")
    status, out, _ = command("check", golden_run, "--golden", golden, "--format", form)
    cells, (line,) = told(form, out)
    assert (status, [*cells]) == (1, [("contrast", "splat", "512")])
    assert line.startswith("the true images, or the metrics: a white image has other values on 2 ")
    assert "chair/a among them. 12 lines that follow from it are left out" in line  # 3 of 4 cells


@pytest.mark.parametrize("form", FORMATS)
def test_each_format_fails_for_a_table_that_is_stale(run, command, form):
    path = run / "tables" / "table3_ssim.csv"
    path.write_text(path.read_text().replace("0.", "0.9", 1))
    status, out, _ = command("check", run, "--format", form)
    line = f"{path}: not what the records give; 'bench table {run}' restores it"
    assert (status, told(form, out)) == (1, ({}, [line]))
    write_outputs(read_run(run))
    status, out, _ = command("check", run, "--format", form)
    assert (status, told(form, out)) == (0, ({}, []))


@pytest.mark.parametrize("form", FORMATS)
def test_each_format_fails_for_an_outcome_that_is_not_the_stated_one(tmp_path, command, form):
    write_manifest(tmp_path, make_manifest(suite="stability", views=1))
    row = dict.fromkeys(COLUMNS, "x") | {"kind": "unexpected", "subject": "splat", "case": "zero"}
    row |= {"observed": "images", "expected": "a refusal"}
    (tmp_path / "tables").mkdir()
    pd.DataFrame([row]).to_csv(tmp_path / "tables" / f"{NAME}.csv", index=False)
    status, out, _ = command("check", tmp_path, "--format", form)
    line = "splat, zero: images; stated was: a refusal"
    assert (status, told(form, out)) == (1, ({}, [line]))


NAMES = {  # bytes of a folder's name, and how it is told
    b"a\x01\x1b]b": r"a\x01\x1b]b",
    b"\xff\xfe": r"\udcff\udcfe",
    b"a\nb": r"a\nb",
    b"<&\"'>": "<&\"'>",
    b"a\xef\xbf\xbe": r"a\ufffe",
}


@pytest.mark.parametrize("name", NAMES)
def test_programs_can_read_the_verdict_on_a_folder_of_any_name(
    golden_run, command, tmp_path, monkeypatch, name
):
    monkeypatch.chdir(tmp_path)
    folder = Path(name.decode(errors="surrogateescape"))
    shutil.move(golden_run, folder)
    golden = ("--golden", golden_run.with_name("golden.json"))
    status, out, _ = command("check", folder, *golden, "--format", "junit")
    suite = minidom.parseString(out.encode()).documentElement
    shown = NAMES[name]
    assert (status, suite.getAttribute("name")) == (0, f"bench check {shown}")
    status, out, _ = command("check", folder, *golden, "--format", "json")
    assert (status, json.loads(out.encode())["run"]) == (0, shown)


def test_remarks_stand_on_lines_of_their_own(golden_run, command, tmp_path):
    part = write_run(tmp_path / "part", objects=OBJECTS[:2], methods=["splat", "blank"], seed=5)
    golden = ("--golden", golden_run.with_name("golden.json"))
    _, out, _ = command("check", part, *golden, "--format", "junit")
    suite = minidom.parseString(out.encode()).documentElement
    (remarks,) = suite.getElementsByTagName("system-out")
    _, out, _ = command("check", part, *golden, "--format", "json")
    assert remarks.firstChild.data.split("\n") == json.loads(out)["remarks"]
    assert len(json.loads(out)["remarks"]) == 3
