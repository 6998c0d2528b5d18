from __future__ import annotations

import re
import shlex

import numpy as np
import pytest

import bench.rendering.shrink
from bench.catalogue.suites import STABILITY, SUITES
from bench.records.run_folder import write_manifest
from bench.rendering.shrink import find_failed_job, shrink
from bench.rendering.shrink_result import fails_alike
from bench.running.isolation import TaskPool
from bench.running.work import cloud_of
from bench.suites.stability.cases import CASES
from data_prep.clouds.conditions import Stride
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput
from data_prep.files.clouds import load_points
from data_prep.scene import View

from ..builders import make_failed, make_manifest, make_record, write_all


def write_failures(directory, *records, **changes):
    """A finished run, of two objects, with these records."""
    directory.mkdir(parents=True)
    manifest = {"objects": ["chair/test-0000", "chair/test-0001"], "device": "auto"} | changes
    write_manifest(directory, make_manifest(**manifest))
    write_all(directory, records)
    return directory


def failed_item(directory, method, reason, condition="512", obj="test-0001", **changes):
    """A run in which that item has failed; and its name."""
    failures = [make_failed(method, condition, obj, view, reason) for view in range(2)]
    write_failures(directory, *failures, **changes)
    return f"{directory}:{method}/{condition}/chair/{obj}"


def failed_case(directory, method, reason, case):
    records = [make_failed(method, case, "test-0000", 0, reason, suite="stability")]
    write_failures(directory, *records, suite="stability")
    return f"{directory}:{method}/{case}"


def shrunk(record, budget_s=600.0, workers=1, **changes):
    """Return the cloud that is found, after checks of what holds of every one."""
    result = shrink(record, budget_s, workers, None, **changes)
    assert result.points.dtype == np.float32
    assert np.array_equal(load_points(result.path), result.points, equal_nan=True)
    whole = cloud_of(find_failed_job(record).job).points
    assert result.before == len(whole)
    assert {point.tobytes() for point in result.points} <= {point.tobytes() for point in whole}
    return result


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        ("apss: no faces", "apss: no faces", True),
        ("apss: no faces", "ball-pivoting: no faces", False),
        ("draw: 3 of 20 images are blank", "draw: 1 of 1 images are blank", True),
        ("timeout: no result within 120 s", "timeout: no result within 60.5 s", True),
        ("E: at -1e-30 and +2.5E7", "E: at 0 and 1,000", True),
        ("E: shape (2, 128)", "E: shape (1, 64)", True),
        ("E: <A at 0x7f13AE>", "E: <A at 0x12>", True),
        ("E: float32 not float64", "E: float16 not float64", False),
        ("crash: the worker died (SIGUSR1)", "crash: the worker died (SIGUSR2)", False),
        ("crash: the worker died (exit code 7)", "crash: the worker died (SIGSEGV)", False),
        ("", "", False),
        ("", "apss: no faces", False),
    ],
)
def test_reasons_that_differ_in_numbers_only(one, other, alike):
    assert fails_alike(one, other) is alike
    assert fails_alike(other, one) is alike


def test_items_are_planned_again(tmp_path):
    record = failed_item(tmp_path / "run", "splat", "x: y", seed=5, views=3, device="cpu")
    failed = find_failed_job(record)
    assert (failed.directory, failed.reason) == (tmp_path / "run", "x: y")
    assert failed.name == "splat/512/chair/test-0001"
    assert failed.limits == SUITES[0].limits
    job = failed.job
    assert (job.method, job.condition, job.perturbation) == ("splat", "512", Stride(4))
    assert job.object == ProceduralObject("chair", "test", 1)
    assert (job.seed, job.device, len(job.views)) == (5, "cpu", 3)
    assert len(cloud_of(job)) == 512


def test_cases_are_planned_again(tmp_path):
    failed = find_failed_job(failed_case(tmp_path / "run", "splat", "x: y", "outlier-1e6"))
    (case,) = (case for case in CASES if case.id == "outlier-1e6")
    job = failed.job
    assert (job.perturbation, job.views, job.batch) == (case.perturbation, case.views, case.batch)
    assert job.object == ProceduralObject(STABILITY.class_name, "test", STABILITY.index)
    assert cloud_of(job).points[0, 0] == np.float32(1e6)
    assert failed.limits == STABILITY.limits


