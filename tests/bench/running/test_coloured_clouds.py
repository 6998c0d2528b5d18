"""Suites whose clouds have colours: what clouds, methods, keys and tables are then."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
import trimesh
from harness_objects import Tetrahedron

from bench.catalogue.methods import find_method
from bench.catalogue.suites import SUITES, TRUTHS, with_truth
from bench.draw.cloud import Drawing, draw_views
from bench.records.job import unpack
from bench.running.colours import is_painted
from bench.running.plan import plan
from bench.running.work import cloud_of, load_renderer, rng_of, run_job
from data_prep.datasets.exported import ExportedObject, StoredFile
from data_prep.datasets.registry import PaperObject
from data_prep.failures import BadInput
from data_prep.scene import Mesh, PointCloud, View

from ..builders import make_protocol

RED, BLUE = (200, 40, 20), (10, 60, 220)
COLOURED = with_truth(SUITES[0], "coloured-clouds")


def box() -> trimesh.Trimesh:
    """A box whose half towards +X is red, and whose other half is blue."""
    halves = [trimesh.creation.box([0.5, 1, 1]) for _ in range(2)]
    for half, side in zip(halves, (0.25, -0.25), strict=True):
        half.apply_translation([side, 0, 0])
    whole = trimesh.util.concatenate(halves)
    whole.visual.face_colors = np.repeat([[*RED, 255], [*BLUE, 255]], 12, axis=0)
    return whole


@dataclass(frozen=True)
class Box(Tetrahedron):
    def fingerprint(self) -> str:
        return "box"

    def load(self) -> Mesh:
        shape = box()
        return Mesh(shape.vertices, shape.faces, np.repeat([RED, BLUE], 12, axis=0))

    def views(self, count, rng) -> tuple[View, ...]:
        del rng
        return (View(0, 0), View(90, 0), View(-90, 0))[:count]


def jobs(suite, methods, conditions=("2048",), views=3):
    """Return the jobs of methods on the box, by method and condition, with the true images."""
    some = {"methods": methods, "conditions": conditions, "objects": (Box(),), "views": views}
    made = plan(make_protocol(suite=suite, features=(), **some))[0]
    truth = run_job(made.truth).arrays["images"]
    return {(job.method, job.condition): replace(job, reference=truth) for job in made.method_jobs}


@pytest.mark.parametrize("condition", ["2048", "512", "8192", "missing-0.25", "one-side"])
def test_points_have_the_colours_of_the_box_and_lie_where_they_do_without(condition):
    of_clouds, plain = (jobs(s, ("splat",), (condition,)) for s in (COLOURED, SUITES[0]))
    cloud, bare = (cloud_of(of["splat", condition]) for of in (of_clouds, plain))
    np.testing.assert_array_equal(cloud.points, bare.points)
    assert bare.colors is None
    expected = np.where(cloud.points[:, :1] > 0, RED, BLUE)
    away = np.abs(cloud.points[:, 0]) > 1e-6  # the halves share the plane between them
    np.testing.assert_array_equal(cloud.colors[away], expected[away])
    assert {True, False} == set((cloud.points[away, 0] > 0).tolist())


def test_a_method_that_draws_in_grey_is_painted_by_the_function_that_users_have():
    """The box is red from +X and blue from -X, and the front shows both, each where it is."""
    for method in ("splat-fill", "alpha-wrap"):
        job = jobs(COLOURED, (method,))[method, "2048"]
        result = run_job(job)
        images = unpack(result.arrays["images"])
        drawing = Drawing(method, job.views, rng=rng_of(job))
        users = draw_views(load_renderer(method, "cpu"), cloud_of(job), drawing).images
        np.testing.assert_array_equal(images, users)
        inner = slice(52, 76)
        for view, side, other in ((1, RED, BLUE), (2, BLUE, RED)):
            pixels = images[view, inner, inner].astype(float)
            off, away = (np.linalg.norm(pixels - color, axis=-1) for color in (side, other))
            # Where points leave a gap, those behind it shine through; few pixels have one.
            assert (off < away).mean() > 0.8
        front = images[0, inner]
        assert [tuple(front[:, x].mean(0) > 100) for x in (40, 88)] in (
            [(True, False, False), (False, False, True)],
            [(False, False, True), (True, False, False)],
        )
        grey = run_job(jobs(SUITES[0], (method,))[method, "2048"])
        assert result.of_views["ssim"].mean() > grey.of_views["ssim"].mean() + 0.02
        assert result.draw_s > 0


def test_discs_are_drawn_in_the_colours_of_points_and_not_painted_again():
    job = jobs(COLOURED, ("splat",))["splat", "2048"]
    images = unpack(run_job(job).arrays["images"])
    colours = {tuple(color) for color in images.reshape(-1, 3).tolist()}
    assert any(red > 150 and blue < 50 for red, _, blue in colours)
    assert any(blue > 150 and red < 50 for red, _, blue in colours)


def test_methods_that_are_painted():
    """Methods that draw clouds in grey are painted, but for those that draw points themselves."""
    cloud = PointCloud(np.zeros((3, 3)), colors=np.zeros((3, 3)))
    painted = {
        name: is_painted(find_method(name), cloud)
        for name in (
            *("alpha-wrap", "splat-fill", "fused-net@grey"),
            *("splat", "splat@spread=2", "fused-net", "true-mesh", "true-mesh@grey", "blank"),
        )
    }
    assert [name for name in painted if painted[name]] == list(painted)[:3]
    assert not is_painted(find_method("alpha-wrap"), PointCloud(cloud.points))


def test_keys_are_others_than_without_colours_and_true_images_the_same():
    made = {
        suite.truth: plan(make_protocol(suite=suite, objects=(Box(),), views=2))[0]
        for suite in (SUITES[0], COLOURED)
    }
    plain, coloured = made["coloured"], made["coloured-clouds"]
    assert not {job.key for job in plain.jobs} & {job.key for job in coloured.jobs}
    assert plain.truth.object.fingerprint() == "box"
    assert plain.truth.views == coloured.truth.views
    assert run_job(plain.truth).arrays == run_job(coloured.truth).arrays


def test_objects_without_a_mesh_are_refused(tmp_path):
    stored = StoredFile(tmp_path / "a.ply", "0")
    exported = ExportedObject("chair", "a", stored, (("2048", stored),), ((View(0, 0), stored),))
    for obj in (PaperObject("chair", "a", tmp_path / "a.ply", tmp_path), exported):
        with pytest.raises(BadInput, match="chair/a has a cloud without colours, and chair-robust"):
            plan(make_protocol(suite=COLOURED, objects=(obj,), views=1))


@pytest.mark.slow
def test_a_run_and_its_tables(command, refused, tmp_path):
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    box().export(meshes / "box.ply")
    out, methods = tmp_path / "run", "splat-fill,splat,blank"
    options = ("--suite", "chair-robustness", "--dataset", f"folder:{meshes}")
    options += ("--methods", methods, "--conditions", "2048,8192", "--views", "2")
    options += ("--workers", "1", "--out", out)
    status, _, err = command("run", *options, "--truth", "coloured-clouds")
    assert (status, "0 failed" in err) == (0, True)
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["truth"] == manifest["request"]["truth"] == "coloured-clouds"
    head = (out / "tables" / "table_ssim.md").read_text().splitlines()[0]
    assert f"against {TRUTHS['coloured-clouds']}; protocol" in head
    assert not (out / "tables" / "table3_ssim.md").exists()  # the paper asks another question
    again = command("check", out, "--again", "0.5", "--seed", "1")
    assert (again[0], again[1].strip().endswith("all equal")) == (0, True)
    assert "truth" in refused("run", *options)
    export = ("data", "export", "--truth", "coloured-clouds", "--out", tmp_path / "export")
    assert refused(*export).startswith("--truth coloured-clouds: an export keeps no colours")
    assert not (tmp_path / "export").exists()
