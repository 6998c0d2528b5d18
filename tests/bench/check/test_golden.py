from __future__ import annotations

import re
from dataclasses import replace

import pandas as pd
import pytest

from bench.analysis.run import read_run
from bench.catalogue.chosen import BEST_CLASSICAL
from bench.catalogue.lookup import find
from bench.catalogue.methods import FLOORS
from bench.catalogue.suites import SUITES, with_truth
from bench.check.golden import check, golden_lines
from bench.check.golden_values import GOLDEN as GOLDEN_FOLDER
from bench.check.golden_values import golden, golden_name
from bench.check.tolerances import JUDGED, OF_CLASSES, RECONSTRUCTION, RENDERING, tolerance
from bench.records.folder import read_manifest, write_manifest
from bench.tables.build import tables, write_outputs
from bench.tables.grid import row_mappings

from ..builders import SUITE, overwrite, write_run, write_run_with_tables

HEADLINE = ("ssim-object", "lpips")
SSIM, DETAIL = SUITES[0].image_metrics, SUITES[0].detail_metrics
DISTANCES = ("fd-views", "fd-views-grey", "fd-alexnet")  # fid and kid are skipped
KERNEL = "kd-alexnet"
MOST_PSNR = 95.046216  # 20 log10(255) + 10 log10(128 * 128 * 3), to the 6 decimals of the file
IDEAL = dict.fromkeys((*DISTANCES, "lpips"), 0.0) | {"psnr": MOST_PSNR}  # any other metric: 1
CONTROL = SUITES[0].control_metrics
GOLDEN = (*DETAIL, *SSIM, *DISTANCES, KERNEL, *CONTROL)
OBJECT_VALUES = 3 * len((*SSIM, *DETAIL))  # of a method at a condition
SAME = (
    "same environment as the golden values: means of objects are compared to the last digit, "
    "images to the last bit"
)


def alter_records(run, column, change, method="splat", condition="512"):
    path = run / "records.parquet"
    frame = pd.read_parquet(path)
    chosen = (frame["method"] == method) & (frame["condition"] == condition)
    frame.loc[chosen, column] = change(frame.loc[chosen, column])
    overwrite(path.parent, frame)


def test_a_run_agrees_with_itself_and_so_does_a_part_of_it(run, command, tmp_path):
    part = write_run_with_tables(tmp_path / "part", methods=["true-mesh"], conditions=["512"])
    values, first = len(GOLDEN) + OBJECT_VALUES, 2 * (1 + 3)  # of 2 metrics the mean and 3 objects
    # The run has 3 methods x 2 conditions; golden lines of two methods hold for any condition.
    fewer = "3 of 12 lines of the golden values are compared: this run has no others"
    for directory, times, remarks in ((part, 1, (fewer, SAME)), (run, 6, (SAME,))):
        result = check(directory)
        assert (result.compared, result.headline) == (times * values, times * first)
        assert (result.differing, result.remarks, result.moved) == ((), remarks, ())
    values, first = 6 * values, 6 * first
    said = (
        f"{SAME}\nssim-object and lpips: {first} values, 0 moved; "
        f"others: {values - first} values, 0 moved\n"
        f"{values} golden values compared, 0 moved\n"
    )
    assert command("check", run) == (0, said, "")


def test_a_run_of_which_nothing_is_golden_does_not_pass(run, refused, tmp_path):
    other = write_run_with_tables(tmp_path / "other", methods=["points2pix", "splat-fill"])
    assert refused("check", other) == (
        f"{other}: nothing is compared, for none of its methods and conditions has golden values; "
        f"check a run of 'bench run --suite {SUITE}', or compare this one with itself: 'bench "
        f"check {other} --again 0.05'"
    )


