from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from harness_objects import Tetrahedron

import bench.catalogue.conditions
import bench.running.plan
from bench.catalogue.conditions import CONDITIONS, find_condition
from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suites import SUITES, Limits, with_truth
from bench.records.job import GROUND_TRUTH, unpack
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import Protocol, find_methods, with_floor
from bench.running.work import cloud_of, run_job
from data_prep.clouds.conditions import GaussianNoise
from data_prep.datasets.exported import ExportedObject, StoredFile
from data_prep.datasets.registry import PaperObject, ProceduralObject
from data_prep.failures import BadInput
from data_prep.rendering.opengl import scene_values
from data_prep.scene import View

from ..builders import make_protocol

PROTOCOL = make_protocol(
    conditions=("2048", "noise-0.05"),
    objects=(Tetrahedron("a"), Tetrahedron("b")),
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
    if "methods" in changes:
        changes["methods"] = find_methods(changes["methods"])
    made = plan(replace(PROTOCOL, **changes))
    every = [job for obj in made for job in (obj.truth, *obj.method_jobs)]
    found = {(job.object.object_id, job.method, job.condition): job.key for job in every}
    assert len(found) == len(every)
    assert len({*found.values()}) == len(made) * made.jobs_per_object
    what_is_drawn = {
        (obj, method, condition if method == "splat" else "") for obj, method, condition in found
    }
    assert len(set(found.values())) == len(what_is_drawn)
    return found


def changed(before, after):
    return {cell for cell in before if before[cell] != after[cell]}


def test_what_is_planned_and_in_which_order():
    made = plan(PROTOCOL)
    assert made == plan(replace(PROTOCOL))
    truth_jobs, method_jobs = [obj.truth for obj in made], [*made.method_jobs]
    assert [(j.object.object_id, j.method, j.condition) for j in truth_jobs] == [
        ("a", GROUND_TRUTH, ""),
        ("b", GROUND_TRUTH, ""),
    ]
    assert [(j.object.object_id, j.condition, j.method) for j in method_jobs] == [
        (obj, condition, method)
        for obj in "ab"
        for condition in ("2048", "noise-0.05")
        for method in ("splat", "blank")
    ]
    truths = {job.object: job for job in truth_jobs}
    for job in (*truth_jobs, *method_jobs):
        assert (job.suite, job.seed, job.device) == (SUITES[0].id, 0, "cpu")
        assert job.features == PROTOCOL.features
        assert job.views == truths[job.object].views
        assert job.reference is None  # until it is handed to a worker
    assert all(job.reference_key is None for job in truth_jobs)
    assert all(job.reference_key == truths[job.object].key for job in method_jobs)


def test_views_are_the_objects_own():
    a, b = (job.views for job in (obj.truth for obj in plan(PROTOCOL)))
    assert len(set(a + b)) == 4
    for view in a + b:
        assert -180 <= view.azimuth_deg <= 180
        assert -40 <= view.elevation_deg <= 40
    other = plan(replace(PROTOCOL, seed=1))[0].truth.views
    assert not set(other) & set(a)


class SameViews(Tetrahedron):
    def views(self, count, rng):
        return (View(0, 0),) * count


def test_the_seed_counts_whatever_the_views():
    objects = (SameViews("a"), SameViews("b"))
    assert not {*keys(objects=objects).values()} & {*keys(objects=objects, seed=1).values()}


def everything(*cell):
    return True


def nothing(*cell):
    return False


@pytest.mark.parametrize(
    ("change", "concerned"),
    [
        ({"seed": 1}, everything),
        ({"views": 3}, everything),
        ({"suite": replace(SUITES[0], id="another")}, everything),
        ({"suite": replace(SUITES[0], truth="grey")}, everything),
        ({"objects": (Edited("a"), Edited("b"))}, everything),
        ({"objects": (Tetrahedron("a", "sofa"), Tetrahedron("b", "sofa"))}, everything),
        ({"feature_identity": {"fd-views": "2 abc"}}, everything),
        ({"feature_identity": {"fd-views": "1 abc", "fid": "1 def"}}, everything),
        ({"environment": {"gl": "another", "numpy": "2"}}, everything),
        ({"environment": {"gl": "llvmpipe", "numpy": "3"}}, everything),
        ({"device": "cuda"}, lambda obj, method, condition: method != GROUND_TRUTH),
        ({"objects": (Tetrahedron("a"), Edited("b"))}, lambda obj, *cell: obj == "b"),
        # what grows, or has another name, keeps what is done
        ({"methods": ("true-mesh", "splat", "blank")}, nothing),
        ({"conditions": ("512", "noise-0.05", "2048")}, nothing),
        ({"objects": (Tetrahedron("c"), Tetrahedron("b"), Tetrahedron("a"))}, nothing),
        ({"environment": {"numpy": "2", "gl": "llvmpipe"}}, nothing),
        ({"features": (("fd-views", "elsewhere"),)}, nothing),  # the same weights elsewhere
        ({"suite": replace(SUITES[0], limits=Limits(1, 1), about="", endless_limit=1)}, nothing),
    ],
)
def test_only_what_a_change_concerns_is_done_again(change, concerned):
    before = keys()
    expected = {cell for cell in before if concerned(*cell)}
    assert changed(before, keys(**change)) == expected


@pytest.mark.parametrize("name", scene_values())
def test_another_value_of_the_scene_concerns_all_jobs(name):
    here = {"gl": "llvmpipe", "numpy": "2", **scene_values()}
    before = keys(environment=here)
    assert changed(before, keys(environment=here | {name: "another"})) == {*before}


@pytest.mark.parametrize("change", [{"version": 2}, {"identity": lambda: "99"}])
def test_another_version_of_a_method_concerns_its_jobs(change):
    before, splat = keys(), replace(PROTOCOL.methods["splat"], **change)
    protocol = replace(PROTOCOL, methods=PROTOCOL.methods | {"splat": splat})
    after = {(j.object.object_id, j.method, j.condition): j.key for j in plan(protocol).jobs}
    assert {cell for cell in after if before[cell] != after[cell]} == {
        cell for cell in before if cell[1] == "splat"
    }


def other_noise():
    def find_other(condition_id):
        known = find_condition(condition_id)
        other = replace(known, perturbation=GaussianNoise(0.06))
        return other if condition_id == "noise-0.05" else known

    return bench.running.plan, "find_condition", find_other


@pytest.mark.parametrize(
    ("patch", "concerned"),
    [
        (other_noise(), lambda obj, *cell: cell == ("splat", "noise-0.05")),
        # the ground truth has no score
        (
            (bench.running.plan, "SCORES_VERSION", 99),
            lambda obj, method, condition: method != GROUND_TRUTH,
        ),
        ((bench.running.plan, "PROCEDURAL_VERSION", 99), everything),
        ((bench.running.plan, "RECORDS_VERSION", 99), everything),
    ],
)
def test_another_version_of_the_code_concerns_what_it_makes(monkeypatch, patch, concerned):
    before = keys()
    monkeypatch.setattr(*patch)
    assert changed(before, keys()) == {cell for cell in before if concerned(*cell)}


def test_a_suite_in_grey_has_the_same_points_and_views_of_grey_objects(tmp_path):
    """There the true mesh is the ceiling; in the coloured suite its grey twin falls short of it."""
    objects = (ProceduralObject("chair", "test", 0),)
    made = {}
    for suite in (SUITES[0], with_truth(SUITES[0], "grey")):
        methods = ("true-mesh", "true-mesh@grey")
        some = {"methods": methods, "conditions": ("noise-0.05",), "objects": objects, "views": 2}
        truth, *others = plan(make_protocol(suite=suite, features=(), **some)).jobs
        drawn = run_job(truth)
        scored = [replace(job, reference=drawn.arrays["images"]) for job in others]
        made[suite.truth] = [(truth, drawn), *((job, run_job(job)) for job in scored)]
    chair = objects[0].fingerprint()
    assert made["grey"][0][0].object.fingerprint() == f"unpainted {chair}"
    for (colour, _), (grey, _) in zip(made["coloured"], made["grey"], strict=True):
        assert colour.key != grey.key
        assert (colour.method, colour.views) == (grey.method, grey.views)
        assert cloud_of(colour).points.tobytes() == cloud_of(grey).points.tobytes()
    ((_, truth), (_, mesh), (_, mesh_grey)) = made["grey"]
    channels = unpack(truth.arrays["images"])
    assert np.array_equal(channels.min(axis=-1), channels.max(axis=-1))
    assert truth.arrays == mesh.arrays == mesh_grey.arrays
    assert {*mesh.of_views["ssim"], *mesh_grey.of_views["ssim"]} == {1.0}
    ((_, truth), (_, mesh), (_, mesh_grey)) = made["coloured"]
    assert truth.arrays == mesh.arrays != mesh_grey.arrays
    assert all((mesh_grey.of_views["ssim"] > 0.5) & (mesh_grey.of_views["ssim"] < 0.999))
    assert {*mesh_grey.of_views["silhouette_iou"]} == {1.0}


def test_a_suite_in_grey_needs_meshes(tmp_path):
    obj = PaperObject("chair", "a", tmp_path / "a.ply", tmp_path)
    chosen = with_truth(SUITES[0], "grey")
    message = "chair/a has images but no mesh, and chair-robustness --truth grey draws meshes in gr"
    with pytest.raises(BadInput, match=message):
        plan(make_protocol(suite=chosen, objects=(obj,)))


@pytest.mark.parametrize("condition", ["8192", "one-side"])
def test_a_condition_that_samples_the_mesh_anew_needs_one(tmp_path, condition):
    stored = StoredFile(tmp_path / "a.ply", "0")
    view = (View(0, 0), stored)
    bare = PaperObject("chair", "a", tmp_path / "a.ply", tmp_path)
    without = ExportedObject("chair", "a", None, (("2048", stored),), (view, view))
    message = f"chair/a has no mesh, which the condition {condition} samples anew; leave it out"
    for obj in (bare, without):
        with pytest.raises(BadInput, match=message):
            plan(make_protocol(objects=(Tetrahedron(), obj), conditions=("512", condition)))
        plan(make_protocol(objects=(obj,), conditions=("512", "noise-0.05")))
    exported = replace(without, clouds=((condition, stored),))
    for obj in (exported, replace(without, mesh=stored)):
        assert len(plan(make_protocol(objects=(obj,), conditions=(condition,)))) == 1


def test_larger_clouds_begin_with_the_smaller_ones_in_a_run():
    conditions = ("512", "2048", "8192", "32768", "one-side", "three-views")
    protocol = make_protocol(conditions=conditions, objects=(Tetrahedron(),))
    jobs = {job.condition: job for job in plan(protocol)[0].method_jobs if job.method == "splat"}
    clouds = {condition: cloud_of(job).points for condition, job in jobs.items()}
    np.testing.assert_array_equal(clouds["512"], clouds["2048"][::4])
    for few, more in pairwise(("2048", "8192", "32768")):
        assert len(clouds[more]) == int(more)
        np.testing.assert_array_equal(clouds[more][: int(few)], clouds[few])


def test_the_option_leaves_out_methods_that_make_up_colours_unless_they_are_asked_for(
    tmp_path, capfd
):
    options = Options("chair-robustness", limit=1, truth="grey", out=tmp_path / "a")
    protocol = Protocol.from_options(options, dict)
    assert {find_method(m).color for m in protocol.methods if m != "constant"} == {"none", "true"}
    assert {"occupancy-net", "splat-net@grey", "fused-net@grey"} <= protocol.methods.keys()
    assert capfd.readouterr().err == (
        "--truth grey leaves out pc2pix, pc2pix@acgan, splat-net, splat-net@chair, fused-net "
        "(makes up colours); true-mesh@grey (is true-mesh in grey), and adds occupancy-net, "
        "splat-net@grey, fused-net@grey: give --methods for others\n"
    )
    asked = replace(options, methods=("splat-net@chair", "true-mesh@grey"))
    protocol = Protocol.from_options(asked, dict)
    assert tuple(protocol.methods) == ("splat-net@chair", "true-mesh@grey", "blank")
    assert capfd.readouterr().err == ""
    classes = find("thirteen-classes", SUITES, "suite")
    Protocol.from_options(Options(classes.id, limit=1, truth="grey", out=tmp_path / "b"), dict)
    assert capfd.readouterr().err.endswith(
        ": give --methods for them, or for networks in grey like fused-net@grey\n"
    )


def test_the_device_is_in_the_key_of_every_job():
    """Also of a ground truth, which no method draws but the extractors see."""
    planned = {}
    for device in ("cpu", "cuda"):  # on nodes of a cluster: this machine may have no GPU
        options = Options(
            "chair-robustness", limit=1, device=device, ray="10.0.0.1:6379", fresh=True
        )
        protocol = Protocol.from_options(options, dict)
        marked = {identity.endswith(" cuda") for identity in protocol.feature_identity.values()}
        assert marked == {device == "cuda"}
        planned[device] = {job.key for job in plan(protocol).jobs}
    assert len(planned["cpu"]) == len(planned["cuda"]) > 1
    assert not planned["cpu"] & planned["cuda"]


def test_two_conditions_of_equal_effect_are_two_items(monkeypatch):
    again = replace(find_condition("noise-0.10"), id="noise-again")
    monkeypatch.setattr(bench.catalogue.conditions, "CONDITIONS", (*CONDITIONS, again))
    found = keys(conditions=("noise-0.10", "noise-again"))
    assert found["a", "splat", "noise-0.10"] != found["a", "splat", "noise-again"]


def test_the_floor_is_always_measured_once():
    assert with_floor(["splat"]) == ("splat", "blank")
    assert with_floor(["blank", "splat", "blank"]) == ("blank", "splat")
    assert with_floor([]) == ("blank",)
