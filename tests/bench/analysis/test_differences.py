"""Paired differences: closed forms, corrected p values, and the command on stored runs."""

from __future__ import annotations

import csv
import json
import math
import shutil

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t

from bench.analysis.compare import Estimate
from bench.analysis.differences import Verdicts, paired_differences, two_methods, who_is_ahead
from bench.records.folder import read_manifest, write_manifest

from ..builders import overwrite, write_run
from .comparisons import comparison, row_of


def pair(a, b, metric="ssim", values=None, condition="2048"):
    """The scores of each object of the two sides, and their values where these are no means."""
    made = comparison({"a": (0, 0, a), "b": (0, 0, b)}, metric, condition)
    if values:
        made["value"] = values
    return tuple(made.to_dict("records"))


def differences(*pairs):
    return paired_differences(pairs).to_dict("records")


def interval_of(cell):
    return cell["difference"], cell["ci_low"], cell["ci_high"]


def test_the_difference_is_b_less_a_and_the_better_side_is_named():
    a = np.linspace(0.5, 0.6, 12)
    (cell,) = differences(pair(a, a + 0.1))
    assert interval_of(cell) == pytest.approx((0.1, 0.1, 0.1))
    assert (cell["ahead"], cell["objects"]) == ("b", 12)
    (cell,) = differences(pair(a, a - 0.1))
    assert cell["ahead"] == "a"


def test_distances_are_better_the_smaller_they_are():
    """Jackknife: standard error sqrt((g - 1) / g sum (d - mean)^2) of the jackknife differences."""
    leave_one_out = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.98, 1.0])
    (cell,) = differences(pair(leave_one_out, 3 * leave_one_out, "fd-views", (1.0, 3.0)))
    error = math.sqrt(7 / 8 * np.sum((2 * leave_one_out - 2) ** 2))
    reach = t.ppf(0.975, 7) * error
    assert interval_of(cell) == pytest.approx((2.0, 2.0 - reach, 2.0 + reach))
    assert cell["p"] == pytest.approx(2 * t.sf(2.0 / error, 7))
    assert cell["ahead"] == "a"


@pytest.mark.parametrize("metric", ["ssim", "fd-views"])
def test_with_its_sides_exchanged_a_difference_has_its_interval_turned(metric):
    """The objects' differences are skewed, so that no interval is its own mirror image."""
    a = np.linspace(0.5, 0.6, 12)
    b = a + 0.02 * np.arange(12) ** 2 / 50
    (cell,) = differences(pair(a, b, metric, (0.5, 1.5)))
    (exchanged,) = differences(pair(b, a, metric, (1.5, 0.5)))
    value, low, high = interval_of(cell)
    assert low < value < high
    assert interval_of(exchanged) == pytest.approx((-value, -high, -low), rel=1e-12)
    assert {cell["ahead"], exchanged["ahead"]} == {"a", "b"}
    assert exchanged["p"] == pytest.approx(cell["p"], rel=1e-12)


def test_ties_and_what_cannot_be_known():
    a = np.linspace(0.5, 0.7, 8)
    difference = np.array([0.1] * 6 + [-0.1] * 2)
    some, same, few = differences(pair(a, a + difference), pair(a, a), pair(a[:7], a[:7] + 0.1))
    assert (some["ahead"], some["cells"]) == ("tie", 2)
    assert some["p_corrected"] == 2 * some["p"]
    assert (same["ahead"], same["p"], same["objects_needed"]) == ("tie", 1.0, None)
    assert (few["ahead"], few["objects_needed"]) == ("unknown", 8)
    assert math.isnan(few["p_corrected"])