def test_moves_of_the_headline_come_first(run, command):
    for score in ("ssim", "lpips"):
        alter_records(run, score, lambda values: values + 0.25)
    write_outputs(read_run(run))
    status, out, _ = command("check", run)
    assert status == 1
    named = re.findall(r"^moved \(\w+\) (\S+)", out, re.M)
    assert named == ["lpips", "lpips", "ssim", "ssim"]  # the mean and the objects of each
    assert "ssim-object and lpips: 48 values, 2 moved; others: " in out


def test_golden_values_are_the_tables_with_tolerances(run):
    frame = golden(SUITE)
    assert list(frame.columns) == [
        *("protocol", "dataset", "objects", "views", "seed"),
        *("method", "condition", "class", "metric", "value", "tolerance", "reason"),
    ]
    names = ("table3_ssim", "table4_fid", "table_detail", "table_control")
    tables = pd.concat(pd.read_csv(run / "tables" / f"{name}.csv") for name in names)
    tables = tables[tables["metric"].isin(GOLDEN)]
    assert frame["value"].tolist() == tables["value"].tolist()
    assert protocols(frame) == [["procedural", 3, 2, 0]]
    has_the_tolerances_of_its_rules(frame)
    ceiling = frame[(frame["method"] == "true-mesh") & ~frame["metric"].isin((*CONTROL, KERNEL))]
    assert ceiling["tolerance"].max() <= 1e-6


def protocols(frame):
    return frame[["dataset", "objects", "views", "seed"]].drop_duplicates().to_numpy().tolist()


def has_the_tolerances_of_its_rules(frame):
    every = (tolerance(row["method"], row["metric"]) for row in frame.to_dict("records"))
    rules = [rule for rule in every if rule is not None]
    allowed = [r.absolute + r.relative * abs(v) for r, v in zip(rules, frame["value"], strict=True)]
    # value and tolerance are rounded to six digits, each by up to 5e-7
    assert frame["tolerance"].to_numpy() == pytest.approx(allowed, abs=1.1e-6)
    assert frame["reason"].tolist() == [rule.reason for rule in rules]


def test_a_cell_of_two_tables_is_blessed_once_and_with_room_below_zero(run):
    rows = row_mappings(tables(read_run(run))[0].frame)
    below = rows[0] | {"metric": "kd-views", "value": -2.0}
    other = rows[0] | {"method": BEST_CLASSICAL}  # the value of another method
    lines = golden_lines(2 * (*rows, below, other), {"seed": 0})
    assert len(lines) == len(rows) + 1
    (line,) = (line for line in lines if line["metric"] == "kd-views")
    assert (line["value"], line["seed"]) == ("-2.000000", 0)
    rule = OF_CLASSES["kd-views"]
    assert float(line["tolerance"]) == pytest.approx(rule.absolute + 2 * rule.relative, abs=6e-7)


# Methods that joined thirteen-classes after its golden values were made.
WITHOUT_CLASSES = {"alpha-wrap", "denoised-wrap", "occupancy-net", "splat-net@grey"}


@pytest.mark.parametrize("truth", ["coloured", "grey"])
def test_the_golden_values_of_this_project(truth):
    """Every cell of the default run; the ceiling exact, the floor the same whatever the cloud."""
    suite = with_truth(SUITES[0], truth)
    frame = golden(golden_name({"suite": suite.id, "truth": truth}))
    metrics = [m for m in GOLDEN if m != "fd-views" or truth == "coloured"]
    assert protocols(frame) == [["procedural", suite.endless_limit, suite.views, 0]]
    cells = frame[["method", "condition", "class", "metric"]].apply(tuple, axis=1)
    assert sorted(cells) == sorted(
        (method, condition, "chair", metric)
        for method in suite.methods
        for condition in suite.conditions
        for metric in metrics
        if (method, metric) != ("blank", "thin-precision")  # nothing is drawn
    )
    has_the_tolerances_of_its_rules(frame)
    for metric in metrics:
        values = frame[frame["metric"] == metric].set_index("method")["value"]
        if metric not in (*CONTROL, KERNEL):
            assert set(values["true-mesh"]) == {IDEAL.get(metric, 1.0)}
        for floor in FLOORS:
            assert len(set(values.loc[values.index == floor])) <= 1


