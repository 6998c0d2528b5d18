from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import Delaunay

from baselines.reconstruction.alpha_shape import (
    AlphaShape,
    alpha_faces,
    circumradius,
    smallest_sphere,
)
from data_prep.failures import StageFailure
from data_prep.scene import NEUTRAL_GREY, PointCloud
from tests.baselines.clouds import faces_of_edges, lattice_sphere


def exposed(points: np.ndarray, radius: float) -> set[tuple[int, ...]]:
    """The definition: triangles that a ball of `radius` touches from outside, with no point in it.

    It goes through all triples, and knows nothing of Delaunay.
    """
    actual = set()
    for triple in itertools.combinations(range(len(points)), 3):
        a, b, c = points[list(triple)]
        normal = np.cross(b - a, c - a)
        # The centre of the circumcircle, from |x - a| = |x - b| = |x - c| in the plane.
        rows = np.array([b - a, c - a, normal])
        target = [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, normal @ a]
        centre = np.linalg.solve(rows, target)
        height = radius**2 - ((a - centre) ** 2).sum()
        if height < 0:
            continue
        others = np.delete(points, triple, axis=0)
        for side in (1, -1):
            ball = centre + side * math.sqrt(height) * normal / np.linalg.norm(normal)
            if (((others - ball) ** 2).sum(axis=1) > radius**2).all():
                actual.add(triple)
    return actual


def found_faces(points: np.ndarray, radius: float) -> list[tuple[int, ...]]:
    cells = Delaunay(points)
    faces = alpha_faces(points, cells.simplices, cells.neighbors, radius)
    return [tuple(sorted(face)) for face in faces.tolist()]


@pytest.mark.parametrize("flat", [1.0, 0.15])  # a ball, and a thick sheet with single triangles
@pytest.mark.parametrize("radius", [0.25, 0.4, 0.6, 1.0, 5.0])
def test_the_faces_are_those_that_a_ball_can_touch(radius: float, flat: float) -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (22, 3)) * [1, 1, flat]
    faces = found_faces(points, radius)
    assert len(faces) == len(set(faces))
    assert set(faces) == exposed(points, radius)


def test_a_huge_ball_leaves_the_convex_hull() -> None:
    points = np.random.default_rng(0).normal(size=(60, 3))
    hull = {tuple(sorted(face)) for face in Delaunay(points).convex_hull.tolist()}
    assert set(found_faces(points, 1e6)) == hull


def test_circumscribed_spheres() -> None:
    regular = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float64)
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float64)
    actual = circumradius(np.stack([regular, 3 * regular + 7, flat]))
    np.testing.assert_allclose(actual[:2], [math.sqrt(3), 3 * math.sqrt(3)], rtol=1e-12)
    assert not actual[2] <= 1e9
    right = np.array([[0, 0, 1], [3, 0, 1], [0, 4, 1]], np.float64)  # its hypotenuse is 5
    centre, radius = smallest_sphere(np.stack([right, right - 2]))
    np.testing.assert_allclose(centre, [[1.5, 2, 1], [-0.5, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(radius, 2.5, rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_sphere_is_closed_at_any_scale(scale: float) -> None:
    # The diagonal of its box is 2.42; 5 % of it, 0.12, is more than the 0.08 between points.
    state = AlphaShape().prepare(PointCloud(scale * lattice_sphere(1000)))
    outer = state.mesh.faces
    assert (faces_of_edges(outer) % 2 == 0).all()
    # Outside: a triangulation of all points. A ball fits inside too, and sees the same faces.
    assert len(outer) == 2 * 1000 - 4
    assert (state.mesh.face_colors == NEUTRAL_GREY).all()
    assert state.notes == ()


def test_alpha_is_a_share_of_the_diagonal() -> None:
    # A regular tetrahedron of side sqrt 2 in a box of diagonal sqrt 3: the circumcircles of its
    # faces have radius sqrt(2 / 3), which is 47.1 % of that.
    cloud = PointCloud(np.append(np.eye(3), [[1, 1, 1]], axis=0) - 7)
    assert len(AlphaShape(alpha_percent=47.2).prepare(cloud).mesh.faces) == 4
    with pytest.raises(StageFailure, match=r"no triangle fits a ball of radius 0\.814"):
        AlphaShape(alpha_percent=47.0).prepare(cloud)
