"""The surface where an occupancy is at a level, on a grid that is refined near the surface only."""

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

COARSEST = 32  # cells a side of the grid whose nodes are all evaluated, but for its corners
# In logits: a cell whose corners are all farther from the level is not refined. Two doublings, to
# 128 cells: with a box of 2.2 one is as wide as a pixel of the image.
MARGINS = (3.0, 2.0)
_BEYOND = 2  # coarse cells: so far beyond the points there is nothing

# Logits [M] of nodes, int64 [3, M], of a grid with so many cells a side over the box.
Occupancy = Callable[[Tensor, int], Tensor]


def sample_grid(occupancy: Occupancy, points: Tensor, half_extent: float, level: float) -> Tensor:
    """Return logits [K, K, K] on the nodes of a cubic grid, K = COARSEST * 2 ** len(MARGINS) + 1.

    Nodes are evaluated where the coarser grid does not rule out a surface, and around points
    [N, 3], which may be all that tells of a thin part; elsewhere values are interpolated. The
    outermost nodes are far below the level, so that every surface is closed, and so are those
    outside the ball about the origin that holds the points and is as wide as the box.

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
    """Return the surface in grey where values on a cubic grid [K, K, K] are at a level.

    Raises StageFailure("marching-cubes", ...) where there is none.
    """
    from skimage.measure import marching_cubes

    inside = values > level
    if not inside.any():
        raise StageFailure("marching-cubes", f"no surface: no value is above {level:.3g}")
    spans = [np.flatnonzero(inside.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    low = np.array([max(span[0] - 1, 0) for span in spans])
    high = np.array([span[-1] + 2 for span in spans])
    part = values[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    vertices, faces, _, _ = marching_cubes(part, level, gradient_direction="ascent")
    cell = 2 * half_extent / (len(values) - 1)
    return in_grey((vertices + low) * cell - half_extent, faces)


def _evaluate(occupancy: Occupancy, values: Tensor, nodes: Tensor) -> None:
    """Put the occupancy into values on the nodes of a grid where `nodes` holds."""
    index = np.flatnonzero(nodes)  # faster than PyTorch's
    places = torch.from_numpy(np.stack(np.unravel_index(index, nodes.shape)))
    logits = occupancy(places, len(nodes) - 1)
    bad = int((~logits.isfinite()).sum())
    if bad:
        raise StageFailure("occupancy", f"{bad} of {len(logits)} values are not finite")
    values.view(-1)[torch.from_numpy(index)] = logits


def _in_ball(points: Tensor, cells: int, half_extent: float) -> Tensor:
    """Return the nodes in the ball that the box and the points fill, [cells + 1] * 3."""
    farthest = float(points.norm(dim=1).max()) + _BEYOND * 2 * half_extent / cells
    squares = torch.linspace(-half_extent, half_extent, cells + 1).square()
    distance = squares[:, None, None] + squares[:, None] + squares
    return distance <= max(half_extent, farthest) ** 2


def _cells_around(points: Tensor, cells: int, half_extent: float) -> Tensor:
    """Return the cells [cells, cells, cells] within half a cell of points, along each axis."""
    place = (points / half_extent + 1) * (cells / 2)
    around = torch.zeros((cells,) * 3, dtype=torch.bool)
    for offset in itertools.product((-0.5, 0.5), repeat=3):
        x, y, z = (place + torch.tensor(offset)).clamp(0, cells - 1).long().T
        around[x, y, z] = True
    return around


def _near_level(values: Tensor, level: float, margin: float) -> Tensor:
    """Return the cells whose corners are neither all far above the level nor all far below."""
    above, below = values > level - margin, values < level + margin
    for axis in range(3):
        cells = values.shape[axis] - 1
        above = above.narrow(axis, 0, cells) | above.narrow(axis, 1, cells)
        below = below.narrow(axis, 0, cells) | below.narrow(axis, 1, cells)
    return above & below


def _nodes_within(cells: Tensor) -> Tensor:
    """Return the nodes of a grid twice as fine that lie in cells [K, K, K], [2 K + 1] * 3."""
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
        low, high = (values.narrow(axis, first, nodes - 1) for first in (0, 1))
        torch.lerp(low, high, 0.5, out=_every_second(finer, axis, 1, nodes - 1))
        values = finer
    return values


def _finer_shape(grid: Tensor, axis: int, more: int) -> list[int]:
    """Return the shape of a grid with twice as many nodes along an axis, and one more or less."""
    return [2 * size + more if i == axis else size for i, size in enumerate(grid.shape)]


def _every_second(grid: Tensor, axis: int, first: int, count: int) -> Tensor:
    """Return a view of `count` layers across an axis, every second one from the first."""
    return grid.narrow(axis, first, 2 * count - 1)[(slice(None),) * axis + (slice(None, None, 2),)]
