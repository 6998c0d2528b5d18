"""Paired differences: closed forms, corrected p values, and the command on stored runs."""

from __future__ import annotations

import csv
import json
import math
import shutil
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtr
from scipy.stats import t

from bench.analysis.comparison import Estimate, Quality
from bench.analysis.paired import Pair, Side, holm, paired_differences, sign_flip_p
from bench.records.journal import read_manifest, write_manifest

from ..builders import write_run

A, B = Side("r", "a"), Side("r", "b")
NONE = Estimate(math.nan, math.nan, math.nan)


def pair(a, b, metric="ssim", values=None):
    a, b = np.asarray(a, float), np.asarray(b, float)
    at = values or (a.mean(), b.mean())
    qualities = (
        Quality(metric, NONE._replace(value=float(v)), per_object)
        for v, per_object in zip(at, (a, b), strict=True)
    )
    return Pair("2048", "chair", A, B, *qualities, len(a))


def test_all_signs_of_few_objects_are_counted():
    """By their definition: the share of signs whose mean is as far from 0 as the observed one."""
    differences = np.array([0.3, -0.1, 0.25, 0.4, 0.05, 0.2])
    means = [np.mean(differences * signs) for signs in product((1, -1), repeat=6)]
    above = np.mean([mean >= differences.mean() - 1e-12 for mean in means])
    assert sign_flip_p(differences) == pytest.approx(2 * above, abs=1e-12)


def test_alike_signs_give_the_smallest_p():
    assert sign_flip_p(np.arange(1.0, 6)) == 2 / 2**5
    assert sign_flip_p(np.arange(1.0, 11)) == 2 / 2**10
    assert sign_flip_p(np.zeros(30)) == 1.0


def test_of_many_objects_random_signs_agree_with_the_normal_approximation():
    """40 differences of standard deviation 1: for their mean m, p is about 2 (1 - Phi(m sqrt 40)).

    Four standard errors of 9,999 resamples at p = 0.1: 4 x 2 x 0.0022, and less of the rest.
    """
    spread = np.random.default_rng(3).normal(size=40)
    centred = (spread - spread.mean()) / spread.std()
    differences = centred + 1.645 / math.sqrt(40)
    z = differences.mean() / math.sqrt(np.mean(differences**2) / 40)
    assert sign_flip_p(differences) == pytest.approx(2 * (1 - ndtr(z)), abs=0.018)


def test_holm_by_hand():
    """Sorted .01 .03 .04: times 3, 2, 1, and never below the one before."""
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    corrected = holm([math.nan, 0.6, 0.5])
    assert math.isnan(corrected[0])
    assert corrected[1:] == [1.0, 1.0]
    assert holm([]) == []


def test_the_difference_is_b_less_a_and_the_better_side_is_named():
    a = np.linspace(0.5, 0.6, 12)
    (cell,) = paired_differences([pair(a, a + 0.1)])
    assert cell.difference == pytest.approx((0.1, 0.1, 0.1))
    assert (cell.ahead, cell.pair.objects, cell.p) == ("b", 12, 2 / 2**12)
    (cell,) = paired_differences([pair(a, a - 0.1)])
    assert cell.ahead == "a"


def test_distances_are_better_the_smaller_they_are():
    """Jackknife: standard error sqrt((g - 1) / g sum (d - mean)^2) of the jackknife differences."""
    left_out = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.98, 1.0])
    (cell,) = paired_differences([pair(left_out, 3 * left_out, "fd-views", (1.0, 3.0))])
    error = math.sqrt(7 / 8 * np.sum((2 * left_out - 2) ** 2))
    reach = t.ppf(0.975, 7) * error
    assert cell.difference == pytest.approx((2.0, 2.0 - reach, 2.0 + reach))
    assert cell.p == pytest.approx(2 * t.sf(2.0 / error, 7))
    assert cell.ahead == "a"


def test_ties_and_what_cannot_be_known():
    a = np.linspace(0.5, 0.7, 8)
    lead = np.array([0.1] * 6 + [-0.1] * 2)
    some, same, few = paired_differences([pair(a, a + lead), pair(a, a), pair(a[:7], a[:7] + 0.1)])
    # at least six of eight signs alike, both ways: 2 (28 + 8 + 1) / 2^8
    assert (some.ahead, some.p, some.p_holm) == ("tie", 74 / 256, 148 / 256)
    assert (same.ahead, same.p) == ("tie", 1.0)
    assert few.ahead == "unknown"
    assert math.isnan(few.p_holm)


