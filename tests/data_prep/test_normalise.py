from __future__ import annotations

import numpy as np
import pytest

from data_prep.failures import BadInput
from data_prep.normalise import normalise
from data_prep.scene import Mesh

# Coordinates are rounded to float32 once, so each is off by at most half a unit in the last place
# of 1: 2**-25. Three of them move a radius by at most sqrt(3) times that, below one eps (2**-23).
ROUNDING = float(np.finfo(np.float32).eps)


def triangle(vertices: object, faces: object = ((0, 1, 2),)) -> Mesh:
    count = len(np.reshape(np.asarray(faces), (-1, 3)))
    return Mesh(
        np.asarray(vertices, dtype=np.float32),
        np.asarray(faces, dtype=np.int32).reshape(-1, 3),
        np.full((count, 3), 7, dtype=np.uint8),
    )


def extent(mesh: Mesh) -> tuple[np.ndarray, float]:
    used = mesh.vertices[np.unique(mesh.faces)].astype(np.float64)
    return (used.min(axis=0) + used.max(axis=0)) / 2, float(np.linalg.norm(used, axis=1).max())


def test_closed_form() -> None:
    # Box 6 x 8 x 0 centred at (4, 6, 1): the corner (3, 4, 0) lies at radius 5.
    mesh = normalise(triangle([[1, 2, 1], [7, 2, 1], [1, 10, 1]]))
    expected = [[-0.6, -0.8, 0.0], [0.6, -0.8, 0.0], [-0.6, 0.8, 0.0]]
    np.testing.assert_allclose(mesh.vertices, expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("scale", [1e-30, 1e-6, 1.0, 1e6, 1e30])
def test_any_scale_lands_on_the_unit_sphere(scale: float) -> None:
    rng = np.random.default_rng(3)
    vertices = (rng.normal(size=(30, 3)) + 2.0) * scale
    mesh = normalise(triangle(vertices, np.arange(30).reshape(-1, 3)))
    centre, radius = extent(mesh)
    assert np.abs(centre).max() <= ROUNDING
    assert abs(radius - 1.0) <= ROUNDING


def test_far_from_the_origin_is_centred_in_float64() -> None:
    # float32 has 2**-3 = 0.125 between neighbours at 2**20; the input's own steps must survive.
    offset = 2.0**20
    mesh = normalise(triangle([[offset, 0, 0], [offset + 1, 0, 0], [offset, 1, 0]]))
    half = 0.5 / np.sqrt(0.5)
    expected = [[-half, -half, 0], [half, -half, 0], [-half, half, 0]]
    np.testing.assert_allclose(mesh.vertices, expected, rtol=0, atol=ROUNDING)


def test_unused_vertices_do_not_count() -> None:
    vertices = [[1, 2, 1], [7, 2, 1], [1, 10, 1]]
    alone = normalise(triangle(vertices))
    crowded = normalise(triangle([*vertices, [1000, 0, 0]]))
    np.testing.assert_array_equal(crowded.vertices[:3], alone.vertices)


def test_idempotent_and_leaves_the_rest_alone() -> None:
    mesh = triangle([[1, 2, 3], [7, 2, 1], [1, 10, 1]])
    once = normalise(mesh)
    np.testing.assert_array_equal(once.faces, mesh.faces)
    np.testing.assert_array_equal(once.face_colors, mesh.face_colors)
    np.testing.assert_allclose(normalise(once).vertices, once.vertices, rtol=0, atol=2 * ROUNDING)


def test_no_faces() -> None:
    with pytest.raises(BadInput, match="no faces"):
        normalise(triangle(np.zeros((3, 3)), np.zeros((0, 3))))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_non_finite_vertices_are_counted_and_located(value: float) -> None:
    vertices = np.arange(15.0).reshape(5, 3)
    vertices[2, 1] = vertices[4, 0] = value
    with pytest.raises(BadInput, match=r"2 non-finite vertices of 5 .*vertex 2"):
        normalise(triangle(vertices))


def test_no_extent() -> None:
    vertices = [[1, 2, 3], [1, 2, 3], [1, 2, 3], [9, 9, 9]]  # the last is not used
    with pytest.raises(BadInput, match="all 3 vertices"):
        normalise(triangle(vertices, [[0, 1, 2]]))
