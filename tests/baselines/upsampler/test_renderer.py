from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from baselines.reconstruction.stages import FOOTPRINT
from baselines.upsampler.network import Upsampler
from baselines.upsampler.projection import LearnedSurface
from baselines.upsampler.renderer import UpsampledWrapRenderer, laid_onto, turned_faces
from data_prep.failures import StageFailure
from data_prep.scene import Mesh, PointCloud
from learning.weights import NetworkWeights
from tests.baselines.clouds import RADIUS, faces_of_edges, lattice_sphere
from tests.baselines.upsampler.test_network import SMALL


def renderer(network: Upsampler | None = None) -> UpsampledWrapRenderer:
    """Return a renderer by the classical planes alone, as before training."""
    network = network or Upsampler(SMALL).eval().requires_grad_(False)
    return UpsampledWrapRenderer(NetworkWeights(network, {}, ""))


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return trimesh.triangles.normals(vertices[faces])[0]


def test_faces_turn_to_given_normals_and_right_ones_stay() -> None:
    box = trimesh.creation.box((1.0, 1.0, 1.0)).subdivide().subdivide()
    vertices, faces = np.asarray(box.vertices), np.asarray(box.faces)
    normals = face_normals(vertices, faces)
    np.testing.assert_allclose(turned_faces(vertices, faces, -normals), vertices, atol=1e-12)
    rough = vertices + np.random.default_rng(0).normal(size=vertices.shape) * 0.02
    smooth = turned_faces(rough, faces, normals)
    before, after = (
        np.degrees(np.arccos((face_normals(v, faces) * normals).sum(axis=1).clip(-1, 1)))
        for v in (rough, smooth)
    )
    assert np.median(after) < np.median(before) / 8
    assert np.abs(smooth - vertices).mean() < np.abs(rough - vertices).mean()


def test_a_sphere_is_closed_round_and_as_fine_as_the_image() -> None:
    points = lattice_sphere(512)
    mesh = renderer().prepare(PointCloud(points)).mesh
    assert (faces_of_edges(mesh.faces) == 2).all()
    radii = np.linalg.norm(mesh.vertices, axis=1)
    # Planes that touch a sphere a spacing away, of .11, are .11^2 / 1.4 farther out.
    np.testing.assert_allclose(np.median(radii), RADIUS + 0.005, rtol=0, atol=0.005)
    assert radii.std() < 0.003
    edges = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
    assert np.median(np.linalg.norm(edges, axis=2)) <= 1.7 * FOOTPRINT


def test_corners_far_from_all_points_stay_where_they_are() -> None:
    surface = LearnedSurface(Upsampler(SMALL).eval(), lattice_sphere(512).astype(np.float32))
    near, far = np.array([[0, 0, RADIUS + 0.01]]), np.array([[0.0, 0.0, 0.0]])
    found = surface.project(np.concatenate([near, far]))
    assert np.linalg.norm(found.points[0]) == pytest.approx(RADIUS + 0.005, abs=0.005)
    np.testing.assert_array_equal(found.points[1], far[0])
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, rtol=1e-6)
    assert len(surface.upsampled(16).points) == 16 * 512
    mesh = Mesh(np.eye(3) * 10, [[0, 1, 2]], [[0, 0, 0]])
    np.testing.assert_allclose(laid_onto(surface, mesh).vertices[:3], np.eye(3) * 10, atol=3)


def line(count: int) -> np.ndarray:
    return np.linspace(-1, 1, count)[:, None] * [[1, 0, 0]]


def test_lines_planes_and_clouds_far_apart_are_covered() -> None:
    rng = np.random.default_rng(0)
    ball = lattice_sphere(300) * 0.2
    aside = np.array([0.7, 0, 0])
    two = np.concatenate([ball - aside, ball + aside])
    for points in (line(50), rng.uniform(-0.7, 0.7, (500, 3)) * [1, 1, 0], two, line(11)):
        mesh = renderer().prepare(PointCloud(points)).mesh
        assert np.isfinite(mesh.vertices).all()
        distance = np.linalg.norm(mesh.vertices[None] - points[:, None], axis=2).min(axis=1)
        assert distance.max() < 0.05


def test_failures_have_names() -> None:
    class Broken(Upsampler):
        factor = torch.nan

        def project(self, cloud, places, nearest):
            points, normals = super().project(cloud, places, nearest)
            return points * self.factor, normals

    far_away = Broken(SMALL)
    far_away.factor = 100.0  # of a unit; at 1e7 MeshLab would not end

    rng = np.random.default_rng(0)
    cases = (
        (renderer(), np.full((50, 3), 0.5), "input", "1 of 50 points are different"),
        (renderer(), rng.uniform(-1, 1, (10, 3)), "input", "10 points; surfaces need at least 11"),
        (renderer(), np.full((20, 3), np.nan), "input", "20 of 20 points are not finite"),
        (renderer(Broken(SMALL)), lattice_sphere(50), "up-sampling", "are not finite"),
        (renderer(far_away), lattice_sphere(50), "up-sampling", "are far away"),
    )
    for method, points, stage, problem in cases:
        with pytest.raises(StageFailure) as failure:
            method.prepare(PointCloud(points))
        assert failure.value.stage == stage
        assert problem in failure.value.problem