def test_the_golden_values_of_the_classes():
    """Every class and their average; true images exact but for what only a classifier says."""
    suite = find("thirteen-classes", SUITES, "suite")
    frame = golden(suite.id)
    objects = suite.endless_limit * len(suite.classes)
    assert protocols(frame) == [["procedural", objects, suite.views, 0]]
    by_class = {"fd-views", "kd-views", "fd-alexnet", "kd-alexnet", "class-confidence", "lpips"}
    plain = {"ssim", "luminance", "contrast", "structure", "psnr", "ssim-object", "silhouette-iou"}
    assert set(frame["metric"]) == by_class | plain
    cells = frame[["method", "class", "metric"]]
    assert not cells.duplicated().any()
    for metric in ("ssim", "silhouette-iou", *by_class):
        measured = cells[cells["metric"] == metric].drop(columns="metric").apply(tuple, axis=1)
        methods = {*suite.methods} - WITHOUT_CLASSES
        assert set(measured) >= {(m, c) for m in methods for c in (*suite.classes, "average")}
    true = frame[frame["method"] == "true-mesh"]
    for metric in plain:
        assert set(true.loc[true["metric"] == metric, "value"]) == {IDEAL.get(metric, 1.0)}
    for metric in ("fd-views", "fd-alexnet", "lpips"):
        assert set(true.loc[true["metric"] == metric, "value"]) == {0.0}
    assert true.loc[true["metric"] == "class-confidence", "value"].between(0.7, 1).all()
    has_the_tolerances_of_its_rules(frame)
    assert set(frame.loc[frame["value"] < 0, "metric"]) == {"kd-views", "kd-alexnet"}


@pytest.mark.slow
def test_denser_scanned_and_coloured_clouds_have_their_golden_values(command, tmp_path):
    """The commands of CONTRIBUTING.md give the golden values in a folder elsewhere."""
    options = "--suite beyond-training --truth coloured-clouds --limit 2 --views 4"
    options += " --conditions 2048,8192,32768,three-views,one-side"
    options += " --methods alpha-wrap,splat-fill,splat-net@grey,blank"
    assert command("run", *options.split(), "--out", tmp_path / "clouds")[0] == 0
    status, out, _ = command(
        "check", tmp_path / "clouds", "--golden", GOLDEN_FOLDER / "clouds.json"
    )
    assert (status, "0 moved" in out) == (0, True), out


def test_every_default_metric_has_a_tolerance():
    for table in (RENDERING, RECONSTRUCTION):
        assert {*table, *JUDGED} == set(GOLDEN)
    assert tolerance("splat", "fid") is None
    assert tolerance("true-mesh", "retrieval") == JUDGED["retrieval"]  # it errs even there
    assert tolerance("surface-apss", "ssim") == RECONSTRUCTION["ssim"]
    assert tolerance("surface-apss@resolution=50", "ssim") == RECONSTRUCTION["ssim"]
    for method in ("surface-fit", "surface-bpa"):
        reason = "the tolerance of surface-apss, whose steps it takes"
        assert tolerance(method, "ssim") == replace(RECONSTRUCTION["ssim"], reason=reason)
        assert tolerance(method, "thin-recall") == RECONSTRUCTION["thin-recall"]
    assert tolerance("surface-of-a-stranger", "ssim") == RENDERING["ssim"]
    assert tolerance("pc2pix", "ssim") == RENDERING["ssim"]


