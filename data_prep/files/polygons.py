"""Polygons, strips and fans of mesh files divided into triangles.

All functions take the corners of all polygons one after another, as `lengths` divides them, and
return positions in that list, so that a caller can take anything that a corner has: its vertex, its
place in a texture, its colour.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Positions = NDArray[np.int64]  # [T, 3], positions in the list of corners

# Turns of less than this, as the sine of their angle, do not make a polygon concave. Corners on a
# straight edge turn by the rounding of float32, 1e-7 of the distance from the origin.
_LEAST_TURN = 1e-5


def triangles_of_polygons(
    points: NDArray[np.float64], lengths: NDArray[np.int64]
) -> tuple[Positions, NDArray[np.int64]]:
    """Return the triangles of polygons, and the polygon [T] that each is of.

    points   float64 [C, 3]: the place of each corner
    lengths  int64 [P]: the number of corners of each polygon; one of fewer than 3 has no triangles

    A convex polygon becomes a fan around its first corner. A fan of a concave one would cover
    places outside of it, so that this one is divided by ear clipping in its plane (mapbox-earcut).
    The triangles are in the order of the polygons, and each turns as its polygon does.
    """
    positions, polygons = _fans(lengths)
    first = np.cumsum(lengths) - lengths
    concave = _concave(points, first, lengths)
    if not len(concave):
        return positions, polygons
    kept = ~np.isin(polygons, concave)
    clipped = [_clip(points[first[i] : first[i] + lengths[i]]) + first[i] for i in concave]
    positions = np.concatenate([positions[kept], *clipped])
    owners = np.repeat(concave, [len(part) for part in clipped])
    polygons = np.concatenate([polygons[kept], owners])
    order = np.argsort(polygons, kind="stable")
    return positions[order], polygons[order]


def triangles_of_strips(lengths: NDArray[np.int64]) -> tuple[Positions, NDArray[np.int64]]:
    """Return the triangles of strips, and the strip [T] that each is of.

    Each triangle begins one corner later than the one before it. Every second one is turned round,
    so that all face the same way.
    """
    first, step, strips = _steps(lengths)
    odd = step % 2
    begin = first + step
    return np.stack([begin, begin + 1 + odd, begin + 2 - odd], axis=1), strips


def _fans(lengths: NDArray[np.int64]) -> tuple[Positions, NDArray[np.int64]]:
    first, step, polygons = _steps(lengths)
    return np.stack([first, first + step + 1, first + step + 2], axis=1), polygons


def _steps(
    lengths: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return for each triangle the first corner of its polygon, its number there, the polygon."""
    counts = np.maximum(lengths - 2, 0)
    polygons = np.repeat(np.arange(len(counts)), counts)
    first = (np.cumsum(lengths) - lengths)[polygons]
    step = np.arange(len(polygons)) - (np.cumsum(counts) - counts)[polygons]
    return first, step, polygons


@np.errstate(all="ignore")  # places may be infinite or NaN; the caller of the reader refuses these
def _concave(
    points: NDArray[np.float64], first: NDArray[np.int64], lengths: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the polygons, in ascending order, that turn at some corner against their sense."""
    concave = [np.empty(0, np.int64)]
    for length in np.unique(lengths[lengths > 3]):
        rows = np.flatnonzero(lengths == length)
        corners = points[first[rows, None] + np.arange(length)]  # [rows, length, 3]
        edges = np.roll(corners, -1, axis=1) - corners
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        turns = np.cross(np.roll(edges, 1, axis=1), edges)
        normals = _normals(corners)
        sines = np.einsum("pci,pi->pc", turns, normals)
        concave.append(rows[(sines < -_LEAST_TURN).any(axis=1)])
    return np.sort(np.concatenate(concave))


def _normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normals [P, 3] of polygons [P, C, 3], by the sum of all fans (Newell)."""
    spokes = corners - corners[:, :1]
    sums = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def _clip(corners: NDArray[np.float64]) -> Positions:
    """Return the triangles [T, 3] of a polygon [C, 3] by ear clipping in its plane.

    For a polygon that the library finds no triangle of, as all of it lies on a line, return a fan.
    """
    from mapbox_earcut import triangulate_float64

    (normal,) = _normals(corners[None])
    dropped = int(np.abs(normal).argmax())  # the axis that the plane is most nearly across
    plane = np.delete(corners - corners[0], dropped, axis=1)
    ends = np.array([len(corners)], np.uint32)
    triangles = triangulate_float64(np.ascontiguousarray(plane), ends).reshape(-1, 3)
    if not len(triangles):
        return _fans(np.array([len(corners)]))[0]
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    backwards = np.cross(b - a, c - a) @ normal < 0  # the library has a sense of its own
    triangles[backwards] = triangles[backwards, ::-1]
    return triangles.astype(np.int64)
