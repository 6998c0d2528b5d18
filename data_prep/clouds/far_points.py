"""Points far from the rest of a cloud: returns at the origin, numbers for "none", floaters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FAR_OFF = "points or faces far from the rest set its scale"  # ends a note; reports look for it
FEWEST_POINTS = 8  # of a cloud that is looked at, and of a large part: fewer show no shape
CELLS = 16  # cells of the grid along the longest side of the cloud; a gap of two parts the cloud
FEW = 64  # points: below that gaps are everywhere, and only the stricter rule holds


class _Rule(NamedTuple):
    """The conditions under which points are far from the rest.

    crowd       share of all points that a cell and its neighbours need to hold a part together
    crowd_least the same as a number of points
    rest_size   share of the whole radius that the rest has at most
    far_share   share of all points that are far at most
    """

    crowd: float
    crowd_least: int
    rest_size: float
    far_share: float


# A rest of less than 60 % of the radius is visibly small in its image, however many are far.
_SMALL_REST = 0.6
_ANY_NUMBER = _Rule(crowd=0.001, crowd_least=1, rest_size=_SMALL_REST, far_share=1.0)
# Few points that are not each alone: more of them are needed to hold a part together, but they have
# to make the rest much smaller, as the sparse end of an object would not.
_A_FEW = _Rule(crowd=0.01, crowd_least=4, rest_size=0.25, far_share=0.15)
_RULES = (_ANY_NUMBER, _A_FEW)
_RULES_OF_FEW = (_A_FEW._replace(crowd_least=1), _A_FEW)

# Parts of the object besides the largest one: a part is kept if it is large, or dense.
LARGE_SIZE = 0.1  # of the size of the largest part: a large part has at least this
LARGE_POINTS = 0.01  # of the points of the largest part: a large part has at least these,
POINTS_BY_SIZE = 0.1  # and this share of as many as the largest part has at its own size
DENSE_POINTS = 0.05  # of the points of the largest part: a dense part has at least these,
DENSE_SIZE = 0.001  # and this share of its size, so that they are not all in one place
# All kept parts, put in a row, are at least this share of the diagonal of the whole: else they are
# specks, too, as where a terrain has z = -9999 for "none".
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
    if not len(rest) or (share := radius(rest)) >= _SMALL_REST:
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
    for rule in _RULES if len(points) >= FEW else _RULES_OF_FEW:
        crowded = (grid > 0) & (around >= max(rule.crowd_least, rule.crowd * len(points)))
        joined, _ = label(maximum_filter(crowded, 3, mode="constant"), block)
        keeps = _in_parts(np.where(crowded, joined, 0).flat[used], count, lows, highs)
        if keeps.all() or count[~keeps].sum() > rule.far_share * len(points):
            continue
        kept = np.zeros(CELLS**3, bool)
        kept[used[keeps]] = True
        rest = kept[cell]
        if radius(points[rest]) < rule.rest_size * radius(points):
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
    enough = of_points >= np.maximum(LARGE_POINTS, POINTS_BY_SIZE * of_size)
    large = (of_size >= LARGE_SIZE) & (points >= FEWEST_POINTS) & enough
    dense = (of_points >= DENSE_POINTS) & (of_size >= DENSE_SIZE)
    kept = large | dense
    if sizes[kept].sum() < _LEAST_FILLED * _size(lows, highs):
        kept[:] = False
    kept[main] = True
    in_parts = np.zeros(len(part), bool)
    for number in np.flatnonzero(kept):
        in_parts |= parts[number]
    return in_parts


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
