from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from harness_objects import Tetrahedron

import bench.catalogue.methods
import bench.running.protocol
from bench.catalogue.suites import SUITES, Limits
from bench.records.record import GROUND_TRUTH
from bench.running.protocol import Protocol, plan, with_floor
from data_prep import conditions
from data_prep.conditions import Condition, GaussianNoise
from data_prep.datasets import ProceduralObject
from data_prep.failures import BadInput
from data_prep.scene import View

HERE = Path("run")
PROTOCOL = Protocol(
    suite=SUITES[0],
    dataset="procedural",
    methods=("splat", "blank"),
    conditions=("2048", "noise-0.05"),
    objects=(Tetrahedron("a"), Tetrahedron("b")),
    views=2,
    seed=0,
    device="cpu",
    features=(("fd-views", "weights"),),
    feature_identity={"fd-views": "1 abc"},
    environment={"gl": "llvmpipe", "numpy": "2"},
)


@dataclass(frozen=True)
class Edited(Tetrahedron):
    def fingerprint(self):
        return f"edited {self.object_id}"


def keys(**changes):
    """Keys of all jobs, by object, method and condition."""
    made = plan(replace(PROTOCOL, **changes), HERE)
    found = {
        (job.object.object_id, job.method, job.condition): job.key
        for job in (*made.references, *made.items)
    }
    assert len(set(found.values())) == len(found) == len(made.references) + len(made.items)
    return found


def test_equal_protocols_give_equal_plans():
    assert plan(PROTOCOL, HERE) == plan(replace(PROTOCOL), HERE)


def test_what_is_planned_and_in_which_order():
    made = plan(PROTOCOL, HERE)
    assert [(j.object.object_id, j.method, j.condition) for j in made.references] == [
        ("a", GROUND_TRUTH, ""),
        ("b", GROUND_TRUTH, ""),
    ]
    assert [(j.object.object_id, j.condition, j.method) for j in made.items] == [
        (obj, condition, method)
        for obj in "ab"
        for condition in ("2048", "noise-0.05")
        for method in ("splat", "blank")
    ]


def test_jobs_carry_the_protocol():
    for job in (*(made := plan(PROTOCOL, HERE)).references, *made.items):
        assert (job.suite, job.seed, job.device) == (SUITES[0].id, 0, "cpu")
        assert job.features == PROTOCOL.features
        assert job.artifact == HERE / "artifacts" / job.key[:2] / f"{job.key}.npz"
    truths = {job.object: job.artifact for job in made.references}
    assert all(job.reference is None for job in made.references)
    assert all(job.reference == truths[job.object] for job in made.items)


def test_views_are_the_objects_own_and_shared_by_all_methods():
    made = plan(PROTOCOL, HERE)
    by_object = {job.object.object_id: job.views for job in made.references}
    assert all(job.views == by_object[job.object.object_id] for job in made.items)
    assert len(set(by_object["a"] + by_object["b"])) == 4
    for view in by_object["a"]:
        assert -180 <= view.azimuth_deg <= 180
        assert -40 <= view.elevation_deg <= 40
    other = plan(replace(PROTOCOL, seed=1), HERE).references[0].views
    assert not set(other) & set(by_object["a"])


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"views": 3},
        {"suite": replace(SUITES[0], id="another")},
        {"objects": (Edited("a"), Edited("b"))},
        {"objects": (Tetrahedron("a", "sofa"), Tetrahedron("b", "sofa"))},
        {"feature_identity": {"fd-views": "2 abc"}},
        {"feature_identity": {"fd-views": "1 abc", "fid": "1 def"}},
        {"environment": {"gl": "another", "numpy": "2"}},
        {"environment": {"gl": "llvmpipe", "numpy": "3"}},
    ],
)
def test_everything_is_done_again_where_the_protocol_differs(change):
    before, after = keys(), keys(**change)
    assert before.keys() == after.keys()
    assert not set(before.values()) & set(after.values())


