"""Paired differences: closed forms, corrected p values, and the command on stored runs."""

from __future__ import annotations

import csv
import json
import math
import shutil
import tracemalloc
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t, ttest_1samp

from bench.analysis.comparison import Estimate, Quality
from bench.analysis.paired import (
    ComparedPair,
    Side,
    fewest_objects,
    holm,
    paired_differences,
    sign_flip_p,
)
from bench.records.run_folder import read_manifest, write_manifest
from data_prep.datasets.protocol_version import PROTOCOL_VERSION

from ..builders import overwrite, write_run
from ..conftest import on_terminal

A, B = Side("r", "a"), Side("r", "b")
NONE = Estimate(math.nan, math.nan, math.nan)


def pair(a, b, metric="ssim", values=None):
    a, b = np.asarray(a, float), np.asarray(b, float)
    at = values or (a.mean(), b.mean())
    qualities = (
        Quality(metric, NONE._replace(value=float(v)), per_object)
        for v, per_object in zip(at, (a, b), strict=True)
    )
    return ComparedPair("2048", "chair", A, B, *qualities, len(a))


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
    leave_one_out = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.98, 1.0])
    (cell,) = paired_differences([pair(leave_one_out, 3 * leave_one_out, "fd-views", (1.0, 3.0))])
    error = math.sqrt(7 / 8 * np.sum((2 * leave_one_out - 2) ** 2))
    reach = t.ppf(0.975, 7) * error
    assert cell.difference == pytest.approx((2.0, 2.0 - reach, 2.0 + reach))
    assert cell.p == pytest.approx(2 * t.sf(2.0 / error, 7))
    assert cell.ahead == "a"


@pytest.mark.parametrize("metric", ["ssim", "fd-views"])
def test_with_its_sides_exchanged_a_difference_has_its_interval_turned(metric):
    """The objects' differences are skewed, so that no interval is its own mirror image."""
    a = np.linspace(0.5, 0.6, 12)
    b = a + 0.02 * np.arange(12) ** 2 / 50
    (cell,) = paired_differences([pair(a, b, metric, (0.5, 1.5))])
    (exchanged,) = paired_differences([pair(b, a, metric, (1.5, 0.5))])
    value, low, high = cell.difference
    assert low < value < high
    assert exchanged.difference == pytest.approx((-value, -high, -low), rel=1e-12)
    assert {cell.ahead, exchanged.ahead} == {"a", "b"}
    assert exchanged.p == pytest.approx(cell.p, rel=1e-12)


def test_ties_and_what_cannot_be_known():
    a = np.linspace(0.5, 0.7, 8)
    difference = np.array([0.1] * 6 + [-0.1] * 2)
    some, same, few = paired_differences(
        [pair(a, a + difference), pair(a, a), pair(a[:7], a[:7] + 0.1)]
    )
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
    assert {cell.ahead for cell in cells} == {"unknown"}
    assert {cell.objects_needed for cell in cells} == {9}  # 2^-8 x 7 is .027


@pytest.mark.parametrize(
    ("cells", "objects"), [(1, 8), (6, 8), (10, 9), (18, 10), (66, 12), (253, 14), (1128, 16)]
)
def test_the_fewest_objects_that_can_decide(cells, objects):
    """The smallest n, at least 8, with 2^(1-n) cells < .05."""
    assert fewest_objects(cells) == objects
    a = np.linspace(0.5, 0.6, objects)
    assert {cell.ahead for cell in paired_differences([pair(a, a + 0.1)] * cells)} == {"b"}


def test_too_few_objects_are_no_tie():
    a = np.linspace(0.5, 0.7, 8)
    difference = np.array([0.1] * 6 + [-0.1] * 2)
    cells = paired_differences(
        [*[pair(a, a + difference)] * 9, pair(a, a), pair(a[:7], a[:7] + 0.1)]
    )
    # 11 cells when all have enough objects: 2^-8 x 11 is .043
    assert [cell.ahead for cell in cells] == ["unknown"] * 9 + ["tie", "unknown"]
    assert [cell.objects_needed for cell in cells] == [9] * 9 + [None, 9]


