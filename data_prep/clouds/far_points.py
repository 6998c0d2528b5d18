"""Points far from the rest of a cloud: returns at the origin, numbers for "none", floaters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FEWEST_POINTS = 8
FAR_OFF = "points or faces far from the rest set its scale"
CELLS = 16  # of the grid, along the longest side of a cloud
# The share of all points that a cell and those around it need to hold parts together; the share of
# the whole size that the rest has at most where the others are far; and their share of all points.
LEAST_SHARE = 0.6
RULES = ((0.001, LEAST_SHARE, 1.0), (0.01, 0.25, 0.15))
FEW = 64  # points; the second rule's shares hold for fewer, which have gaps everywhere
_SPARSE = 4  # points, the least that the second rule asks of a cell and those around it
# A part of its own has these shares of the points and the size of the largest part: it is large, or
# it has many points that are not all in one place.
# All parts together, one behind the other, have the last share of the whole.
PART_POINTS, PART_SIZE, DENSE_POINTS, DENSE_SIZE = 0.01, 0.1, 0.05, 0.001
_LEAST_FILLED = 0.15


def far_points(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points [N, 3] lie so far from the rest that it fills little of their space.

    The rest is what hangs together, without gaps of more than an eighth of the whole length, and
    further parts that have points and size enough to be parts of an object. It is looked at again
    on its own, finer scale. Points that are not finite are not far.
    """
    far = np.zeros(len(points), bool)
    kept = np.flatnonzero(np.isfinite(points).all(axis=1))
    while len(kept) > FEWEST_POINTS:
        rest = _rest(points[kept] / 4)  # so that differences are finite
        if rest.all():
            break
        far[kept[~rest]] = True
        kept = kept[rest]
    return far


def note_on_far(points: NDArray[np.float64], far: NDArray[np.bool_]) -> str:
    """Return a sentence on the points [N, 3] that are far, and on the share of the others."""
    rest = points[~far]
    size, times = radius(rest), _reach(points[far], _middle(rest)) / radius(rest)
    return (
        f"{np.count_nonzero(far)} of {len(points)} points lie up to {times:.3g} times farther out "
        f"than the rest, which takes {100 * size / radius(points):.2g} % of the image's width"
    )


def note_on_scale(points: NDArray[np.floating]) -> str | None:
    """Return a sentence where an object in the unit sphere, of these points, fills little of it.

    Its scale was set by what is far: other points, or faces without an area.
    """
    values = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    rest = values[~far_points(values)]
    if not len(rest) or (share := radius(rest)) >= LEAST_SHARE:
        return None
    return f"the object takes {100 * share:.2g} % of the image's width: {FAR_OFF}"


def _rest(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points [N] are not far on the scale of all of them."""
    from scipy.ndimage import convolve, label, maximum_filter

    low, block = points.min(axis=0), np.ones((3, 3, 3), int)
    side = float((points.max(axis=0) - low).max()) or 1.0
    cell = np.zeros(len(points), np.int16)
    for axis in range(3):
        along = (points[:, axis] - low[axis]) / side * (CELLS * (1 - 1e-9))
        cell = cell * np.int16(CELLS) + along.astype(np.int16)
    order = np.argsort(cell, kind="stable")
    used, first = np.unique(cell[order], return_index=True)
    count = np.diff([*first, len(points)])
    by_cell = points[order]
    lows, highs = np.minimum.reduceat(by_cell, first), np.maximum.reduceat(by_cell, first)
    grid = np.zeros((CELLS,) * 3, int)
    grid.flat[used] = count
    around = convolve(grid, block, mode="constant")
    rules = RULES if len(points) >= FEW else RULES[1:] * 2
    for (crowd, most_size, most_points), fewest in zip(rules, (1, _SPARSE), strict=True):
        crowded = (grid > 0) & (around >= max(fewest, crowd * len(points)))
        joined, _ = label(maximum_filter(crowded, 3, mode="constant"), block)
        keeps = _in_parts(np.where(crowded, joined, 0).flat[used], count, lows, highs)
        if keeps.all() or count[~keeps].sum() > most_points * len(points):
            continue
        kept = np.zeros(CELLS**3, bool)
        kept[used[keeps]] = True
        rest = kept[cell]
        if radius(points[rest]) < most_size * radius(points):
            return rest
    return np.ones(len(points), bool)


def _in_parts(
    part: NDArray[np.int32],
    count: NDArray[np.int64],
    lows: NDArray[np.float64],
    highs: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return which cells, each with a part, points and a box, are in parts of the object."""
    parts = [part == i for i in np.unique(part[part > 0])]
    points = np.array([count[cells].sum() for cells in parts])
    sizes = np.array([_size(lows[cells], highs[cells]) for cells in parts])
    if not sizes.any():  # all parts are points in one place
        return np.ones(len(part), bool)
    main = np.argmax(np.where(sizes > 0, points, 0))
    of_points, of_size = points / points[main], sizes / sizes[main]
    large = (of_size >= PART_SIZE) & (points >= FEWEST_POINTS)
    large &= of_points >= np.maximum(PART_POINTS, PART_SIZE * of_size)
    keeps = large | ((of_points >= DENSE_POINTS) & (of_size >= DENSE_SIZE))
    if sizes[keeps].sum() < _LEAST_FILLED * _size(lows, highs):  # specks, as z = -9999 of a terrain
        keeps[:] = False
    keeps[main] = True
    return np.any([cells for cells, keep in zip(parts, keeps, strict=True) if keep], axis=0)


def radius(points: NDArray[np.float64]) -> float:
    """Return the distance of the farthest point from the centre of the bounding box."""
    return _reach(points, _middle(points))


def _middle(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points.min(axis=0) / 2 + points.max(axis=0) / 2


def _reach(points: NDArray[np.float64], centre: NDArray[np.float64]) -> float:
    """Return the largest distance from a centre, without overflow."""
    centred = points - centre
    scale = float(np.abs(centred).max()) or 1.0
    centred /= scale
    return scale * math.sqrt(np.einsum("ij,ij->i", centred, centred).max())


def _size(lows: NDArray[np.float64], highs: NDArray[np.float64]) -> float:
    """Return the diagonal of the box around boxes."""
    return math.hypot(*(highs.max(axis=0) - lows.min(axis=0)).tolist())
