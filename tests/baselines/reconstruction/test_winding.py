from __future__ import annotations

import math

import numpy as np
import pytest

from baselines.reconstruction.poisson import trimmed_poisson
from baselines.reconstruction.winding import outward_normals
from tests.baselines.clouds import RADIUS, lattice_sphere

SPHERE = lattice_sphere(1000).astype(np.float32)
OUTWARD = SPHERE / RADIUS


def box(half: tuple[float, float, float], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points on the surface of a box, and the outward normals of its sides."""
    rng = np.random.default_rng(2)
    size = np.array(half)
    areas = np.tile(size.prod() / size, 2)
    side = rng.choice(6, count, p=areas / areas.sum())
    rows, axis, sign = np.arange(count), side % 3, np.where(side < 3, 1.0, -1.0)
    points, normals = rng.uniform(-1, 1, (count, 3)), np.zeros((count, 3))
    points[rows, axis] = normals[rows, axis] = sign
    return (points * size).astype(np.float32), normals


def outward(normals: np.ndarray, true: np.ndarray) -> float:
    return float(((normals * true).sum(axis=1) > 0).mean())


def test_normals_of_a_sphere_are_its_radii() -> None:
    normals = outward_normals(SPHERE)
    np.testing.assert_allclose((normals * OUTWARD).sum(axis=1), 1, atol=0.01)


@pytest.mark.parametrize("half", [(0.5, 0.4, 0.3), (0.7, 0.5, 0.05), (0.7, 0.06, 0.06)])
def test_normals_of_boxes_turn_outwards(half: tuple[float, float, float]) -> None:
    """A cube, a plate and a rod; 2,000 points are 0.03 to 0.04 apart on the plate."""
    points, normals = box(half, 2000)
    assert outward(outward_normals(points), normals) > 0.99


def test_noise_leaves_the_orientation() -> None:
    """A quarter of a spacing of the points; from about half of one on they are smoothed before."""
    spacing = RADIUS * math.sqrt(4 * math.pi / len(SPHERE))
    noisy = SPHERE + np.random.default_rng(0).normal(scale=spacing / 4, size=SPHERE.shape)
    assert outward(outward_normals(noisy.astype(np.float32)), OUTWARD) > 0.95


@pytest.mark.parametrize("scale", [1e-30, 1e6])
def test_neither_scale_nor_place_matters(scale: float) -> None:
    moved = (scale * (SPHERE + np.float32(0.5))).astype(np.float32)
    np.testing.assert_allclose(outward_normals(moved), outward_normals(SPHERE), atol=0.01)


def test_poisson_from_given_normals() -> None:
    mesh = trimmed_poisson(SPHERE, 6, OUTWARD, weight=10.0, reach=1.5).mesh
    radii = np.linalg.norm(mesh.vertices.astype(np.float64), axis=1)
    assert np.abs(radii - RADIUS).max() < 0.02  # a cell of the octree is 0.024
    corners = mesh.vertices[mesh.faces]
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((turned * corners[:, 0]).sum(axis=1) > 0).mean() > 0.99