def test_frechet_distances_have_no_floor():
    """Their p values are of Student's distribution: eight objects decide among any number."""
    leave_one_out = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.98, 1.0])
    distance = pair(leave_one_out, 1000 + leave_one_out, "fd-views", (1.0, 1001.0))
    few = pair(leave_one_out[:7], leave_one_out[:7], "fd-views", (1.0, 1.0))
    image = pair(leave_one_out / 2, leave_one_out / 2 + 0.1)
    cells = paired_differences([distance, image, few] * 9)
    assert [cell.ahead for cell in cells[:3]] == ["a", "unknown", "unknown"]
    assert [cell.objects_needed for cell in cells[:3]] == [None, 11, 8]  # 2^-10 x 27 is .026


def test_up_to_16_objects_all_signs_are_counted():
    """All but the two smallest of 16 alike: 2 (1 + 16 + ...) signs at least as extreme, counted."""
    differences = np.array([1.0, 2.0, *np.linspace(3.0, 9.0, 14)])
    differences[0] *= -1
    # At least as extreme: none turned, or the smallest alone; each with its negative.
    assert sign_flip_p(differences) == 4 / 2**16
    assert sign_flip_p(np.arange(1.0, 17)) == 2 / 2**16


def test_at_their_floor_random_signs_give_way_to_students_p():
    """17 and 40 alike signs; of 9,999 random ones none is as extreme, which says p < 2e-4 only."""
    for count, spread in ((17, 0.3), (40, 0.6)):
        differences = 1 + spread * np.linspace(-1, 1, count)
        error = differences.std(ddof=1) / math.sqrt(count)
        student = 2 * t.sf(differences.mean() / error, count - 1)
        assert sign_flip_p(differences) == max(student, 2.0 ** (1 - count))
    assert sign_flip_p(np.ones(20)) == 2.0**-19
    # Student's p of a long tail is large: the signs alone show more.
    assert sign_flip_p(np.array([1e3, *[1.0] * 19])) == 2e-4


def test_rows_are_tested_each_for_itself():
    rows = np.random.default_rng(2).normal(0.2, 1, (5, 24))
    assert sign_flip_p(rows).tolist() == [float(sign_flip_p(row)) for row in rows]


@pytest.fixture
def two_runs(tmp_path):
    """A run, and a copy in which each splat has an SSIM higher by 0.01."""
    first = write_run(tmp_path / "first")
    second = tmp_path / "second"
    shutil.copytree(first, second)
    records = pd.read_parquet(second / "records.parquet")
    records.loc[records["method"] == "splat", "ssim"] += 0.01
    overwrite(second / "records.parquet", records)
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
        overwrite(folder / "records.parquet", records)
    asked = ("--metric", "thin-recall", "--methods", "splat")
    assert command("compare", *map(str, two_runs), *asked)[0] == 0
    objects = records["object"].nunique()
    for row in rows_of(two_runs[1] / "comparisons" / "first-second"):
        values = [
            float(row[name]) for name in ("value_a", "value_b", "difference", "ci_low", "ci_high")
        ]
        assert values == pytest.approx([0.4, 0.7, 0.3, 0.3, 0.3])
        assert int(row["objects"]) == objects - 1


def test_help_names_the_metrics_that_are_compared(command, two_runs):
    first, second = two_runs
    assert command("compare", first, second)[0] == 0
    compared = [row["metric"] for row in rows_of(second / "comparisons" / "first-second")]
    assert list(dict.fromkeys(compared)) == ["ssim-object", "lpips"]
    _, out, _ = command("compare", "--help")
    assert "Default: ssim-object, lpips." in " ".join(out.split())


def test_formats_that_are_asked_for(command, two_runs):
    asked = ("compare", two_runs[0], "--methods", "blank,splat", "--format")
    assert command(*asked, "text")[1].startswith("splat against blank, 3 chairs, paired by chair\n")
    _, out, _ = command(*asked, "csv")
    folder = two_runs[0] / "comparisons" / "blank-splat"
    assert out == (folder / "differences.csv").read_text()
    (table,) = json.loads(command(*asked, "json")[1])
    assert [row["metric"] for row in table["rows"]] == [row["metric"] for row in rows_of(folder)]


@pytest.mark.parametrize("columns", [80, 20])
def test_a_terminal_is_answered_in_text(two_runs, columns):
    """The verdict is the last line, and no line is wider than the terminal."""
    printed = on_terminal(columns, "compare", two_runs[0], "--methods", "blank,splat")
    assert max(map(len, printed)) <= columns
    words = " ".join(" ".join(printed).split())
    assert words.startswith("splat against blank, 3 chairs, paired by chair ")
    assert words.endswith(" 3 chairs decide nothing here: at least 8 are needed.")


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
                ("recommend", "empty", "--budget-ms", "9"),
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


