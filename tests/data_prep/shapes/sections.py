"""Measures of drawn objects: where a plane cuts them, what is inside, how large they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.shape_class import Drawn
from data_prep.shapes.solids import Part
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
    points = np.asarray(point, dtype=np.float64)[None]
    return any(winding(points, part)[0] > 0.5 for part in parts)


def box_of(parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates, each [3]."""
    vertices = np.concatenate([part.vertices for part in parts])
    return vertices.min(axis=0), vertices.max(axis=0)


def surface_area(drawn: Drawn) -> float:
    """Of the normalised mesh."""
    mesh = drawn.mesh()
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2
