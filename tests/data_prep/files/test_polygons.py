"""Polygons, strips and fans divided into triangles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_prep.files.polygons import triangles_of_polygons, triangles_of_strips

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
ARROW = [(0, 0), (2, 0), (0.5, 0.5), (0, 2)]  # its third corner points inwards; area 1
BAR = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]  # an L; area 5
DENT = [(0, 0), (2, 0), (2, 1), (1, 0.999), (0, 1)]  # turns inwards by 0.002; area 1.999


def flat(*polygons: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """The corners [C, 3] of polygons in the plane z = 0, and their lengths."""
    corners = [(*corner, 0.0) for polygon in polygons for corner in polygon]
    return np.array(corners, float), np.array([len(polygon) for polygon in polygons])


def areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Signed areas: those of triangles that turn clockwise are negative."""
    a, b, c = (points[triangles[:, i], :2] for i in range(3))
    first, second = b - a, c - a
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2


def test_convex_polygons_are_fans_around_their_first_corner() -> None:
    hexagon = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3]
    straight = [(0, 0), (0.5, 1e-7), *SQUARE[1:]]  # but for the rounding of float32
    points, lengths = flat(SQUARE, hexagon, SQUARE[:3], SQUARE[:2], [], straight)
    triangles, polygons = triangles_of_polygons(points, lengths)
    fan = [[4, 5, 6], [4, 6, 7], [4, 7, 8], [4, 8, 9]]
    fan += [[10, 11, 12], [15, 16, 17], [15, 17, 18], [15, 18, 19]]
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], *fan]
    assert polygons.tolist() == [0, 0, 1, 1, 1, 1, 2, 5, 5, 5]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("shape", "size"), [(ARROW, 1), (BAR, 5), (DENT, 1.999)])
def test_concave_polygons_have_their_area_from_any_first_corner(shape, size, turned: bool) -> None:
    for first in range(len(shape)):
        polygon = shape[first:] + shape[:first]
        points, lengths = flat(SQUARE, polygon[::-1] if turned else polygon, SQUARE)
        triangles, polygons = triangles_of_polygons(points, lengths)
        parts = (-1 if turned else 1) * areas(points, triangles)[polygons == 1]
        assert parts.sum() == pytest.approx(size, abs=1e-12)
        assert (parts >= 0).all()  # no triangle lies outside or turns round
        assert polygons.tolist() == [0, 0, *[1] * (len(shape) - 2), 2, 2]


def test_concave_polygons_behind_many_others_and_with_a_corner_twice() -> None:
    arrow = ARROW[1:] + ARROW[:1]  # a fan around its first corner covers more than the arrow
    points, lengths = flat(*[SQUARE] * 9000, arrow, arrow[:1] + arrow)
    triangles, polygons = triangles_of_polygons(points, lengths)
    parts = areas(points, triangles)
    assert parts.min() >= 0
    assert np.bincount(polygons, parts)[-3:] == pytest.approx([1, 1, 1])


@given(
    radii=st.lists(st.floats(0.05, 2.0), min_size=5, max_size=12),
    normal=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
        lambda n: sum(x * x for x in n) > 0.01
    ),
    shift=st.floats(-100, 100),
)
def test_star_shaped_polygons_in_any_plane(radii, normal, shift: float) -> None:
    angles = np.arange(len(radii)) * 2 * np.pi / len(radii)
    axis = np.array(normal) / np.linalg.norm(normal)
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    r = np.array(radii)[:, None]
    points = r * (np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v) + shift
    triangles, _ = triangles_of_polygons(points, np.array([len(radii)]))
    a, b, c = (points[triangles[:, i]] for i in range(3))
    parts = np.cross(b - a, c - a) @ axis / 2
    # Sectors of the polygon: r_i r_(i+1) sin(angle) / 2 each. float64 at 100 keeps 1e-14 of 100.
    expected = sum(r[:, 0] * np.roll(r[:, 0], -1)) * np.sin(angles[1]) / 2
    assert parts.sum() == pytest.approx(expected, rel=1e-9)
    assert parts.min() > -1e-9


@pytest.mark.parametrize("apart", [0.0, 1e-9])
def test_a_corner_that_stands_twice_hides_no_concave_one(apart: float) -> None:
    twin = (ARROW[2][0] + apart, ARROW[2][1])
    for polygon in ([*ARROW[1:3], twin, ARROW[3], ARROW[0]], [*BAR[:4], BAR[3], *BAR[4:]]):
        for first in range(len(polygon)):
            points, lengths = flat(polygon[first:] + polygon[:first])
            triangles, _ = triangles_of_polygons(points, lengths)
            area = 1 if len(polygon) == 5 else 5
            assert areas(points, triangles).sum() == pytest.approx(area, abs=1e-8)


def test_polygons_without_area_or_with_broken_places_stay_fans() -> None:
    line = [(0, 0), (1, 0), (2, 0), (3, 0), (1.5, 0)]
    broken = [(0, 0), (np.nan, 0), (1, 1), (np.inf, 2), (0, 3)]
    for polygon in (line, broken, [(1, 1)] * 5):
        triangles, _ = triangles_of_polygons(*flat(polygon))
        assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_strips_turn_every_second_triangle_round() -> None:
    zigzag = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)]
    points, lengths = flat(zigzag, zigzag[:2], zigzag[:3])
    triangles, strips = triangles_of_strips(lengths)
    assert strips.tolist() == [0, 0, 0, 2]
    assert areas(points, triangles).tolist() == [-0.5] * 4
