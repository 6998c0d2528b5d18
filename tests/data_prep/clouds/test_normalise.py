from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from data_prep.clouds.normalise import normalise, normalise_points, real_points
from data_prep.failures import BadInput
from data_prep.scene import Mesh

# Coordinates are rounded to float32 once, so each is off by at most half a unit in the last place
# of 1: 2**-25. Three of them move a radius by at most sqrt(3) times that, below one eps (2**-23).
ROUNDING = float(np.finfo(np.float32).eps)


def triangle(vertices: Any, faces: Any = ((0, 1, 2),)) -> Mesh:
    return Mesh(vertices, faces, np.full((len(faces), 3), 7))


def test_closed_form_of_a_mesh_and_a_cloud() -> None:
    # Box 6 x 8 x 0 centred at (4, 6, 1): the corner (3, 4, 0) lies at radius 5.
    mesh = normalise(triangle([[1, 2, 1], [7, 2, 1], [1, 10, 1]]))
    made = normalise_points(np.array([[1, 2, 1], [7, 2, 1], [1, 10, 1], [4, 6, 1]]))
    expected = [[-0.6, -0.8, 0.0], [0.6, -0.8, 0.0], [-0.6, 0.8, 0.0], [0, 0, 0]]
    np.testing.assert_allclose(mesh.vertices, expected[:3], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(made.points, expected, rtol=0, atol=ROUNDING)
    assert made.source is None


def test_far_from_the_origin_is_centred_in_float64() -> None:
    # float32 has 2**-3 = 0.125 between neighbours at 2**20; the input's own steps must survive.
    offset = 2.0**20
    mesh = normalise(triangle([[offset, 0, 0], [offset + 1, 0, 0], [offset, 1, 0]]))
    half = 0.5 / np.sqrt(0.5)
    expected = [[-half, -half, 0], [half, -half, 0], [-half, half, 0]]
    np.testing.assert_allclose(mesh.vertices, expected, rtol=0, atol=ROUNDING)


def test_unused_vertices_do_not_count_and_faces_and_colours_stay() -> None:
    vertices = [[1, 2, 1], [7, 2, 1], [1, 10, 1]]
    alone, mesh = triangle(vertices), triangle([*vertices, [1000, 0, 0]])
    crowded = normalise(mesh)
    np.testing.assert_array_equal(crowded.vertices[:3], normalise(alone).vertices)
    np.testing.assert_array_equal(crowded.faces, mesh.faces)
    np.testing.assert_array_equal(crowded.face_colors, mesh.face_colors)


@pytest.mark.parametrize(
    ("vertices", "faces", "problem"),
    [
        (np.zeros((3, 3)), np.zeros((0, 3)), "no faces"),
        ([(0, 0, 0), (1, 0, 0), (np.nan, 0, 0), (0, 0, 0), (0, np.inf, 0)], [(0, 1, 3)],
         "2 non-finite vertices of 5 .*vertex 2"),
        ([(0, -np.inf, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)], "1 non-finite vertices of 3"),
        ([(1, 2, 3)] * 3 + [(9, 9, 9)], [(0, 1, 2)], "all 3 vertices"),  # the last is not used
    ],
)  # fmt: skip
def test_meshes_that_cannot_be_used(vertices: object, faces: object, problem: str) -> None:
    with pytest.raises(BadInput, match=problem):
        normalise(triangle(vertices, faces))


def cloud(count: int = 200) -> np.ndarray:
    return np.random.default_rng(5).normal(size=(count, 3)) * [1.0, 2.0, 0.5]


@pytest.mark.parametrize("kind", ["f2", ">f8", "longdouble", "i2", "u8"])
def test_any_real_dtype(kind: str) -> None:
    values = np.array([[1, 2, 1], [7, 2, 1], [1, 10, 1]], float)
    given = values.astype(kind)
    made = normalise_points(given)
    np.testing.assert_array_equal(made.points, normalise_points(values).points)
    np.testing.assert_array_equal(given, values)


@pytest.mark.parametrize("exponent", [-1020, -1, 1, 1020])
def test_powers_of_two_change_nothing(exponent: int) -> None:
    # Scaling by a power of two rounds nothing, so every bit has to be the same. Few bits in the
    # values, so that none is lost where they become subnormal (2**-1020 times 2**-10 is one).
    points = np.round(cloud() * 2**8) / 2**10
    scaled = normalise_points(np.ldexp(points, exponent))
    assert scaled.points.tobytes() == normalise_points(points).points.tobytes()


@pytest.mark.parametrize("shift", [1.0, -1e6, 1e9])
def test_a_shift_does_not_matter(shift: float) -> None:
    # Near `shift` float64 has a spacing of at most 2**-52 * |shift|, and each coordinate is moved
    # by up to half of that. So are centre and radius (each by at most sqrt(3) of it in space; the
    # radius is above 1 here): less than four times in all; then float32.
    points = cloud()
    moved = points + np.array([shift, -shift, shift])
    lost = 4 * np.sqrt(3) * 2.0**-53 * 1.01 * abs(shift)
    made, expected = (normalise_points(given).points for given in (moved, points))
    np.testing.assert_allclose(made, expected, rtol=0, atol=lost + 2.0**-24)


@pytest.mark.parametrize(
    "points",
    [
        [[1e300, 1e-300, 0], [1e300, 3e-300, 0]],
        [[-1.7e308, 0, 0], [1.7e308, 0, 0]],
        [[0, 0, 0], [5e-324, 0, 0]],
        [[1e6, 1e6, 1e6], [1e6, 1e6, 1e6 + 1e-9]],
    ],
    ids=["tiny-beside-huge", "the-largest", "the-smallest", "one-step-of-float64"],
)
def test_no_overflow_and_no_underflow(points: list[list[float]]) -> None:
    made = normalise_points(np.array(points)).points
    assert np.linalg.norm(made, axis=1).tolist() == [1.0, 1.0]
    np.testing.assert_array_equal(made[0], -made[1])


def test_a_normalised_cloud_stays_as_it_is() -> None:
    made = normalise_points(cloud())
    assert abs(np.linalg.norm(made.points.astype(float), axis=1).max() - 1.0) <= ROUNDING
    again = normalise_points(made.points)
    np.testing.assert_allclose(again.points, made.points, rtol=0, atol=2 * ROUNDING)


def test_masked_points_are_left_out() -> None:
    points = np.ma.masked_less(np.vstack([cloud(9), [[-9999, 1, 2], [1, 2, -9999]]]), -9000)
    with pytest.warns(UserWarning, match="2 of 11 points are masked, and left out"):
        made = normalise_points(real_points(points))
    np.testing.assert_array_equal(made.points, normalise_points(real_points(cloud(9))).points)


BROKEN = cloud(9)
BROKEN[2, 1], BROKEN[4] = np.nan, -np.inf
NO_LIST = r"expected real numbers \[N, 3\], got"


@pytest.mark.parametrize(
    ("points", "error", "says"),
    [
        (np.zeros((0, 3)), BadInput, r"the cloud has no points \(0\)"),
        (BROKEN, BadInput, r"2 non-finite points of 9 .*point 2\); remove them"),
        (np.full((1, 3), 0.0), BadInput, r"^all 1 points are equal, at \[0\.0, "),
        (np.full((3, 3), 5e-324), BadInput, r"^all 3 points are equal, at \[5e-324, "),
        (np.full((2, 3), 1e308), BadInput, r"^all 2 points are equal, at \[1e\+308, "),
        (np.zeros((3, 2)), ValueError, NO_LIST),
        (np.zeros(3), ValueError, NO_LIST),
        (np.zeros((2, 3, 1)), ValueError, NO_LIST),
        (np.zeros((2, 3), complex), ValueError, NO_LIST),
    ],
)
def test_clouds_that_cannot_be_used(points: np.ndarray, error: type, says: str) -> None:
    with pytest.raises(error, match=says):
        normalise_points(points)