def test_p_values_are_corrected_for_all_cells_together():
    a = np.linspace(0.5, 0.6, 8)
    (alone,) = paired_differences([pair(a, a + 0.1)])
    assert alone.ahead == "b"  # p = 1/128
    cells = paired_differences([pair(a, a + 0.1)] * 7)
    assert {cell.p_holm for cell in cells} == {7 / 128}
    assert {cell.ahead for cell in cells} == {"tie"}


@pytest.fixture
def two_runs(tmp_path):
    """A run, and a copy in which each splat has an SSIM higher by 0.01."""
    first = write_run(tmp_path / "first")
    second = tmp_path / "second"
    shutil.copytree(first, second)
    records = pd.read_parquet(second / "records.parquet")
    records.loc[records["method"] == "splat", "ssim"] += 0.01
    records.to_parquet(second / "records.parquet")
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
    assert out.startswith(f"# {second} against {first}\n")
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
        records.to_parquet(folder / "records.parquet")
    asked = ("--metric", "thin-recall", "--methods", "splat")
    assert command("compare", *map(str, two_runs), *asked)[0] == 0
    objects = records["object"].nunique()
    for row in rows_of(two_runs[1] / "comparisons" / "first-second"):
        values = [
            float(row[name]) for name in ("value_a", "value_b", "difference", "ci_low", "ci_high")
        ]
        assert values == pytest.approx([0.4, 0.7, 0.3, 0.3, 0.3])
        assert int(row["objects"]) == objects - 1


def test_two_methods_of_a_run(command, two_runs, tmp_path):
    first, out = two_runs[0], tmp_path / "here"
    chosen = ("--methods", "splat,blank", "--metric", "ssim", "--out", str(out))
    assert command("compare", str(first), *chosen)[0] == 0
    rows = rows_of(out)
    assert {(row["method_a"], row["method_b"]) for row in rows} == {("splat", "blank")}
    records = pd.read_parquet(first / "records.parquet")
    mean = records.groupby(["method", "condition"])["ssim"].mean()
    for row in rows:
        expected = mean["blank", row["condition"]] - mean["splat", row["condition"]]
        assert float(row["difference"]) == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r[r["object"] != r["object"].iloc[0]], "different objects: only "),
        (lambda r: r[r["view"] == 0], "different views: "),
        (lambda r: r.assign(azimuth_deg=r["azimuth_deg"] + 1), "different views: view "),
        (lambda r: r.assign(ssim=r["ssim"] + 0.1), "different true images: "),
    ],
)
def test_runs_that_saw_something_else_are_refused(command, two_runs, change, message):
    first, second = two_runs
    change(pd.read_parquet(second / "records.parquet")).to_parquet(second / "records.parquet")
    status, out, err = command("compare", str(first), str(second), "--metric", "ssim")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"bench: {message}")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "one run is compared by two methods; give --methods a,b or a second folder"),
        (("--methods", "splat,nope"), "--methods nope: cannot be compared here; there are "),
        (("--methods", "splat,blank", "--metric", "x"), "--metric x: cannot be compared here; "),
    ],
)
def test_what_one_run_cannot_be_asked(command, two_runs, arguments, message):
    status, out, err = command("compare", str(two_runs[0]), *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_runs_of_two_versions_of_the_protocol_are_refused(command, two_runs):
    first, second = two_runs
    write_manifest(second, read_manifest(second) | {"protocol": 2})
    status, _, err = command("compare", str(first), str(second))
    assert status == 2
    assert err == (
        f"bench: different protocols: {first} has 1, {second} has 2; run both with one version "
        "('bench --protocol')\n"
    )


def test_methods_of_one_run_alone_are_left_out_with_a_remark(command, two_runs):
    first, second = two_runs
    records = pd.read_parquet(second / "records.parquet")
    records[records["method"] != "splat"].to_parquet(second / "records.parquet")
    manifest = json.loads((second / "manifest.json").read_text())
    manifest["methods"] = [m for m in manifest["methods"] if m != "splat"]
    (second / "manifest.json").write_text(json.dumps(manifest))
    status, out, _ = command("compare", str(first), str(second), "--metric", "ssim")
    assert status == 0
    assert "Only one of the runs has the methods splat." in out