def test_two_methods_of_a_run(command, two_runs, tmp_path):
    first, out = two_runs[0], tmp_path / "here"
    write_manifest(first, read_manifest(first) | {"truth": "grey"})
    chosen = ("--methods", "splat,blank", "--metric", "ssim", "--out", str(out))
    status, printed, _ = command("compare", str(first), *chosen)
    assert status == 0
    assert printed.startswith("# blank against splat, scored against the true mesh in grey\n")
    rows = rows_of(out)
    assert {(row["method_a"], row["method_b"]) for row in rows} == {("splat", "blank")}
    records = pd.read_parquet(first / "records.parquet")
    mean = records.groupby(["method", "condition"])["ssim"].mean()
    for row in rows:
        expected = mean["blank", row["condition"]] - mean["splat", row["condition"]]
        assert float(row["difference"]) == pytest.approx(expected, abs=2e-6)


TRUTHS = (
    "different truths: first is scored against the true mesh in its colours, second against the "
    "true mesh in grey; give both the same --truth\n"
)


@pytest.mark.parametrize(
    ("manifest", "change", "message"),
    [
        ({}, lambda r: r[r["object"] != r["object"].iloc[0]], "different objects: only "),
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
    overwrite(path, change(pd.read_parquet(path)))
    status, out, err = command("compare", "first", "second", "--metric", "ssim")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"bench: {message}")


def test_runs_of_one_older_protocol_are_compared(command, two_runs):
    older = PROTOCOL_VERSION - 1
    for run in two_runs:
        write_manifest(run, read_manifest(run) | {"protocol": older})
    remark = f"All is of protocol {older}; this version has protocol {older + 1}."
    for arguments in (two_runs, (two_runs[0], "--methods", "splat,blank")):
        status, out, _ = command("compare", *arguments)
        assert (status, remark in out) == (0, True)


def test_methods_of_one_run_alone_are_left_out_with_a_remark(command, two_runs):
    first, second = two_runs
    records = pd.read_parquet(second / "records.parquet")
    overwrite(second / "records.parquet", records[records["method"] != "splat"])
    manifest = json.loads((second / "manifest.json").read_text())
    manifest["methods"] = [m for m in manifest["methods"] if m != "splat"]
    (second / "manifest.json").write_text(json.dumps(manifest))
    status, out, _ = command("compare", str(first), str(second), "--metric", "ssim")
    assert status == 0
    assert "Only one of the runs has the methods splat." in out


@pytest.mark.parametrize("shape", ["normal", "skewed", "two values"])
def test_random_signs_and_student_agree_where_they_meet(shape):
    """Student's p value stands alone from 401 objects on; the signs of 400 say the same."""
    rng = np.random.default_rng(5)
    drawn = {
        "normal": rng.normal(size=(6, 401)),
        "skewed": rng.exponential(size=(6, 401)) - 1.0,
        "two values": rng.choice([-1.0, 1.0], size=(6, 401)),
    }[shape]
    # p values between .6 and .001, by means 0.5 to 3.3 standard errors from 0
    scaled = (drawn - drawn.mean(axis=1, keepdims=True)) / drawn.std(axis=1, keepdims=True)
    rows = scaled + np.linspace(0.5, 3.3, 6)[:, None] / 20
    student = sign_flip_p(rows)
    assert student == pytest.approx(ttest_1samp(rows, 0, axis=1).pvalue, rel=1e-9)
    flipped = sign_flip_p(rows[:, :400])
    expected = ttest_1samp(rows[:, :400], 0, axis=1).pvalue
    # 9,999 signs know p / 2 = q to sqrt(q / 10000), doubled: five of these. The two distributions
    # differ by the excess kurtosis over n, at most 9 / 400, times a density of at most 0.25 a side.
    close = 5 * 2 * np.sqrt(expected / 2 / 10_000) + 0.5 * 9 / 400
    assert (np.abs(flipped - expected) < close).all()
    assert len(set(flipped.tolist())) == 6


def test_the_p_value_of_many_objects_takes_little_memory():
    rows = np.random.default_rng(6).normal(0.02, size=(1, 44_000))
    tracemalloc.start()
    p = sign_flip_p(rows)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert p == pytest.approx(ttest_1samp(rows, 0, axis=1).pvalue, rel=1e-9)
    assert peak < 4 * rows.nbytes
    assert sign_flip_p(np.zeros(401)) == 1.0