@pytest.mark.parametrize("cells", [1, 10, 66])
@pytest.mark.parametrize("objects", [8, 12, 24, 100])
def test_an_interval_never_contradicts_its_verdict(cells, objects):
    """The differences are skewed, of any size, in any number of cells."""
    rng = np.random.default_rng(0)
    made = {m: pair(np.zeros(objects), np.zeros(objects), m) for m in ("ssim", "lpips")}
    by_verdict = {"a": 0, "b": 0, "tie": 0}
    for _ in range(660 // cells):
        pairs = []
        for _ in range(cells):
            b = rng.beta(2, 6, objects) * rng.choice([0.2, 1.0, 3.0])
            sides = made[rng.choice(["ssim", "lpips"])]
            samples = rng.beta(2, 6, objects), b
            pairs.append([side | {"samples": s} for side, s in zip(sides, samples, strict=True)])
        for cell in differences(*pairs):
            by_verdict[cell["ahead"]] += 1
            outside = cell["ci_low"] > 0 or cell["ci_high"] < 0
            assert (cell["ahead"] != "tie") == outside == (cell["p_corrected"] < 0.05)
            assert cell["level"] == 1 - 0.05 / cells
    assert min(by_verdict.values()) > 0


def test_what_is_said_of_two_methods_of_a_run_is_corrected_for_its_cells():
    """Ten cells of the headline are a sentence; another metric is one of its own."""
    rng = np.random.default_rng(1)
    run = pd.concat(
        comparison({"splat": (1, 1, rng.random(8)), "blank": (0, 0, rng.random(8))}, m, c)
        for c in ("2048", "1024", "512", "noise-0.05", "noise-0.10")
        for m in ("lpips", "ssim-object", "psnr")
    )
    further = run["metric"] == "psnr"
    verdicts = Verdicts(run[~further], run[further])
    cell = verdicts.difference("blank", "splat", "lpips", "512", "chair")
    asked = two_methods(run, ["ssim-object", "lpips"], "blank", "splat")
    assert asked["metric"].tolist() == ["ssim-object"] * 5 + ["lpips"] * 5
    same = row_of(asked, metric="lpips", condition="512")
    assert cell["cells"] == 10
    assert (interval_of(cell), cell["p"]) == (interval_of(same), same["p"])
    assert verdicts.difference("blank", "splat", "psnr", "512", "chair")["cells"] == 5


@pytest.fixture
def two_runs(tmp_path):
    """A run, and a copy in which each splat has an SSIM higher by 0.01."""
    first = write_run(tmp_path / "first")
    second = tmp_path / "second"
    shutil.copytree(first, second)
    records = pd.read_parquet(second / "records.parquet")
    records.loc[records["method"] == "splat", "ssim"] += 0.01
    overwrite(second, records)
    return first, second


def rows_of(folder):
    with (folder / "differences.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_two_runs(command, two_runs):
    first, second = two_runs
    status, out, err = command("compare", str(first), str(second), "--metric", "ssim")
    assert status == 0
    folder = second / "comparisons" / "first-second"
    assert err.endswith(f"written to {folder}\n")
    assert out.startswith(
        f"# {second} against {first}, scored against the true mesh in its colours\n"
    )
    assert (folder / "differences.md").read_text() + "\n" == out
    for row in rows_of(folder):
        expected = 0.01 if row["method_a"] == "splat" else 0.0
        assert float(row["difference"]) == pytest.approx(expected, abs=2e-6)
        assert (row["run_a"], row["run_b"]) == (str(first), str(second))
    made = {f"differences.{form}" for form in ("csv", "md", "png", "svg")}
    assert {path.name for path in folder.iterdir()} == made


@pytest.mark.usefixtures("few_objects")
def test_objects_without_a_value_are_left_out_and_counted(command, two_runs):
    """Of the objects one has no thin part: neither its recall nor its blank image's is a number."""
    for folder, recall in zip(two_runs, (0.4, 0.7), strict=True):
        records = pd.read_parquet(folder / "records.parquet")
        records["thin_recall"] = np.where(records["method"] == "blank", 0.0, recall)
        records.loc[records["object"] == records["object"].iloc[0], "thin_recall"] = math.nan
        overwrite(folder, records)
    asked = ("--metric", "thin-recall", "--methods", "splat")
    assert command("compare", *map(str, two_runs), *asked)[0] == 0
    objects = records["object"].nunique()
    for row in rows_of(two_runs[1] / "comparisons" / "first-second"):
        values = [
            float(row[name]) for name in ("value_a", "value_b", "difference", "ci_low", "ci_high")
        ]
        assert values == pytest.approx([0.4, 0.7, 0.3, 0.3, 0.3])
        assert int(row["objects"]) == objects - 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("compare", "first"),
            "one run is compared by two methods; give --methods a,b",
        ),
        (
            ("compare", "first", "--methods", "splat,nope"),
            "--methods nope: cannot be compared here; ",
        ),
        (
            ("compare", "first", "--methods", "splat,blank", "--metric", "x"),
            "--metric x: cannot be compared here; ",
        ),
        (("compare", "nowhere"), "nowhere: no such folder; give a run's folder\n"),
        *(
            (arguments, "empty: a run without objects; start it again with its command\n")
            for arguments in (
                ("compare", "empty", "--methods", "blank,splat"),
                ("compare", "first", "empty"),
                ("table", "empty"),
                ("report", "empty"),
            )
        ),
    ],
)
def test_what_cannot_be_asked(command, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    for name in ("first", "empty"):
        write_run(tmp_path / name)
    write_manifest(tmp_path / "empty", read_manifest(tmp_path / "empty") | {"objects": []})
    status, out, err = command(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"bench: {message}")


TRUTHS = (
    "different truths: first is scored against the true mesh in its colours, second against the "
    "true mesh in grey; give both the same --truth\n"
)


@pytest.mark.parametrize(
    ("manifest", "change", "message"),
    [
        (
            {"objects": ["chair/b", "chair/c"]},
            lambda r: r[r["object"] != "a"],
            "different objects: only ",
        ),
        ({}, lambda r: r[r["view"] == 0], "different views: "),
        ({}, lambda r: r.assign(azimuth_deg=r["azimuth_deg"] + 1), "different views: view "),
        ({}, lambda r: r.assign(elevation_deg=r["elevation_deg"] + 1), "different views: view "),
        ({}, lambda r: r.assign(ssim=r["ssim"] + 0.1), "different true images: "),
        ({"truth": "grey"}, lambda r: r, TRUTHS),
    ],
)
def test_runs_that_saw_something_else_are_refused(
    command, two_runs, monkeypatch, manifest, change, message
):
    monkeypatch.chdir(two_runs[0].parent)
    second = two_runs[1]
    write_manifest(second, read_manifest(second) | manifest)
    path = second / "records.parquet"
    overwrite(path.parent, change(pd.read_parquet(path)))
    status, out, err = command("compare", "first", "second", "--metric", "ssim")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"bench: {message}")


