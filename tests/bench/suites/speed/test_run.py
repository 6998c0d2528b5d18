"""The suite `speed` from end to end, and how a run goes on."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import replace

import pytest

import bench.running.environment
import bench.suites.speed.run
from bench.analysis.scored import read_scored
from bench.catalogue.suites import SPEED, Limits
from bench.records.journal import read_manifest
from bench.running.isolation import WORKER_ENVIRONMENT, run_tasks, thread_counts
from bench.running.protocol import Options
from bench.suites.speed.measure import Unit, lost
from bench.suites.speed.run import run
from bench.suites.speed.samples import Sample
from bench.tables.build import tables
from data_prep.clouds.conditions import Unchanged
from data_prep.failures import BadInput

from ...harness_objects import Dying, Tetrahedron

SMALL = replace(
    SPEED,
    methods=("splat", "blank"),
    baselines=("splat",),
    clouds=2,
    views=3,
    singles=1,
    least_rounds=2,
    most_rounds=2,
    seconds=0.0,
)
UNIT = Unit("k", SMALL, "blank", "2048", Unchanged(), (Tetrahedron(),), 1, 3, 0, "cpu")
FILES = [
    *("amortised.csv", "amortised.md", "break_even.csv"),
    *("speed.csv", "speed.md", "speed_samples.csv"),
]


@pytest.fixture(autouse=True)
def machine(monkeypatch):
    """Nobody asks the driver; two cores, whatever there are."""
    monkeypatch.setattr(bench.suites.speed.run, "environment", lambda: {"gl": "some"})
    monkeypatch.setattr(bench.running.environment, "cores", lambda: 2)


@pytest.fixture
def taken(monkeypatch):
    """Measurements are made up instead of taken; the units that were asked for, in order."""
    units = []

    def measure_alone(unit):
        units.append((unit.method, unit.condition, unit.threads))
        calls = [("prepare", 0), ("draw", 1), ("draw", unit.views)]
        samples = [Sample("chair/a", 1, stage, views, 1.0, 1.0) for stage, views in calls]
        made = replace(lost(unit, ""), failures=(), samples=tuple(samples))
        return replace(made, elsewhere_cores=0.5 if unit.method == "blank" else 0.0)

    monkeypatch.setattr(bench.suites.speed.run, "_measure_alone", measure_alone)
    return units


def stated(out, **changes):
    return Options("speed", out=out, device="cpu", **changes)


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_a_run_leaves_times_tables_and_a_figure(tmp_path):
    out = tmp_path / "run"
    finished = run(stated(out), SMALL)
    counted = "4 measurements taken, 0 from before, 0 with failures"
    assert finished.summary.startswith(counted)
    there = {"figures", "lock", "manifest.json", "measurements", "tables"}
    assert {p.name for p in out.iterdir()} == there
    assert sorted(p.name for p in (out / "tables").iterdir()) == FILES
    for name, table in zip(("speed.md", "amortised.md"), finished.tables, strict=True):
        assert (out / "tables" / name).read_text() == table.to_markdown()
    assert (out / "figures" / "amortised.png").stat().st_size > 10_000
    manifest = read_manifest(out)
    assert manifest["finished"]
    assert (manifest["threads"], manifest["views"]) == ([1, 2], 3)
    assert manifest["objects"] == ["chair/test-0000", "chair/test-0001"]

    samples = read(out / "tables" / "speed_samples.csv")
    # Load and the first picture, then two rounds: a preparation and calls of 1 and 3 views a cloud.
    assert len(samples) == 4 * (3 + 2 * 2 * 3)
    assert all(float(row["wall_s"]) > 0 for row in samples)
    rows = {(r["method"], r["threads"], r["metric"]): r for r in read(out / "tables" / "speed.csv")}
    assert {key[:2] for key in rows} == {(m, t) for m in ("splat", "blank") for t in "12"}
    one = rows["splat", "2", "draw-3-ms"]
    assert (one["n"], one["n_ok"], one["clouds"], one["device"]) == ("4", "2", "2", "cpu")
    assert (one["cpu"], one["cores"]) == (manifest["machine"]["cpu"], "2")
    assert float(rows["blank", "1", "picture-of-1-speedup"]["value"]) > 1
    assert len(read(out / "tables" / "amortised.csv")) == 4 * len(SMALL.amortised)
    assert [r["cheaper"] for r in read(out / "tables" / "break_even.csv")] == ["always"] * 2
    with pytest.raises(BadInput, match="writes its tables itself"):
        tables(read_scored(out))


def test_times_taken_while_something_else_ran_are_counted(tmp_path, taken, monkeypatch):
    finished = run(stated(tmp_path / "run", conditions=("2048", "512")), SMALL)
    assert [unit[1:] for unit in taken] == [("2048", 1), ("2048", 2), ("512", 1), ("512", 2)] * 2
    counted = "8 measurements taken, 0 from before, 0 with failures, 4 while something else ran; "
    assert finished.summary.startswith(counted)
    monkeypatch.setattr(bench.running.environment, "cores", lambda: 1)
    run(stated(tmp_path / "one core"), SMALL)
    assert taken[8:] == [("splat", "2048", 1), ("blank", "2048", 1)]


def test_the_command_line_tells_what_was_done(tmp_path, taken, command):
    chosen = ("--methods", "blank,blank", "--limit", "1", "--views", "5", "--device", "cpu")
    status, out, err = command("run", "--suite", "speed", *chosen, "--out", tmp_path / "run")
    assert status == 0
    assert out.startswith("# Speed: what a picture costs\n")
    assert "# What a picture costs, by the number of views of a cloud\n" in out
    message = "2 measurements taken, 0 from before, 0 with failures, 2 while something else ran; "
    assert message in err
    assert err.endswith(f"\nresults in {tmp_path / 'run'}\n")
    assert taken == [("blank", "2048", 1), ("blank", "2048", 2)]
    manifest = read_manifest(tmp_path / "run")
    assert (manifest["views"], manifest["objects"]) == (5, ["chair/test-0000"])


def test_what_was_measured_is_kept(tmp_path, taken, capsys):
    out = tmp_path / "run"
    run(stated(out), SMALL)
    before = {p: p.stat().st_mtime_ns for p in (out / "measurements").iterdir()}
    message = (out / "tables" / "speed.csv").read_bytes()
    assert len(before) == len(taken) == 4

    again = run(stated(out), SMALL)
    assert again.summary.startswith("0 measurements taken, 4 from before, ")
    assert "from before" not in capsys.readouterr().err
    assert len(taken) == 4
    assert {p: p.stat().st_mtime_ns for p in (out / "measurements").iterdir()} == before
    assert (out / "tables" / "speed.csv").read_bytes() == message

    damaged = sorted(before)[1]
    gone = json.loads(damaged.read_text())
    damaged.write_text("{")
    assert ", 3 from before, " in run(stated(out), SMALL).summary
    assert taken[4:] == [(gone["method"], "2048", gone["threads"])]
    assert "speed: 3 of 4 are there from before\n" in capsys.readouterr().err

    with pytest.raises(BadInput, match="holds a run of views 3, not 5"):
        run(stated(out, views=5), SMALL)
    assert run(stated(out, fresh=True), SMALL).summary.startswith("4 measurements taken, ")
    assert len(list((tmp_path / "run.old-1" / "measurements").iterdir())) == 4


def test_a_run_that_was_stopped_goes_on(tmp_path, taken, monkeypatch):
    out = tmp_path / "run"
    measure_alone = bench.suites.speed.run._measure_alone

    def stopped(unit):
        if len(taken) == 2:
            raise KeyboardInterrupt
        return measure_alone(unit)

    with monkeypatch.context() as patch:
        patch.setattr(bench.suites.speed.run, "_measure_alone", stopped)
        with pytest.raises(KeyboardInterrupt):
            run(stated(out), SMALL)
    assert read_manifest(out)["finished"] is None
    assert run(stated(out), SMALL).summary.startswith("2 measurements taken, 2 from before, ")
    assert taken == [(method, "2048", count) for method in ("splat", "blank") for count in (1, 2)]


def test_other_circumstances_are_measured_again(tmp_path, taken, monkeypatch):
    run(stated(tmp_path / "run"), SMALL)
    for place, name, value in (
        (bench.running.environment, "_cpu", "another"),
        (bench.running.environment, "versions", {"torch": "0"}),
        (bench.suites.speed.run, "environment", {"gl": "other"}),
    ):
        monkeypatch.setattr(place, name, lambda value=value: value)
        assert ", 0 from before, " in run(stated(tmp_path / "run"), SMALL).summary, name


def threads_here(name):
    return os.environ.get(name), os.environ.get("GLIBC_TUNABLES")


def test_a_worker_gets_as_many_threads_as_it_is_given():
    names = [*thread_counts(3)]
    assert {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"} <= set(names)
    limits = Limits(60.0, 4.0)
    found = dict(run_tasks(names, threads_here, 1, limits, thread_counts(3)))
    assert found == dict.fromkeys(names, ("3", os.environ.get("GLIBC_TUNABLES")))
    usual = dict(run_tasks(names[:1], threads_here, 1, limits))
    assert usual == {names[0]: ("1", WORKER_ENVIRONMENT["GLIBC_TUNABLES"])}


def test_each_measurement_has_the_threads_and_limits_of_its_unit(monkeypatch):
    asked = []

    def run_tasks(tasks, work, workers, limits, environment):
        asked.append((workers, limits, environment))
        yield from ((task, lost(task, "timeout: no result")) for task in tasks)

    monkeypatch.setattr(bench.suites.speed.run, "run_tasks", run_tasks)
    bench.suites.speed.run._measure_alone(replace(UNIT, threads=4))
    assert asked == [(1, SMALL.limits, thread_counts(4))]


def test_a_process_that_dies_is_a_failure_with_a_reason():
    unit = replace(UNIT, objects=(Dying("a"), Tetrahedron("b")))
    found = bench.suites.speed.run._measure_alone(unit)
    assert found == lost(unit, "crash: the worker died (exit code 7)")
    assert [f.cloud for f in found.failures] == ["chair/a", "chair/b"]
