"""The surroundings of points as the network sees them, and the places around that it moves.

A noisy cloud is smoothed first, as `denoised-wrap` does it (`baselines.reconstruction.denoised`):
the network corrects what that leaves.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from baselines.neighbourhoods import fit_planes
from baselines.reconstruction.denoised import (
    NOISY,
    noise_scale,
    perpendicular,
    searched,
    smoothed_as_asked,
)
from baselines.reconstruction.stages import Nearest, spacing
from baselines.upsampler.network import Surroundings
from data_prep.arrays import Floats
from data_prep.scene import Points

# The ranks, by distance, of the neighbours that a point hears of: the eight nearest for detail,
# farther ones for noise. With 2,048 points a standard deviation of 10 % is as far as the 20th to
# 50th neighbour, and five rounds reach five times as far as one.
RANKS = (*range(1, 9), 11, 15, 20, 27, 36, 48, 64, 88)
_SPACING_NEIGHBOURS = 16  # as of `spacing`
_DISC = 1.0  # radius of the disc around a point that is filled up, in spacings
_UPRIGHT = 1e-6  # an offset of so small a part in the tangent plane has no direction there
_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def surroundings(points: Points) -> tuple[Surroundings, tuple[str, ...]]:
    """Return what the network sees around different, finite points [N, 3], N > 1, and notes.

    The notes say how noisy points were smoothed. Where a cloud has no neighbour of some rank, its
    farthest point takes that place.
    """
    raw, sample = searched(points)
    noise = noise_scale(sample)
    raw_normals = _normals(raw.points)
    near, normals, notes = raw, raw_normals, ()
    if noise > NOISY * spacing(sample):
        smooth, neighbours = smoothed_as_asked(raw, noise)
        near, normals = Nearest(smooth), _normals(smooth)
        notes = (f"noise: {noise:.3f}", f"smoothed: over {neighbours} points")
    distance, index = near.within(RANKS[-1] + 1)
    last = index.shape[1] - 1
    radius = distance[:, min(_SPACING_NEIGHBOURS - 1, last)] / 2
    seen = Surroundings(
        points=_float32(near.points),
        normals=_float32(normals),
        raw=_float32(raw.points),
        raw_normals=_float32(raw_normals),
        radius=_float32(radius),
        noise=_float32(noise / radius),
        neighbours=torch.from_numpy(index[:, np.minimum(RANKS, last)].astype(np.int64)),
    )
    return seen, notes


def _normals(points: Floats) -> Floats:
    return next(fit_planes(points, (1,))).normals


def places_around(seen: Surroundings, count: int) -> Tensor:
    """Return `count` places for each point, in its tangent plane, [N * count, 3].

    The first is the point itself. They fill a disc evenly, in the order of a sunflower's seeds
    (Vogel 1979). Angles start at the direction of the nearest point and grow to the side of the
    second nearest, so that the places turn with the cloud.
    """
    number = np.arange(count)
    distance, angle = _DISC * np.sqrt(number / count), number * _GOLDEN_ANGLE
    spiral = np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])
    points, normals = (values.cpu().numpy().astype(float) for values in (seen.points, seen.normals))
    first, second = (points[row] - points for row in seen.neighbours[:, :2].T.cpu().numpy())
    tangents = _float32(_tangents(normals, first, second))
    steps = (_float32(spiral) @ tangents).to(seen.points)  # [N, count, 3]
    return (seen.points[:, None] + steps * seen.radius[:, None, None]).flatten(0, 1)


def _tangents(normals: Floats, first: Floats, second: Floats) -> Floats:
    """Return tangents [N, 2, 3] at right angles: along a first offset, to the side of a second."""
    along = first - (first * normals).sum(axis=1, keepdims=True) * normals
    length = np.linalg.norm(along, axis=1, keepdims=True)
    upright = length <= _UPRIGHT * np.linalg.norm(first, axis=1, keepdims=True)
    along = np.where(upright, perpendicular(normals), along / np.where(upright, 1, length))
    aside = np.cross(normals, along)
    sides = np.where((aside * second).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return np.stack([along, sides * aside], axis=1)


def _float32(array: Floats) -> Tensor:
    return torch.from_numpy(array.astype(np.float32))
