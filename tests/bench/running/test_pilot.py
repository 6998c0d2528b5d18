"""The pilot of a run: which jobs are measured, in what processes, and their mean costs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from harness_objects import Dying, Refusing, Tetrahedron

from bench.catalogue.suites import Limits
from bench.records.record import GROUND_TRUTH
from bench.running.isolation import WorkerFailure
from bench.running.pilot import (
    GRID,
    Cost,
    MeasuringWorker,
    lost_sample,
    mean_costs,
    object_size,
    object_sizes,
    run_pilot,
    spread,
)
from data_prep.failures import BadInput, MissingDependency

from ..builders import make_job, make_protocol


def test_size_of_a_filled_cube_a_plate_a_line_and_at_any_place_and_scale():
    axis = (np.arange(2 * GRID) + 0.5) / (2 * GRID)
    ends = np.concatenate([[0.0], axis, [1.0]])
    cube = np.stack(np.meshgrid(ends, ends, ends), axis=-1).reshape(-1, 3)
    assert object_size(cube) == GRID**3
    assert object_size(cube[cube[:, 1] == 0.0]) == GRID**2
    assert object_size(cube[(cube[:, 0] == 0.0) & (cube[:, 1] == 0.0)]) == GRID
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    assert object_size(4.0 * cloud + 64.0) == object_size(cloud) > 50
    assert object_size(np.zeros((0, 3))) == 0
    assert object_size(np.ones((5, 3))) == 1


def test_sizes_are_of_a_fixed_random_choice():
    protocol = make_protocol(objects=tuple(Tetrahedron(str(n)) for n in range(9)))
    sizes = object_sizes(protocol, 2, most=4)
    assert len(sizes) == 4
    assert sizes == object_sizes(protocol, 1, most=4)
    assert {*sizes} != {f"chair/{n}" for n in range(4)}


def test_objects_without_a_cloud_are_left_out_and_counted(capsys):
    objects = (Tetrahedron("a"), Refusing("b"), Dying("c"))
    assert list(object_sizes(make_protocol(objects=objects), 1)) == ["chair/a"]
    assert "2 of 3 objects have no readable cloud; left out" in capsys.readouterr().err


def test_spread_takes_the_middle_of_each_part_and_reaches_every_class():
    sizes = {f"chair/{n}": n for n in reversed(range(9))}
    assert spread(sizes, 3) == {"chair/1", "chair/4", "chair/7"}
    assert spread(sizes, 100) == {*sizes}
    assert spread({}, 3) == set()
    assert spread({f"{name}/{n}": n for name in "abc" for n in range(5)}, 3) == {
        "a/2",
        "b/2",
        "c/2",
    }


@pytest.mark.slow
def test_every_method_and_condition_is_measured_on_every_chosen_object():
    protocol = make_protocol(objects=tuple(Tetrahedron(str(n)) for n in range(5)))
    samples = run_pilot(protocol, 3, 2)
    places = [(s.job.method, s.job.condition, s.job.object.object_id) for s in samples]
    # One job of blank does it at both conditions.
    cells = [(GROUND_TRUTH, ""), ("splat", "2048"), ("splat", "512"), ("blank", "2048")]
    assert sorted(places) == sorted(
        (*cell, name) for cell in cells for name in {p[2] for p in places}
    )
    assert len(places) == 4 * 3
    for sample in samples:
        assert not sample.reason
        assert 0 < sample.cost.seconds < 20
        assert sample.cost.size_b > 500  # compressed records of two views, and white images
        assert 30 < sample.peak_mib < 4096


def test_the_first_job_of_a_method_in_a_process_is_done_twice(tmp_path):
    worker, job = MeasuringWorker(), make_job(Refusing("a"), reference_key=None)
    sample = worker(job)
    assert worker.loaded == {"splat"}
    assert "no such shape" in sample.reason
    assert 0 < sample.cost.seconds < 5
    assert sample.cost.size_b < 1e4  # its records


class Unusable(Tetrahedron):
    def load(self):
        raise MissingDependency("no library; install it")


def test_a_method_that_cannot_be_run_here_ends_the_pilot():
    job = make_job(Unusable("a"), reference_key=None)
    with pytest.raises(MissingDependency, match="no library"):
        MeasuringWorker()(job)


@pytest.mark.parametrize(
    ("kind", "seconds", "peak_mib"),
    [("timeout", 120.0, 0.0), ("memory", math.nan, 4096.0), ("crash", math.nan, 0.0)],
)
def test_the_cost_of_a_job_whose_worker_is_gone(tmp_path, kind, seconds, peak_mib):
    sample = lost_sample(make_job(), WorkerFailure(kind, "gone"), Limits(120.0, 4.0))
    assert sample.cost.seconds == pytest.approx(seconds, nan_ok=True)
    assert (sample.peak_mib, sample.reason) == (peak_mib, f"{kind}: gone")


def test_mean_costs_are_of_a_cell_and_else_of_its_method():
    cells = [(m, c) for m in ("splat", "pc2pix") for c in ("2048", "512")]
    costs = [
        *((("splat", "2048"), Cost(seconds, 100.0)) for seconds in (2.0, 4.0)),
        (("splat", "512"), Cost(math.nan, math.nan)),  # its worker died
        (("pc2pix", "512"), Cost(math.nan, math.nan)),
    ]
    assert mean_costs(costs, cells) == {
        ("splat", "2048"): (3.0, 100.0),
        ("splat", "512"): (3.0, 100.0),
    }


@pytest.mark.parametrize(
    ("obj", "count", "message"),
    [
        (Tetrahedron("a"), 0, "--pilot 0: must be at least 1"),
        (Refusing("a"), 1, "none of the objects looked at has a cloud"),
    ],
)
def test_refused(obj, count, message):
    with pytest.raises(BadInput, match=message):
        run_pilot(make_protocol(objects=(obj,)), count, 1)
