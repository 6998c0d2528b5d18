from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from baselines.reconstruction.alpha_wrap import OFFSET, AlphaWrap, DenoisedWrap, wrapped
from baselines.reconstruction.stages import FOOTPRINT, Nearest, spacing
from data_prep.scene import Mesh, PointCloud
from tests.baselines.clouds import RADIUS, chair_cloud, faces_of_edges, lattice_sphere


def volume(mesh: Mesh) -> float:
    """Return the volume that the faces enclose; positive where they turn outwards."""
    a, b, c = np.moveaxis(mesh.vertices.astype(np.float64)[mesh.faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def test_a_sphere_has_one_wall_at_the_offset_and_for_a_smaller_ball_two() -> None:
    mesh = wrapped(lattice_sphere(), 0.1, 0.02).mesh
    assert (faces_of_edges(mesh.faces) == 2).all()
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert radii.max() == pytest.approx(RADIUS + 0.02, abs=1e-3)
    assert radii.min() > RADIUS  # between points the ball sinks in
    assert 4 / 3 * np.pi * RADIUS**3 < volume(mesh) < 4 / 3 * np.pi * (RADIUS + 0.02) ** 3
    leaky = wrapped(lattice_sphere(512), 0.08, 0.01).mesh
    inner = np.linalg.norm(leaky.vertices, axis=1) < RADIUS
    assert inner.mean() == pytest.approx(0.5, abs=0.1)
    assert volume(leaky) < 0.2


def test_sheets_become_slabs() -> None:
    flat = np.random.default_rng(0).uniform(-0.5, 0.5, (1024, 3)) * [1, 1, 0]
    slab = AlphaWrap().prepare(PointCloud(flat)).mesh
    assert (faces_of_edges(slab.faces) == 2).all()
    thickness = 2 * OFFSET * spacing(Nearest(flat))
    np.testing.assert_allclose(np.ptp(slab.vertices[:, 2]), thickness, rtol=0.01)
    assert volume(slab) == pytest.approx(thickness, rel=0.1)  # of a square of side 1


def test_nothing_is_finer_than_the_image() -> None:
    points = lattice_sphere(2048) * 0.1
    finest = wrapped(points, 1e-9, 1e-9).mesh
    expected = wrapped(points, FOOTPRINT, FOOTPRINT / 4).mesh
    np.testing.assert_array_equal(finest.vertices, expected.vertices)


@pytest.mark.parametrize("points", [np.eye(3)[:1], np.eye(3)[:2]], ids=["one", "two"])
def test_each_point_apart_gets_a_wrap_of_its_own(points: np.ndarray) -> None:
    mesh = wrapped(points, 0.1, 0.01).mesh
    distance, nearest = cKDTree(points).query(mesh.vertices)
    assert set(np.ravel(nearest)) == set(range(len(points)))
    assert np.max(distance) < 0.02


def test_clean_points_are_wrapped_as_they_are_and_noisy_ones_smoothed_first() -> None:
    cloud = chair_cloud()
    plain, smooth = AlphaWrap().prepare(cloud), DenoisedWrap().prepare(cloud)
    np.testing.assert_array_equal(smooth.mesh.vertices, plain.mesh.vertices)
    assert plain.notes == smooth.notes == ()
    noisy = lattice_sphere() + np.random.default_rng(0).normal(scale=0.10, size=(2048, 3))
    plain, smooth = (m.prepare(PointCloud(noisy)).mesh for m in (AlphaWrap(), DenoisedWrap()))
    rough, smoother = (np.linalg.norm(mesh.vertices, axis=1).std() for mesh in (plain, smooth))
    assert smoother < rough / 2
