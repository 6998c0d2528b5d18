"""The suite `speed` from end to end, and how a run goes on."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import dataclass, field, replace

import pytest

from bench.analysis.run import read_run
from bench.records.folder import read_manifest
from bench.running.options import Options
from bench.running.pool import run_tasks
from bench.suites.speed.measure import SPEED, TimingSample, Unit, lost
from bench.suites.speed.run import measure_alone, run
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
    *("amortised.csv", "amortised.md", "speed.csv", "speed.md"),
    "speed_samples.csv",
]


@dataclass
class Fake:
    """Measurements that are made up instead of taken; raises KeyboardInterrupt after `most`."""

    cores: int = 2
    most: int = 99
    taken: list = field(default_factory=list)

    def measure(self, unit):
        if len(self.taken) == self.most:
            raise KeyboardInterrupt
        self.taken.append((unit.method, unit.condition, unit.threads))
        calls = [("prepare", 0), ("draw", 1), ("draw", unit.views)]
        samples = [TimingSample("chair/a", 1, stage, views, 1.0, 1.0) for stage, views in calls]
        measurement = replace(lost(unit, ""), failures=(), samples=tuple(samples))
        return replace(measurement, elsewhere_cores=0.5 if unit.method == "blank" else 0.0)

    def run(self, out, gl="some", **changes):
        return run(stated(out, **changes), *self.arguments(gl))

    def arguments(self, gl="some"):
        return SMALL, lambda: {"gl": gl}, lambda: self.cores, self.measure


def stated(out, **changes):
    return Options("speed", out=out, device="cpu", **changes)


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_a_run_leaves_times_tables_and_a_figure(tmp_path):
    out = tmp_path / "run"
    finished = run(stated(out), *Fake().arguments()[:3])
    counted = "4 measurements taken, 0 from before, 0 with failures"
    assert finished.summary.startswith(counted)
    names = {"figures", "lock", "manifest.json", "measurements", "tables"}
    assert {p.name for p in out.iterdir()} == names
    assert sorted(p.name for p in (out / "tables").iterdir()) == FILES
    for name, table in zip(("speed.md", "amortised.md"), finished.tables, strict=True):
        assert (out / "tables" / name).read_text() == table.to_markdown()
    assert (out / "figures" / "amortised.png").stat().st_size > 10_000
    manifest = read_manifest(out)
    assert manifest["finished"]
    assert (manifest["threads"], manifest["views"]) == ([1, 2], 3)
    assert manifest["objects"] == ["chair/test-0000", "chair/test-0001"]

    samples = read(out / "tables" / "speed_samples.csv")
    # Load and the first image, then two rounds: a preparation and calls of 1 and 3 views a cloud.
    assert len(samples) == 4 * (3 + 2 * 2 * 3)
    assert all(float(row["wall_s"]) > 0 for row in samples)
    rows = {(r["method"], r["threads"], r["metric"]): r for r in read(out / "tables" / "speed.csv")}
    assert {key[:2] for key in rows} == {(m, t) for m in ("splat", "blank") for t in "12"}
    row = rows["splat", "2", "draw-3-ms"]
    assert (row["n"], row["n_ok"], row["clouds"], row["device"]) == ("4", "2", "2", "cpu")
    machine = manifest["machine"]
    assert (row["cpu"], row["cores"]) == (machine["cpu"], str(machine["cores"]))
    assert float(rows["blank", "1", "picture-of-1-speedup"]["value"]) > 1
    assert len(read(out / "tables" / "amortised.csv")) == 4 * len(SMALL.amortised)
    with pytest.raises(BadInput, match="writes its tables itself"):
        tables(read_run(out))


def test_times_taken_while_something_else_ran_are_counted(tmp_path):
    fake = Fake()
    finished = fake.run(tmp_path / "run", conditions=("2048", "512"))
    settings = [("2048", 1), ("2048", 2), ("512", 1), ("512", 2)]
    assert [unit[1:] for unit in fake.taken] == settings * 2
    counted = "8 measurements taken, 0 from before, 0 with failures, 4 while something else ran; "
    assert finished.summary.startswith(counted)
    assert sorted(p.name for p in (finished.directory / "tables").iterdir()) == FILES
    fake = Fake(cores=1)
    fake.run(tmp_path / "one core")
    assert fake.taken == [("splat", "2048", 1), ("blank", "2048", 1)]


def test_what_was_measured_is_kept(tmp_path, capsys):
    out, fake = tmp_path / "run", Fake()
    fake.run(out)
    before = {p: p.stat().st_mtime_ns for p in (out / "measurements").iterdir()}
    message = (out / "tables" / "speed.csv").read_bytes()
    assert len(before) == len(fake.taken) == 4

    again = fake.run(out)
    assert again.summary.startswith("0 measurements taken, 4 from before, ")
    assert "from before" not in capsys.readouterr().err
    assert len(fake.taken) == 4
    assert {p: p.stat().st_mtime_ns for p in (out / "measurements").iterdir()} == before
    assert (out / "tables" / "speed.csv").read_bytes() == message

    damaged = sorted(before)[1]
    gone = json.loads(damaged.read_text())
    damaged.write_text("{")
    assert ", 3 from before, " in fake.run(out).summary
    assert fake.taken[4:] == [(gone["method"], "2048", gone["threads"])]
    assert "speed: 3 of 4 are there from before\n" in capsys.readouterr().err

    with pytest.raises(BadInput, match="holds a run of views 3, not 5"):
        fake.run(out, views=5)
    assert fake.run(out, fresh=True).summary.startswith("4 measurements taken, ")
    assert len(list((tmp_path / "run.old-1" / "measurements").iterdir())) == 4


def test_a_run_that_was_stopped_goes_on_and_another_driver_is_measured_again(tmp_path):
    out, stopped, fake = tmp_path / "run", Fake(most=2), Fake()
    with pytest.raises(KeyboardInterrupt):
        stopped.run(out)
    assert read_manifest(out)["finished"] is None
    assert fake.run(out).summary.startswith("2 measurements taken, 2 from before, ")
    units = [(method, "2048", count) for method in ("splat", "blank") for count in (1, 2)]
    assert stopped.taken + fake.taken == units
    assert ", 0 from before, " in fake.run(out, gl="other").summary


def threads_here(_):
    return os.environ.get("OMP_NUM_THREADS"), os.environ.get("GLIBC_TUNABLES")


def test_each_measurement_has_the_threads_and_limits_of_its_unit():
    """Its process has as many threads as it is given, and memory that is not filled."""
    asked = []

    def run_there(tasks, work, workers, limits, environment):
        asked.append((workers, limits, {*environment} >= {"OPENBLAS_NUM_THREADS"}))
        yield from run_tasks(tasks, threads_here, workers, limits, environment)

    seen = measure_alone(replace(UNIT, threads=4), run_there)
    assert seen == ("4", os.environ.get("GLIBC_TUNABLES"))
    assert asked == [(1, SMALL.limits, True)]


def test_a_process_that_dies_is_a_failure_with_a_reason():
    unit = replace(UNIT, objects=(Dying("a"), Tetrahedron("b")))
    measurement = measure_alone(unit)
    assert measurement == lost(unit, "crash: the worker died (exit code 7)")
    assert [f.cloud for f in measurement.failures] == ["chair/a", "chair/b"]
