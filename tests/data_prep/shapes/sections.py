"""Measures of drawn objects: where a plane cuts them, what is inside, how large they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.solids import Part, signed_volume
from tests.data_prep.shapes.solid_checks import winding


def cut(parts: Sequence[Part], axis: int, at: float) -> np.ndarray:
    """Points [n, 3] where edges of faces cross the plane on which that coordinate is `at`."""
    found = []
    for part in parts:
        corners = part.vertices[part.faces]
        one = corners.reshape(-1, 3)
        other = np.roll(corners, -1, axis=1).reshape(-1, 3)
        a, b = one[:, axis] - at, other[:, axis] - at
        through = a * b < 0
        share = (a[through] / (a[through] - b[through]))[:, None]
        found.append(one[through] + share * (other[through] - one[through]))
    return np.concatenate(found)


def holds(parts: Sequence[Part], point: ArrayLike) -> bool:
    """Whether a point [3] lies inside any of the parts."""
    return bool(held(parts, np.asarray(point)[None])[0])


def held(parts: Sequence[Part], points: ArrayLike) -> np.ndarray:
    """Which points [n, 3] lie inside any of the parts: bool [n]."""
    given = np.asarray(points, dtype=np.float64)
    inside = np.zeros(len(given), dtype=bool)
    for part in parts:
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        near = ((given >= low) & (given <= high)).all(axis=1) & ~inside
        inside[near] = winding(given[near], part) > 0.5
    return inside


def vertices_of(parts: Sequence[Part]) -> np.ndarray:
    """All vertices [n, 3], part after part."""
    return np.concatenate([part.vertices for part in parts])


def box_of(parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates, each [3]."""
    vertices = vertices_of(parts)
    return vertices.min(axis=0), vertices.max(axis=0)


def extents(parts: Sequence[Part]) -> np.ndarray:
    """Width, height and depth [3] of the box around all parts."""
    low, high = box_of(parts)
    return high - low


def volume(part: Part) -> float:
    """Negative where the part is inside out."""
    return signed_volume(part.vertices, part.faces)


def filled(parts: Sequence[Part]) -> float:
    """The parts' volumes, added up, over that of the box around them."""
    return sum(volume(part) for part in parts) / float(extents(parts).prod())


def surface_area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Of all triangles, in float64."""
    corners = vertices[faces].astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2


def second_moment(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Squared distance from the origin, integrated over all triangles: area / 12 of each, times
    the squares of its corners and of their sum.
    """
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    squares = sum((corner**2).sum(axis=1) for corner in (a, b, c, a + b + c))
    return float((twice * squares).sum()) / 24
