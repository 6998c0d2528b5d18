"""The surroundings of each point that the network sees, and the places there that it moves.

A noisy cloud is smoothed first, as `denoised-wrap` does it (`baselines.reconstruction.denoised`).
The network corrects the errors that are left.
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

# The neighbours that the features of a point are computed from, by rank: 1 is the nearest. The
# eight nearest show details, and farther ones are needed under noise: with 2,048 points, a standard
# deviation of 10 % is as far as the 20th to the 50th neighbour. Features are computed in five
# rounds, so that a point is reached by what is five times as far away.
RANKS = (1, 2, 3, 4, 5, 6, 7, 8, 11, 15, 20, 27, 36, 48, 64, 88)
# A point's spacing is half the distance to the nearest of this number (`stages.spacing`).
_SPACING_NEIGHBOURS = 16
_DISC = 1.0  # radius of the disc around a point in which new places lie, in spacings
# An offset is upright, and has no direction in the tangent plane, where its part in the plane is
# at most this share of its length: that is a rounding error.
_UPRIGHT = 1e-6
_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))  # radians between two places that follow each other


def surroundings(points: Points) -> tuple[Surroundings, tuple[str, ...]]:
    """Return what the network sees around points, and notes for the user.

    points  [N, 3], different and finite, N > 1

    Notes tell how noisy the points are, and how they were smoothed. Where a cloud has too few
    points for some of the RANKS, the farthest point takes their place.
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
    """Return unit normals [N, 3] of the planes of the points' nearest neighbours."""
    (planes,) = fit_planes(points, (1,))
    return planes.normals


def places_around(seen: Surroundings, count: int) -> Tensor:
    """Return `count` places for each point, in its tangent plane, [N * count, 3].

    The places of a point fill a disc evenly, in the order of a sunflower's seeds (Vogel 1979); the
    first is the point itself. Angles are counted from the direction of the nearest neighbour,
    towards the side of the second nearest, so that the places turn with the cloud.
    """
    number = np.arange(count)
    distance = _DISC * np.sqrt(number / count)
    angle = number * _GOLDEN_ANGLE
    spiral = np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])
    points = seen.points.cpu().numpy().astype(float)
    normals = seen.normals.cpu().numpy().astype(float)
    neighbours = seen.neighbours.cpu().numpy()
    to_first = points[neighbours[:, 0]] - points
    to_second = points[neighbours[:, 1]] - points
    tangents = _float32(_tangents(normals, to_first, to_second))
    steps = (_float32(spiral) @ tangents).to(seen.points)  # [N, count, 3]
    return (seen.points[:, None] + steps * seen.radius[:, None, None]).flatten(0, 1)


def _tangents(normals: Floats, first: Floats, second: Floats) -> Floats:
    """Return two unit vectors in the plane of each normal, at right angles, [N, 2, 3].

    The first goes along the offset `first` [N, 3], the second to the side where `second` [N, 3] is.
    """
    along = first - (first * normals).sum(axis=1, keepdims=True) * normals
    length = np.linalg.norm(along, axis=1, keepdims=True)
    upright = length <= _UPRIGHT * np.linalg.norm(first, axis=1, keepdims=True)
    along = np.where(upright, perpendicular(normals), along / np.where(upright, 1, length))
    aside = np.cross(normals, along)
    sides = np.where((aside * second).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return np.stack([along, sides * aside], axis=1)


def _float32(array: Floats) -> Tensor:
    return torch.from_numpy(array.astype(np.float32))
