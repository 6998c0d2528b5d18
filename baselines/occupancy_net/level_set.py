"""The surface at which an occupancy has a given value, by a grid that is fine only near it.

An occupancy is the logit of the probability that a place lies inside the object.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.reconstruction.stages import in_grey
from data_prep.failures import StageFailure
from data_prep.scene import Mesh

COARSEST = 32  # cells along a side of the coarsest grid, whose nodes within a ball are evaluated
# The grid is refined once for each margin, in logits: cells are halved unless the values at their
# corners are all above the level by more than the margin, or all below it. After two refinements
# there are 128 cells along a side of 2.2 units, so that one is as wide as a pixel of the image.
MARGINS = (3.0, 2.0)
_BEYOND = 2  # coarse cells beyond the outermost point in which a surface is looked for

# A function that returns logits [M] of nodes, int64 [3, M] (their numbers along x, y and z), of a
# grid over the box with a given number of cells along a side.
Occupancy = Callable[[Tensor, int], Tensor]


def sample_grid(occupancy: Occupancy, points: Tensor, half_extent: float, level: float) -> Tensor:
    """Return logits [K, K, K] on the nodes of a cubic grid, K = COARSEST * 2 ** len(MARGINS) + 1.

    The occupancy is computed at nodes where the coarser grid does not rule out a surface, and
    around the points, because the coarser grid may miss a thin part. At other nodes the values are
    interpolated. Nodes at the faces of the box are set far below the level, so that every surface
    is closed. So are those outside of a ball about the origin, which holds all points and touches
    the faces of the box or exceeds them.

    points       [N, 3]
    half_extent  half the side of the box, about the origin
    level        logit at which the surface lies

    Raises StageFailure("occupancy", ...) where a value is not finite.
    """
    cells = COARSEST
    known = _in_ball(points, cells, half_extent)
    values = torch.full(known.shape, level - 2 * MARGINS[0])
    _evaluate(occupancy, values, known)
    for margin in MARGINS:
        around = _cells_around(points, cells, half_extent)
        finer = _nodes_within(around | _near_level(values, level, margin))
        values, cells = _doubled(values), 2 * cells
        finer[::2, ::2, ::2] &= ~known
        _evaluate(occupancy, values, finer)
        finer[::2, ::2, ::2] |= known
        known = finer
    lowest = min(level - MARGINS[0], float(values[1:-1, 1:-1, 1:-1].min()))
    for axis in range(3):
        values.select(axis, 0).fill_(lowest)
        values.select(axis, -1).fill_(lowest)
    return values


def level_set(values: NDArray[np.float32], level: float, half_extent: float) -> Mesh:
    """Return the surface, in grey, on which values on a cubic grid [K, K, K] have a level.

    half_extent  half the side of the grid, about the origin

    Raises StageFailure("marching-cubes", ...) where no value is above the level.
    """
    from skimage.measure import marching_cubes

    inside = values > level
    if not inside.any():
        raise StageFailure("marching-cubes", f"no surface: no value is above {level:.3g}")
    # Only the part of the grid that the surface lies in is given to marching cubes.
    spans = [np.flatnonzero(inside.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    low = np.array([max(span[0] - 1, 0) for span in spans])
    high = np.array([span[-1] + 2 for span in spans])
    part = values[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    vertices, faces, _, _ = marching_cubes(part, level, gradient_direction="ascent")
    cell = 2 * half_extent / (len(values) - 1)
    return in_grey((vertices + low) * cell - half_extent, faces)


def _evaluate(occupancy: Occupancy, values: Tensor, nodes: Tensor) -> None:
    """Put the occupancy into `values` [K, K, K] at the nodes for which `nodes` [K, K, K] holds."""
    index = np.flatnonzero(nodes)  # faster than PyTorch's `nonzero`
    places = torch.from_numpy(np.stack(np.unravel_index(index, nodes.shape)))
    logits = occupancy(places, len(nodes) - 1)
    bad = int((~logits.isfinite()).sum())
    if bad:
        raise StageFailure("occupancy", f"{bad} of {len(logits)} values are not finite")
    values.view(-1)[torch.from_numpy(index)] = logits


def _in_ball(points: Tensor, cells: int, half_extent: float) -> Tensor:
    """Return which nodes of a grid lie in the ball in which a surface may be.

    The result is [cells + 1, cells + 1, cells + 1]. The ball is about the origin; its radius is the
    half extent of the box, or the distance of the outermost point and _BEYOND coarse cells.
    """
    farthest = float(points.norm(dim=1).max()) + _BEYOND * 2 * half_extent / cells
    squares = torch.linspace(-half_extent, half_extent, cells + 1).square()
    distance = squares[:, None, None] + squares[:, None] + squares
    return distance <= max(half_extent, farthest) ** 2


def _cells_around(points: Tensor, cells: int, half_extent: float) -> Tensor:
    """Return which cells [cells, cells, cells] are near a point: half a cell away, on each axis."""
    place = (points / half_extent + 1) * (cells / 2)
    around = torch.zeros((cells,) * 3, dtype=torch.bool)
    for offset in itertools.product((-0.5, 0.5), repeat=3):
        x, y, z = (place + torch.tensor(offset)).clamp(0, cells - 1).long().T
        around[x, y, z] = True
    return around


def _near_level(values: Tensor, level: float, margin: float) -> Tensor:
    """Return which cells may hold the surface: not all corners are far above or far below it.

    values  [K, K, K] on the nodes; the result is [K - 1, K - 1, K - 1]
    margin  what counts as far from the level
    """
    above, below = values > level - margin, values < level + margin
    for axis in range(3):
        cells = values.shape[axis] - 1
        above = above.narrow(axis, 0, cells) | above.narrow(axis, 1, cells)
        below = below.narrow(axis, 0, cells) | below.narrow(axis, 1, cells)
    return above & below


def _nodes_within(cells: Tensor) -> Tensor:
    """Return which nodes of a grid twice as fine lie in the marked cells [K, K, K].

    The result is [2 K + 1, 2 K + 1, 2 K + 1].
    """
    nodes = cells
    for axis in range(3):
        finer = torch.zeros(_finer_shape(nodes, axis, 1), dtype=torch.bool)
        for first in range(3):
            _every_second(finer, axis, first, nodes.shape[axis]).logical_or_(nodes)
        nodes = finer
    return nodes


def _doubled(values: Tensor) -> Tensor:
    """Return values on the nodes of a grid twice as fine, by trilinear interpolation."""
    for axis in range(3):
        nodes = values.shape[axis]
        finer = values.new_empty(_finer_shape(values, axis, -1))
        _every_second(finer, axis, 0, nodes).copy_(values)
        low = values.narrow(axis, 0, nodes - 1)
        high = values.narrow(axis, 1, nodes - 1)
        torch.lerp(low, high, 0.5, out=_every_second(finer, axis, 1, nodes - 1))
        values = finer
    return values


def _finer_shape(grid: Tensor, axis: int, more: int) -> list[int]:
    """Return the shape of a grid whose size n along an axis becomes 2 n + `more`."""
    shape = list(grid.shape)
    shape[axis] = 2 * shape[axis] + more
    return shape


def _every_second(grid: Tensor, axis: int, first: int, count: int) -> Tensor:
    """Return a view of `count` layers of a grid across an axis: every second one, from `first`."""
    layers = grid.narrow(axis, first, 2 * count - 1).movedim(axis, 0)
    return layers[::2].movedim(0, axis)
