from __future__ import annotations

import math

import numpy as np
import pytest

from baselines.reconstruction.poisson import Poisson, trimmed
from baselines.reconstruction.surface import closed_surface
from data_prep.clouds.sampling import face_areas, sample_surface
from data_prep.failures import StageFailure
from data_prep.scene import Mesh, PointCloud
from data_prep.shapes.chair.chairs import chair
from tests.baselines.clouds import RADIUS, faces_of_edges, lattice_sphere


def test_a_sphere() -> None:
    state = Poisson(depth=6).prepare(PointCloud(lattice_sphere()))
    # A cell is 1.1 * 2 * 0.7 / 2^6 = 0.024; linear interpolation of a quadratic in a cell is off by
    # at most its sag, cell^2 / (8 r) = 1e-4, and screening pulls the surface to the points, which a
    # flat facet between them leaves by spacing^2 / (8 r) = 3e-4. Ten times that is not seen.
    error = np.linalg.norm(state.mesh.vertices.astype(np.float64), axis=1) - RADIUS
    assert np.abs(error).max() < 4e-3
    assert (faces_of_edges(state.mesh.faces) == 2).all()  # nothing was trimmed
    coarse = Poisson(depth=4).prepare(PointCloud(lattice_sphere())).mesh
    assert len(state.mesh.faces) > 3 * len(coarse.faces)


def test_points_without_a_normal_are_left_out() -> None:
    rng = np.random.default_rng(5)
    points = sample_surface(chair(rng), rng).points[::4]
    # Two points of this chair have none, by MeshLab 2025.7, and it would refuse the cloud.
    assert (np.linalg.norm(closed_surface(points).normals(), axis=1) == 0).any()
    assert len(Poisson(depth=5).prepare(PointCloud(points)).mesh.faces) > 100


def test_a_bowl_stays_open() -> None:
    points = lattice_sphere(4096)
    points = points[points[:, 1] < 0]
    spacing = math.sqrt(4 * math.pi * RADIUS**2 / 4096)
    area = face_areas(Poisson(depth=6).prepare(PointCloud(points)).mesh).sum()
    # Half a sphere, and a rim at most twice as wide as the spacing; Poisson alone closes it with a
    # lid of at least pi r^2, half as much again.
    rim = 2 * math.pi * RADIUS * 2 * spacing
    assert area == pytest.approx(2 * math.pi * RADIUS**2, abs=rim)
    assert rim < math.pi * RADIUS**2 / 2


def test_what_is_far_from_the_points_is_trimmed() -> None:
    # A square lattice of unit spacing: at an inner point the 16 nearest places are itself, 4 at 1,
    # 4 at sqrt 2, 4 at 2, and 3 of 8 at sqrt 5: half of that is the spacing.
    row, column = np.mgrid[:30, :30]
    points = np.stack([row, column, np.zeros_like(row)], axis=-1).reshape(-1, 3).astype(np.float32)
    spacing = math.sqrt(5) / 2
    heights = np.array([0.0, 0.99, 1.01, 5.0]) * spacing
    corners = np.array([[10, 10, 0], [11, 10, 0], [10, 11, 0]], np.float64)
    vertices = np.concatenate([corners + np.array([0, 0, height]) for height in heights])
    faces = np.arange(12).reshape(4, 3)
    colors = np.arange(12).reshape(4, 3)
    whole = Mesh(vertices, [*faces, [0, 1, 8]], [*colors, [9, 9, 9]])
    kept = trimmed(whole, points)
    assert kept.faces.tolist() == faces[:2].tolist()  # not the one with one far corner
    assert kept.face_colors.tolist() == colors[:2].tolist()
    with pytest.raises(StageFailure, match=r"no face within 1\.12 of the points"):
        trimmed(Mesh(vertices, faces[2:], colors[2:]), points)