def test_names_with_colons_and_slashes(tmp_path, tiny_weights):
    """The folder of the run, the weights and the object may all have them."""
    meshes = tmp_path / "meshes"
    for name in ("a:b", "a"):
        (meshes / "chair" / name).mkdir(parents=True)
        (meshes / "chair" / name / "c.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    weights = tmp_path / "w:1" / "tiny.safetensors"
    weights.parent.mkdir()
    weights.write_bytes(tiny_weights.read_bytes())
    method = f"pc2pix@{weights}"
    changes = {"dataset": f"folder:{meshes}", "objects": ["chair/a/c.off", "chair/a:b/c.off"]}
    record = failed_item(tmp_path / "r:1" / "x", method, "x: y", obj="a:b/c.off", **changes)
    write_failures(tmp_path / "r", make_failed("splat"))  # DIR of the first colon: another run
    failed = find_failed_job(record)
    assert failed.directory == tmp_path / "r:1" / "x"
    assert failed.job.method == method
    assert failed.job.object.object_id == "a:b/c.off"


def test_records_that_are_not_there_list_those_that_are(refused, tmp_path):
    records = [make_failed("splat", "512", f"test-{i:04d}") for i in range(11)]
    ok = make_record("splat", "2048", "test-0000")
    run = write_failures(tmp_path / "run", *records, ok)
    names = ", ".join(f"{run}:splat/512/chair/test-{i:04d}" for i in range(10))
    for wrong in (f"{run}", f"{run}:", f"{run}:splat/2048/chair/test-0000", f"{run}:splat/512"):
        message = f"{wrong}: no failed record; there are {names} and 1 more"
        assert refused("shrink", wrong) == message
    ten = write_failures(tmp_path / "ten", *records[:10])
    assert refused("shrink", ten).endswith("/test-0009")
    cases = failed_case(tmp_path / "cases", "splat", "x: y", "0-points")
    message = refused("shrink", f"{tmp_path}/cases:blank/0-points")
    assert message.endswith(f": no failed record; there are {cases}")
    fine = write_failures(tmp_path / "fine", ok)
    assert refused("shrink", f"{fine}").endswith("; nothing has failed in this run")


def test_what_cannot_be_shrunk(refused, tmp_path):
    def item(name, method="splat", **changes):
        return failed_item(tmp_path / name, method, "x: y", **changes)

    gone = item("gone", obj="test-0002")
    for record, message in (
        (
            "nowhere:splat/512/chair/a",
            "nowhere:splat/512/chair/a: no run there; give DIR:METHOD/CONDITION/CLASS/OBJECT, "
            "of the suite stability DIR:METHOD/CASE",
        ),
        (item("mesh", "true-mesh"), "method 'true-mesh' draws the mesh behind a cloud, and "),
        (
            gone,
            "splat/512/chair/test-0002: the dataset procedural has no such object any more; "
            "bring its file back",
        ),
        (
            failed_case(tmp_path / "case", "splat", "x: y", "5-points"),
            "splat/5-points: there is no such case any more; run the suite again",
        ),
    ):
        assert refused("shrink", record).startswith(message)
    assert "the run is not finished" in refused("shrink", item("unfinished", finished=None))
    assert refused("shrink", gone, "--budget-s", "0") == "--budget-s 0: must be more than 0"
    assert refused("shrink", gone, "--workers", "0") == "--workers 0: must be at least 1"
    assert not list(tmp_path.rglob("minimal.ply"))


@pytest.mark.slow
def test_an_object_that_is_at_fault_itself(refused, tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.off").write_text("OFF\n")
    changes = {"dataset": f"folder:{tmp_path / 'meshes'}", "objects": ["meshes/a.off"]}
    failure = make_failed("splat", "512", "a.off", 0, "input: a", class_name="meshes")
    run = write_failures(tmp_path / "run", failure, **changes)
    message = refused("shrink", f"{run}:splat/512/meshes/a.off")
    assert message.startswith("splat/512/meshes/a.off: its cloud cannot be made (input: ")
    assert message.endswith("); it is the object that is at fault, not the method")


@pytest.mark.slow
def test_two_points_that_are_needed_are_found_by_any_number_of_workers(
    plugins, tmp_path, monkeypatch
):
    pools = []

    def counted(*arguments):
        pools.append(TaskPool(*arguments))
        return pools[-1]

    monkeypatch.setattr(bench.rendering.shrink, "TaskPool", counted)
    reason = "weigh: 7 points left and 8 right"
    record = failed_item(tmp_path / "run", "fake-left-and-right", reason)
    result = shrunk(record)
    assert len(pools) == 1  # all trials share their workers
    assert result.before == 512
    assert sorted(result.points[:, 0] > 0) == [False, True]
    assert (np.abs(result.points[:, 0]) > 0.2).all()
    assert result.reason == result.reproduced == "weigh: 1 points left and 1 right"
    assert result.minimal
    assert result.path == (
        tmp_path / "run/shrunk/fake-left-and-right-512-chair-test-0001/minimal.ply"
    )
    first = find_failed_job(record).job.views[0]
    assert result.drawing.views == (first,)
    assert result.message.splitlines() == [
        "fake-left-and-right: weigh: 1 points left and 1 right",
        f"512 points became 2 ({result.trials} trials, {result.seconds:.0f} s); "
        "without any one of them it does not fail so",
        f"bench render {result.path} --as-is --method fake-left-and-right "
        f"--azimuth {first.azimuth_deg!r} --elevation {first.elevation_deg!r} -o out.png",
        "reproduced",
    ]
    assert np.array_equal(shrunk(record, workers=3).points, result.points)


@pytest.mark.slow
def test_the_command_that_is_printed_fails_in_the_same_way(command, plugins, tmp_path):
    reason = "weigh: 7 points left and 8 right"
    record = failed_item(tmp_path / "run", "fake-left-and-right", reason, device="cpu")
    folder = tmp_path / "a folder"
    status, out, err = command("shrink", record, "--workers", "1", "-o", folder)
    assert (status, err) == (0, "")
    assert [path.name for path in folder.iterdir()] == ["minimal.ply"]
    assert not (tmp_path / "run" / "shrunk").exists()
    (line,) = (line for line in out.splitlines() if line.startswith("bench render "))
    _, *arguments = shlex.split(line)
    assert arguments[1] == str(folder / "minimal.ply")
    assert arguments[arguments.index("--device") + 1] == "cpu"
    assert command(*arguments) == (
        *(1, ""),
        "bench: fake-left-and-right: weigh: 1 points left and 1 right\n",
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "reason", "left"),
    [
        ("fake-several-views", "ValueError: one at a time", 3),
        ("fake-unlucky", "ValueError: bad luck", 0),
    ],
)
def test_failures_of_all_views_or_of_the_runs_random_numbers(
    plugins, tmp_path, method, reason, left
):
    result = shrunk(failed_case(tmp_path / "run", method, reason, "16-points"))
    assert len(result.points) == left
    assert (result.reason, result.reproduced) == (reason, "")
    assert result.message.splitlines()[2:] == [
        "it fails so with the run's random numbers and its 4 views, not with one of them alone; "
        "the command draws the first",
        f"bench render {result.path} --as-is --method {method} --azimuth 30.0 --elevation 20.0 "
        "-o out.png",
        "not reproduced: the command draws an image",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "case", "before", "left", "reason", "reproduced"),
    [
        ("fake-crash-where-high", "16-points", 16, 1, *["crash: the worker died (SIGSEGV)"] * 2),
        ("fake-blank-from-the-left", "16-points", 16, 5, "draw: 2 of 4 images are blank",
         "draw: 1 of 1 images are blank"),
        ("splat", "outlier-nan", 2048, 1, "input: 1 of 2048 points are not finite",
         "input: 1 of 1 points are not finite"),
        ("fake-nan", "plain", 2048, 0, "draw: 9 pixel values are not finite",
         "draw: 384 pixel values are not finite"),
        ("fake-exception", "0-points", 0, 0, *["ValueError: 12 of 34 parts are missing"] * 2),
    ],
)  # fmt: skip
def test_what_is_left_of_a_cloud(plugins, tmp_path, method, case, before, left, reason, reproduced):
    record = failed_case(tmp_path / "run", method, reason, case)
    result = shrunk(record)
    assert (result.before, len(result.points), result.minimal) == (before, left, True)
    assert result.reason == result.reproduced == reproduced
    assert left > 0 or result.trials <= 2
    fails_first = View(-60.0, -10.0) if "left" in method else find_failed_job(record).job.views[0]
    assert result.drawing.views == (fails_first,)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "now"),
    [
        ("fake-healthy", "it is drawn now"),
        ("fake-exception", "it fails otherwise now: ValueError: 12 of 34 parts are missing"),
    ],
)
def test_failures_that_are_there_no_more(command, plugins, tmp_path, method, now):
    record = failed_case(tmp_path / "run", method, "weigh: 3 grams", "16-points")
    assert command("shrink", record, "--workers", "1") == (
        *(1, ""),
        f"bench: {method}/16-points: does not fail any more as it did (weigh: 3 grams); {now}\n",
    )
    assert not (tmp_path / "run" / "shrunk").exists()