def test_the_seed_counts_whatever_the_views(monkeypatch):
    monkeypatch.setattr(Tetrahedron, "views", lambda self, count, rng: (View(0, 0),) * count)
    assert not set(keys().values()) & set(keys(seed=1).values())


def changed_items(before, after):
    return {cell for cell in before if before[cell] != after[cell]}


def test_another_device_leaves_ground_truths_alone():
    before = keys()
    assert changed_items(before, keys(device="cuda")) == {c for c in before if c[1] != GROUND_TRUTH}


def test_one_edited_object_leaves_the_others_alone():
    before = keys()
    after = keys(objects=(Tetrahedron("a"), Edited("b")))
    assert changed_items(before, after) == {cell for cell in before if cell[0] == "b"}


@pytest.mark.parametrize("change", [{"version": 2}, {"identity": lambda: "scipy 99"}])
def test_another_version_of_a_method_leaves_the_others_alone(monkeypatch, change):
    before = keys()
    methods = [
        replace(m, **change) if m.id == "splat" else m for m in bench.catalogue.methods.METHODS
    ]
    monkeypatch.setattr(bench.catalogue.methods, "METHODS", methods)
    assert changed_items(before, keys()) == {cell for cell in before if cell[1] == "splat"}


def test_another_strength_of_noise_leaves_other_conditions_alone(monkeypatch):
    before = keys()
    table = [
        Condition(c.id, GaussianNoise(0.06), c.source) if c.id == "noise-0.05" else c
        for c in conditions.CONDITIONS
    ]
    monkeypatch.setattr(bench.running.protocol, "CONDITIONS", table)
    assert changed_items(before, keys()) == {cell for cell in before if cell[2] == "noise-0.05"}


@pytest.mark.parametrize("name", ["SCORES_VERSION", "PROCEDURAL_VERSION", "SCHEMA_VERSION"])
def test_versions_count(monkeypatch, name):
    before = keys()
    monkeypatch.setattr(bench.running.protocol, name, 99)
    items_only = name == "SCORES_VERSION"  # the ground truth has no score
    assert changed_items(before, keys()) == {
        cell for cell in before if not (items_only and cell[1] == GROUND_TRUTH)
    }


@pytest.mark.parametrize(
    "change",
    [
        {"methods": ("true-mesh", "splat", "blank")},
        {"conditions": ("512", "noise-0.05", "2048")},
        {"objects": (Tetrahedron("c"), Tetrahedron("b"), Tetrahedron("a"))},
        {"environment": {"numpy": "2", "gl": "llvmpipe"}},
        {"features": (("fd-views", "elsewhere"),)},  # the same weights in another place
        {"suite": replace(SUITES[0], limits=Limits(1.0, 1.0), about="", endless_limit=1)},
    ],
)
def test_what_grows_keeps_what_is_done(change):
    before, after = keys(), keys(**change)
    assert not changed_items(before, after)


def test_two_conditions_of_equal_effect_are_two_items():
    found = keys(conditions=("noise-0.10", "noise-0.05-code"))  # both N(0, 0.10)
    assert found["a", "splat", "noise-0.10"] != found["a", "splat", "noise-0.05-code"]


def test_a_longer_run_begins_with_the_shorter_one():
    objects = tuple(ProceduralObject("chair", "test", i) for i in range(3))
    short, long = (keys(objects=chosen) for chosen in (objects[:2], objects))
    assert short.items() < long.items()


def test_unknown_names_are_refused():
    with pytest.raises(BadInput, match="unknown method 'splatt': did you mean 'splat'"):
        plan(replace(PROTOCOL, methods=("splatt",)), HERE)
    with pytest.raises(BadInput, match=r"unknown condition 'noise-0\.5': did you mean 'noise-0"):
        plan(replace(PROTOCOL, conditions=("noise-0.5",)), HERE)


def test_the_floor_is_always_measured_once():
    assert with_floor(["splat"]) == ("splat", "blank")
    assert with_floor(["blank", "splat", "blank"]) == ("blank", "splat")
    assert with_floor([]) == ("blank",)
