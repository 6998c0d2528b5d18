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
_SHORTEST = 1e-6  # times the longest edge: an edge as short as this joins a corner to its twin
_AT_ONCE = 2**13  # polygons that are looked at together, whose corners fit into a cache


def beyond_vertices(corners: NDArray[np.int64], count: int) -> str | None:
    """Return what is wrong where corners [C] have a vertex that is not among `count`, else None."""
    if not corners.size or 0 <= corners.min() <= corners.max() < count:
        return None
    return (
        f"faces have the vertices {corners.min()} to {corners.max()}, of {count}; the file is "
        "damaged, fetch it again"
    )


def triangles_of_polygons(
    points: NDArray[np.float64], lengths: NDArray[np.int64]
) -> tuple[Positions, NDArray[np.int64]]:
    """Return the triangles of polygons, and the polygon [T] that each is of.

    points   float64 [C, 3]: the place of each corner
    lengths  int64 [P]: the number of corners of each polygon; one of fewer than 3 has no triangles

    A convex polygon becomes a fan around its first corner. Such a fan of a concave one would cover
    places outside of it, so that one of four corners becomes a fan around the corner that points
    inwards, and one of more is divided by ear clipping in its plane (mapbox-earcut). The triangles
    are in the order of the polygons, and each turns as its polygon does.
    """
    if (lengths == 3).all():
        return np.arange(3 * len(lengths)).reshape(-1, 3), np.arange(len(lengths))
    first = np.cumsum(lengths) - lengths
    reflex = _reflex_corners(points, first, lengths)
    begin = np.where((reflex >= 0) & (lengths == 4), reflex, 0)
    positions, polygons = _fans(lengths, begin)
    concave = np.flatnonzero((reflex >= 0) & (lengths > 4))
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


def _fans(
    lengths: NDArray[np.int64], begin: NDArray[np.int64]
) -> tuple[Positions, NDArray[np.int64]]:
    """Return the triangles of fans around the corner `begin` [P] of each polygon."""
    first, step, polygons = _steps(lengths)
    around = begin[polygons]
    corners = [(around + after) % lengths[polygons] for after in (0, step + 1, step + 2)]
    return np.stack(corners, axis=1) + first[:, None], polygons


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
def _reflex_corners(
    points: NDArray[np.float64], first: NDArray[np.int64], lengths: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the corner [P] that turns most against the sense of its polygon, -1 for none.

    A polygon of more than four corners counts as turning at its first one where two neighbouring
    corners coincide.
    """
    reflex = np.full(len(lengths), -1)
    for length in np.unique(lengths[lengths > 3]):
        of_length = np.flatnonzero(lengths == length)
        for start in range(0, len(of_length), _AT_ONCE):
            rows = of_length[start : start + _AT_ONCE]
            corners = points[first[rows, None] + np.arange(length)].transpose(2, 0, 1)
            edges = np.roll(corners, -1, axis=2) - corners  # [3, rows, length]
            sizes = _norm(edges)
            edges = edges / sizes
            turns = _cross(np.roll(edges, 1, axis=2), edges)
            sines = (turns * _normals(corners)[:, :, None]).sum(axis=0)
            most = np.where(np.isnan(sines), np.inf, sines).argmin(axis=1)
            against = np.take_along_axis(sines, most[:, None], axis=1)[:, 0] < -_LEAST_TURN
            reflex[rows[against]] = most[against]
            if length > 4:  # a corner that stands twice, or nearly, hides how the others turn
                twice = (sizes <= _SHORTEST * sizes.max(axis=1, keepdims=True)).any(axis=1)
                reflex[rows[twice]] = 0
    return reflex


def _normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normals [3, P] of polygons [3, P, C], by the sum of all fans (Newell)."""
    spokes = corners - corners[:, :, :1]
    sums = _cross(spokes, np.roll(spokes, -1, axis=2)).sum(axis=2)
    return sums / _norm(sums)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cross products of vectors [3, ...], in a tenth of the time of `numpy.cross`."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _norm(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors [3, ...]."""
    return np.sqrt((vectors**2).sum(axis=0))


def _clip(corners: NDArray[np.float64]) -> Positions:
    """Return the triangles [T, 3] of a polygon [C, 3] by ear clipping in its plane.

    For a polygon that has no plane, or that the library finds no triangle of, return a fan.
    """
    from mapbox_earcut import triangulate_float64

    with np.errstate(all="ignore"):  # of corners on a line, and of broken ones
        normal = _normals(corners.T[:, None])[:, 0]
    if not np.isfinite(normal).all():
        return _fans(np.array([len(corners)]), np.zeros(1, np.int64))[0]
    right = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    right /= np.linalg.norm(right)
    across = np.stack([right, np.cross(normal, right)], axis=1)
    plane = (corners - corners[0]) @ across  # [C, 2]
    ends = np.array([len(corners)], np.uint32)
    triangles = triangulate_float64(np.ascontiguousarray(plane), ends).reshape(-1, 3)
    if not len(triangles):
        return _fans(np.array([len(corners)]), np.zeros(1, np.int64))[0]
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    backwards = np.cross(b - a, c - a) @ normal < 0  # the library turns as it likes
    triangles[backwards] = triangles[backwards, ::-1]
    return triangles.astype(np.int64)