@pytest.mark.slow
def test_when_the_time_is_up_the_best_is_kept(plugins, tmp_path, capsys):
    record = failed_case(tmp_path / "run", "fake-slow", "ValueError: at last", "plain")
    result = shrunk(record, budget_s=10.0, log_every_s=1.0)
    assert 1 < len(result.points) < 2048
    assert not result.minimal
    assert result.seconds < 40.0
    assert result.reproduced == "ValueError: at last"
    assert "; the time is up, fewer may do\n" in result.message
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2
    message = r"fake-slow/plain: \d+ of 2048 points left, \d+ trials, \d+ s of 10 s"
    assert all(re.fullmatch(message, line) for line in lines)


@pytest.mark.slow
def test_ends_before_the_failure_was_seen_again(refused, plugins, tmp_path):
    record = failed_case(tmp_path / "run", "fake-slow", "ValueError: at last", "16-points")
    with pytest.raises(BadInput, match="over before the failure was seen again; give more"):
        shrink(record, 0.01, 1, None)
    licence = failed_item(tmp_path / "licence", "fake-no-licence", "x: y")
    assert refused("shrink", licence, "--workers", "1") == "no licence; buy one"
    assert not list(tmp_path.rglob("minimal.ply"))


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_is_reported_before_the_work(refused, plugins, tmp_path):
    reason = "ValueError: 12 of 34 parts are missing"
    record = failed_case(tmp_path / "run", "fake-exception", reason, "plain")
    (tmp_path / "file").touch()
    message = refused("shrink", record, "--workers", "1", "-o", tmp_path / "file")
    assert message.startswith(f"{tmp_path}/file/minimal.ply: cannot be written (")
