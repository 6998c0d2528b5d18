"""The surface where an occupancy is at a level, on a grid that is refined near the surface only."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.reconstruction.stages import in_grey
from data_prep.failures import StageFailure
from data_prep.scene import Mesh

COARSEST = 32  # cells a side of the grid whose nodes are all evaluated
_DOUBLINGS = 2  # to 128 cells: with a box of 2.2 one is as wide as a pixel of the image
MARGIN = 3.0  # in logits: a cell whose corners are all farther from the level is not refined

Occupancy = Callable[[Tensor], Tensor]  # logits [M] of places [M, 3]


def sample_grid(occupancy: Occupancy, points: Tensor, half_extent: float, level: float) -> Tensor:
    """Return logits [K, K, K] on the nodes of a cubic grid, K = COARSEST * 2 ** DOUBLINGS + 1.

    Nodes are evaluated where the coarser grid does not rule out a surface, and around points
    [N, 3], which may be all that tells of a thin part; elsewhere values are interpolated. The
    outermost nodes are far below the level, so that every surface is closed.

    Raises StageFailure("occupancy", ...) where a value is not finite.
    """
    cells = COARSEST
    values = _evaluated(occupancy, torch.ones((cells + 1,) * 3, dtype=torch.bool), half_extent)
    wanted = _cells_around(points, cells, half_extent)
    for _ in range(_DOUBLINGS):
        wanted = wanted | _near_level(values, level)
        cells *= 2
        finer = _nodes(
            wanted.repeat_interleave(2, 0).repeat_interleave(2, 1).repeat_interleave(2, 2)
        )
        values = functional.interpolate(
            values[None, None], size=(cells + 1,) * 3, mode="trilinear", align_corners=True
        )[0, 0]
        values[finer] = _evaluated(occupancy, finer, half_extent)[finer]
        wanted = torch.zeros((cells,) * 3, dtype=torch.bool)
    inner = values[1:-1, 1:-1, 1:-1]
    closed = torch.full_like(values, min(level - MARGIN, float(inner.min())))
    closed[1:-1, 1:-1, 1:-1] = inner
    return closed


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


def _evaluated(occupancy: Occupancy, nodes: Tensor, half_extent: float) -> Tensor:
    """Return values on the nodes of a grid where `nodes` holds, and zeros elsewhere."""
    cell = 2 * half_extent / (len(nodes) - 1)
    logits = occupancy(nodes.nonzero() * cell - half_extent)
    bad = int((~logits.isfinite()).sum())
    if bad:
        raise StageFailure("occupancy", f"{bad} of {len(logits)} values are not finite")
    values = torch.zeros(nodes.shape)
    values[nodes] = logits
    return values


def _cells_around(points: Tensor, cells: int, half_extent: float) -> Tensor:
    """Return the cells [cells, cells, cells] that points lie in, and their neighbours."""
    place = (points / half_extent + 1) * (cells / 2)
    x, y, z = place.clamp(0, cells - 1).long().T
    around = torch.zeros(1, 1, cells, cells, cells)
    around[0, 0, x, y, z] = 1.0
    return functional.max_pool3d(around, 3, 1, 1)[0, 0] > 0


def _near_level(values: Tensor, level: float) -> Tensor:
    """Return the cells whose corners are neither all far above the level nor all far below."""
    highest = functional.max_pool3d(values[None, None], 2, 1)[0, 0]
    lowest = -functional.max_pool3d(-values[None, None], 2, 1)[0, 0]
    return (highest > level - MARGIN) & (lowest < level + MARGIN)


def _nodes(cells: Tensor) -> Tensor:
    """Return the corners of the cells that hold, [K + 1, K + 1, K + 1]."""
    padded = functional.pad(cells[None, None].float(), (1,) * 6)
    return functional.max_pool3d(padded, 2, 1)[0, 0] > 0