@pytest.mark.parametrize(("metric", "sign"), [("ssim", 1), ("fd-views", -1)])
def test_a_value_beyond_its_tolerance_is_a_regression(run, results, command, metric, sign):
    path = results / "golden" / f"{SUITE}.csv"
    frame = pd.read_csv(path, dtype={"condition": str})
    cell = (frame["method"] == "splat") & (frame["condition"] == "512")
    (place,) = frame.index[cell & (frame["metric"] == metric)]
    value, tolerance, reason = frame.loc[place, ["value", "tolerance", "reason"]]

    def move_golden(tolerances):
        frame.loc[place, "value"] = value + sign * tolerances * tolerance
        frame.to_csv(path, index=False)

    move_golden(0.98)
    assert check(run).differing == ()
    move_golden(1.02)
    status, out, err = command("check", run)
    assert (status, err) == (1, "")
    remark, verdict, parts, total = out.splitlines()
    assert remark == SAME
    of_headline = int(metric in HEADLINE)
    assert re.findall(r"(\d) moved", parts) == [f"{of_headline}", f"{1 - of_headline}"]
    assert verdict.startswith(f"moved (worse) {metric} of splat at 512: {value:.6f}, golden ")
    moved = value + sign * 1.02 * tolerance
    assert float(verdict.split("golden ")[1].split()[0]) == pytest.approx(moved, abs=2e-6)
    assert verdict.endswith(f"+- {tolerance:.6f} ({reason})")
    compared = 6 * (len(GOLDEN) + OBJECT_VALUES)
    assert total == f"{compared} golden values compared, 1 moved"


@pytest.mark.parametrize(
    ("harm", "metrics"),
    [
        ({"structure": float("nan")}, ["structure"]),
        ({"outcome": "failed"}, (*SSIM, *DISTANCES, KERNEL, *DETAIL, *CONTROL)),
    ],
)
def test_a_value_that_is_gone_is_a_regression(run, harm, metrics):
    path = run / "records.parquet"
    frame = pd.read_parquet(path)
    of_cell = (frame["method"] == "splat") & (frame["condition"] == "512")
    frame.loc[of_cell, [*harm]] = [*harm.values()]
    overwrite(path.parent, frame)
    write_outputs(read_run(run))
    lines = check(run).differing
    assert all(", golden " in line for line in lines)
    by_object = [line.split(" of ")[0] for line in lines if "objects moved" in line]
    assert by_object == [metric for metric in (*SSIM, *DETAIL) if metric in metrics]
    lines = [line for line in lines if "objects moved" not in line]
    assert [line.split(",")[0] for line in lines] == [
        f"{metric} of splat at 512: no value" for metric in metrics
    ]


@pytest.mark.parametrize(
    ("harm", "name"), [("altered", "table3_ssim.csv"), ("missing", "table4_fid.md")]
)
def test_table_files_have_to_say_what_the_records_say(run, command, harm, name):
    path = run / "tables" / name
    if harm == "missing":
        path.unlink()
    else:
        path.write_text(path.read_text().replace("0.", "0.9", 1))
    status, out, _ = command("check", run)
    assert status == 1
    assert out.splitlines()[1] == (
        f"DIFFERS {path}: not what the records give; 'bench table {run}' restores it"
    )
    assert command("table", run)[0] == 0
    assert command("check", run)[0] == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dataset": "folder:x"}, "dataset folder:x (golden: procedural)"),
        ({"views": 3}, "views 3 (golden: 2)"),
        ({"seed": 1}, "seed 1 (golden: 0)"),
        ({"objects": ["chair/x", "chair/y"]}, "none of its objects is golden"),
        ({"seed": 1, "views": 3}, "views 3 (golden: 2), seed 1 (golden: 0)"),
    ],
)
def test_another_protocol_cannot_be_compared(tmp_path, run, refused, change, message):
    other = write_run(tmp_path / "other", **change)
    assert refused("check", other) == (
        f"{other}: no golden values for this protocol: {message}; "
        f"check a run of 'bench run --suite {SUITE}' with its defaults"
    )