def test_methods_of_one_run_alone_are_left_out_with_a_remark(command, two_runs):
    first, second = two_runs
    records = pd.read_parquet(second / "records.parquet")
    overwrite(second, records[records["method"] != "splat"])
    manifest = json.loads((second / "manifest.json").read_text())
    manifest["methods"] = [m for m in manifest["methods"] if m != "splat"]
    (second / "manifest.json").write_text(json.dumps(manifest))
    status, out, _ = command("compare", str(first), str(second), "--metric", "ssim")
    assert status == 0
    assert "Only one of the runs has the methods splat." in out


@pytest.mark.parametrize(
    ("lost", "objects", "remark"),
    [
        (
            ("a", "c"),
            1,
            "2 of class chair left out, as their true images failed",
        ),
        (("", "c"), 2, "1 of class chair left out, as their true images failed"),
        (("b", "b"), 2, ""),
        (("", ""), 3, ""),
    ],
)
def test_objects_of_two_runs_are_paired_by_name(command, two_runs, lost, objects, remark):
    """The second run has the scores of the first; the truth of one object failed in either."""
    scored = pd.read_parquet(two_runs[0] / "records.parquet")
    # The scores of an object are like those of no other.
    scored["ssim"] = scored["object"].map({"a": 0.1, "b": 0.5, "c": 0.9})
    for folder, name in zip(two_runs, lost, strict=True):
        failed = {"outcome": "failed", "reason": "input: no true image", "ssim": math.nan}
        records = scored.copy()
        for column, value in failed.items():
            records.loc[records["object"] == name, column] = value
        overwrite(folder, records)
    status, out, _ = command("compare", *map(str, two_runs), "--metric", "ssim")
    assert status == 0
    assert remark in out
    assert ("left out" in out) == bool(remark)
    rows = rows_of(two_runs[1] / "comparisons" / "first-second")
    assert {(float(row["difference"]), int(row["objects"])) for row in rows} == {(0.0, objects)}


def test_what_has_no_object_in_common_is_no_comparison(refused, two_runs):
    """The true images of both runs have all failed."""
    for folder in two_runs:
        records = pd.read_parquet(folder / "records.parquet")
        records = records.assign(outcome="failed", reason="input: no true image", ssim=math.nan)
        overwrite(folder, records)
    both = ("compare", *map(str, two_runs), "--metric", "ssim")
    assert "so nothing is compared" in refused(*both)
    assert not (two_runs[1] / "comparisons").exists()


@pytest.mark.parametrize(
    ("lead", "ahead"),
    [
        ((0.2, 0.1, 0.3), "b"),
        ((-0.2, -0.3, -0.1), "a"),
        ((0.1, -0.1, 0.3), "tie"),
        ((0.1, 4e-6, 0.2), "tie"),  # sums in another order differ by as much
        ((-0.1, -0.2, -4e-6), "tie"),
        ((0.1, math.nan, math.nan), "unknown"),
    ],
)
def test_a_side_is_ahead_by_an_interval_that_leaves_out_0(lead, ahead):
    assert who_is_ahead(Estimate(*lead)) == ahead
