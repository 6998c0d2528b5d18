"""Items that are done to be measured: which, in what processes, and what is kept of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from harness_objects import Dying, Refusing, Tetrahedron

import bench.running.pilot
from bench.catalogue.metrics import JUDGE
from bench.catalogue.suites import Limits
from bench.judges import JUDGE_WEIGHTS
from bench.records.record import GROUND_TRUTH
from bench.running.isolation import WorkerFailure
from bench.running.pilot import CELLS, lost_sample, measure, measured, size_of, sizes_of
from data_prep.failures import BadInput, MissingDependency

from ..builders import make_job, make_protocol


def protocol_of(*objects):
    return make_protocol(objects=objects)


def test_size_of_a_filled_cube_a_plate_a_line_and_at_any_place_and_scale():
    axis = (np.arange(2 * CELLS) + 0.5) / (2 * CELLS)
    ends = np.concatenate([[0.0], axis, [1.0]])
    cube = np.stack(np.meshgrid(ends, ends, ends), axis=-1).reshape(-1, 3)
    assert size_of(cube) == CELLS**3
    assert size_of(cube[cube[:, 1] == 0.0]) == CELLS**2
    assert size_of(cube[(cube[:, 0] == 0.0) & (cube[:, 1] == 0.0)]) == CELLS
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    assert size_of(4.0 * cloud + 64.0) == size_of(cloud) > 50
    assert size_of(np.zeros((0, 3))) == 0
    assert size_of(np.ones((5, 3))) == 1


def test_sizes_are_of_a_fixed_random_choice_in_order(monkeypatch):
    monkeypatch.setattr(bench.running.pilot, "CANDIDATES", 4)
    protocol = protocol_of(*(Tetrahedron(str(n)) for n in range(9)))
    found = sizes_of(protocol, 2)
    assert len(found) == 4
    assert list(found) == sorted(found)
    assert found == sizes_of(protocol, 1)
    assert list(found) != [("chair", str(n)) for n in range(4)]


def test_objects_without_a_cloud_are_left_out_and_named(capsys):
    found = sizes_of(protocol_of(Tetrahedron("a"), Refusing("b"), Dying("c")), 1)
    assert list(found) == [("chair", "a")]
    assert "2 of 3 objects have no readable cloud; left out" in capsys.readouterr().err


@pytest.mark.slow
def test_every_method_and_condition_is_measured_on_every_chosen_object():
    pilot = measure(protocol_of(*(Tetrahedron(str(n)) for n in range(5))), 3, 2)
    samples, objects = pilot.samples, {s.object_id for s in pilot.samples}
    # One job of blank does it at both conditions.
    cells = [(GROUND_TRUTH, ""), ("splat", "2048"), ("splat", "512"), ("blank", "2048")]
    found = {(s.method, s.condition, s.object_id) for s in samples}
    assert found == {(*cell, name) for cell in cells for name in objects}
    assert len(samples) == len(found) == 4 * 3
    assert len(pilot.sizes) == 5
    for sample in samples:
        assert not sample.reason
        assert 0 < sample.seconds < 20
        assert 0 <= sample.method_s <= sample.seconds
        assert 30 < sample.peak_mib < 4096
        assert sample.size_b > 1000
        assert (sample.ssim is None) == (sample.method == GROUND_TRUTH)
    for method in (GROUND_TRUTH, "splat", "blank"):  # first items of processes are loading
        of_method = [s for s in samples if s.method == method]
        loading = [s.loading_s for s in of_method if s.loading_s is not None]
        assert 1 <= len(loading) <= 2  # there are two workers
        if method == GROUND_TRUTH:  # a process is started, a renderer's context made
            assert 60 > min(loading) > max(s.seconds for s in of_method)


def test_a_failure_is_a_sample_with_its_reason(tmp_path):
    job = make_job(tmp_path, Refusing("a"), reference=None)
    sample = measured((job, 7.0))
    assert "no such shape" in sample.reason
    assert sample.ssim is None
    assert sample.size == 7.0
    assert sample.seconds > 0
    assert sample.size_b < 1e4  # its line in the journal


def test_what_no_other_item_can_do_either_ends_the_pilot(tmp_path):
    (tmp_path / "file").write_text("")
    job = make_job(tmp_path, artifact=tmp_path / "file" / "a.npz", reference=None)
    with pytest.raises(MissingDependency, match="cannot be written"):
        measured((job, 7.0))


@pytest.mark.parametrize(
    ("kind", "seconds", "peak_mib"),
    [("timeout", 120.0, 0.0), ("memory", math.nan, 4096.0), ("crash", math.nan, 0.0)],
)
def test_what_an_item_costs_whose_worker_is_gone(tmp_path, kind, seconds, peak_mib):
    sample = lost_sample(make_job(tmp_path), 7.0, WorkerFailure(kind, "gone"), Limits(120.0, 4.0))
    assert sample.seconds == pytest.approx(seconds, nan_ok=True)
    assert (sample.peak_mib, sample.reason) == (peak_mib, f"{kind}: gone")


@pytest.mark.slow
def test_optional_features_are_measured_on_the_floor(tmp_path, monkeypatch):
    monkeypatch.setattr(bench.running.pilot, "OPTIONAL", JUDGE)
    features = ((JUDGE, str(JUDGE_WEIGHTS)),)
    job = make_job(tmp_path, method="blank", features=features, reference=None)
    sample = measured((job, 7.0))
    assert 0 < sample.optional_s < sample.seconds
    for other in (replace(job, features=()), replace(job, method="splat")):
        assert measured((other, 7.0)).optional_s is None


@pytest.mark.parametrize(
    ("obj", "count", "message"),
    [
        (Tetrahedron("a"), 0, "--pilot 0: must be at least 1"),
        (Refusing("a"), 1, "none of the objects looked at has a cloud"),
    ],
)
def test_refused(obj, count, message):
    with pytest.raises(BadInput, match=message):
        measure(protocol_of(obj), count, 1)