def test_another_truth_has_golden_values_of_its_own(tmp_path, run, results, command, refused):
    grey = write_run_with_tables(tmp_path / "grey", truth="grey")
    assert refused("check", grey) == (
        f"{results}/golden/{SUITE}-grey.csv: no golden values for '{SUITE}-grey'; "
        "'bench check DIR --again 0.05' compares a run with itself"
    )
    part = write_run_with_tables(tmp_path / "part", truth="grey", conditions=["512"])
    assert refused("check", part, "--bless", results / "golden") == (
        f"{part}: golden values are of the whole default run, this one has no conditions 2048; "
        f"run 'bench run --suite {SUITE} --truth grey' and give its folder"
    )
    assert command("check", grey, "--bless", results / "golden")[0] == 0
    written = {path.name.partition(".")[0] for path in (results / "golden").iterdir()}
    assert written == {
        f"{SUITE}{truth}{part}" for truth in ("", "-grey") for part in ("", "-objects")
    }
    status, out, _ = command("check", part)
    assert status == 0
    assert out.endswith("golden values compared, 0 moved\n")
    alter_records(grey, "ssim", lambda values: values + 0.25)
    write_outputs(read_run(grey))
    status, out, _ = command("check", grey)
    assert status == 1
    assert "2 moved" in out
    assert ") ssim of splat at 512" in out
    assert check(run).differing == ()
    said = refused("check", "--claims", grey)
    assert "the paper's claims are about images in colours; give a run without --truth" in said


def test_without_golden_values_or_a_run(tmp_path, results, refused):
    directory = write_run(tmp_path / "run")
    (tmp_path / "file").touch()
    none = (
        f"{results}/golden/{SUITE}.csv: no golden values for '{SUITE}'; "
        "'bench check DIR --again 0.05' compares a run with itself"
    )
    no_run = "{}: no run here (manifest.json is missing); give a run's folder"
    no_folder = "{}: no such folder; give a run's folder"
    for path, message in [
        (directory, none),
        (tmp_path / "file", no_run),
        *((tmp_path / name, no_folder) for name in ("nowhere", "results")),
    ]:
        assert refused("check", path) == message.format(path)


@pytest.mark.parametrize(
    "arguments", [["check"], ["check", "--bless", "x.json"], ["table"], ["report"]]
)
def test_a_run_that_was_stopped_has_no_verdict(run, refused, arguments):
    write_manifest(run, read_manifest(run) | {"finished": None})
    said = f"{run}: the run is not finished; start it again with its command"
    assert refused(*arguments, run) == said


def test_without_golden_values_by_object_the_run_has_to_be_whole(tmp_path, run, results, refused):
    for path in results.glob("golden/*-objects.*"):
        path.unlink()
    result = check(run)
    assert (result.compared, result.headline) == (6 * len(GOLDEN), 6 * 2)
    assert result.differing == result.remarks == ()
    part = write_run(tmp_path / "part", objects=["chair/a", "chair/b"])
    said = refused("check", part)
    assert "no golden values for this protocol: objects 2 (golden: 3); " in said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 5}, "seed 5 (default: 0)"),
        ({"dataset": "folder:x"}, "dataset folder:x (default: procedural)"),
        ({"objects": ["chair/a"]}, "objects 1 (default: 3)"),
        ({"views": 3, "methods": ["blank"]}, "views 3 (default: 2); no methods splat, true-mesh"),
        ({"conditions": ["2048", "1024"]}, "no conditions 512; also conditions 1024"),
    ],
)
def test_bless_needs_the_whole_default_run(tmp_path, run, results, refused, change, message):
    before = {path: path.read_bytes() for path in results.glob("golden/*")}
    other = write_run(tmp_path / "other", **change)
    assert refused("check", other, "--bless", results / "golden") == (
        f"{other}: golden values are of the whole default run, this one has {message}; "
        f"run 'bench run --suite {SUITE}' and give its folder"
    )
    assert {path: path.read_bytes() for path in results.glob("golden/*")} == before
