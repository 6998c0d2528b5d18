"""What a cloud says about its surface before any camera is chosen: normals, and where it is flat.

Several scales, by hops. One hop: a point's `NEIGHBOURS` nearest points. Two: the neighbourhoods of
these together, as one distribution, which reaches twice as far without a second search; and so on.
The clean cloud needs the first, noise the last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree
from torch import Tensor

from baselines.splat_net.eigenpairs import smallest_eigenpairs

NEIGHBOURS = 10  # of a point, itself among them; that of the paper's reconstruction
HOPS = (1, 2, 4)
FLATTENED = (1, 2)  # the scales that points are flattened by
LARGEST_PART = 65_536  # points that are worked on at once: a bound on memory
_UPPER = np.triu_indices(3)
_LARGEST = float(np.finfo(np.float32).max)

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surfels:
    """Points of one cloud or of several (leading dimensions ...), float32, unit-sphere coordinates.

    points     [..., N, 3]
    flattened  [..., N, 2, 3]: the points moved onto the planes of their neighbourhoods, by scale
               of FLATTENED
    normals    [..., N, 3, 3]: unit vectors of either sign, by scale of HOPS
    variation  [..., N, 3]: surface variation, by scale: the smallest of the three eigenvalues of
               the covariance over their sum (Pauly, Gross and Kobbelt 2002), 0..1/3
    """

    points: Tensor
    flattened: Tensor
    normals: Tensor
    variation: Tensor

    def __len__(self) -> int:
        return self.points.shape[-2]


def find_surfels(points: NDArray[np.float32], workers: int = 1) -> Surfels:
    """The surfels of a cloud [N, 3] of finite points, N > 0, sorted: their order says nothing.

    `workers` threads search for neighbours. Where points coincide, or N is 1, any vector is as good
    a normal as another: the result is finite, and variation 0.
    """
    place = points[np.lexsort(points.T)].astype(np.float64)
    # Split in the middle, not at the median: where that is exactly 0 (half of a cloud in one
    # plane), SciPy 1.17 steps to the next number, which is denormal; trainings flush it to 0, and
    # so on without end.
    tree = KDTree(place, balanced_tree=False)
    _, found = tree.query(place, k=min(NEIGHBOURS, len(place)), workers=workers)
    found = found.reshape(len(place), -1)
    # Not by threads: their memory comes fresh from the operating system, page by page, which cost
    # more than the arithmetic.
    parts = [slice(i, i + LARGEST_PART) for i in range(0, len(place), LARGEST_PART)]
    moments = np.concatenate([_moments_of_points(place, found[part]) for part in parts])
    normals, variation, flattened = [], [], []
    for hop in range(1, HOPS[-1] + 1):
        if hop > 1:
            moments = np.concatenate([_mixed(moments, found[part]) for part in parts])
        if hop not in HOPS:
            continue
        normal, flatness = _fit(moments)
        normals.append(normal)
        variation.append(flatness)
        if HOPS.index(hop) in FLATTENED:
            height = ((place - moments[:, :3]) * normal).sum(axis=1, keepdims=True)
            flattened.append((place - height * normal).clip(-_LARGEST, _LARGEST))
    stacked = (np.stack(scales, axis=1) for scales in (flattened, normals, variation))
    return Surfels(*(torch.from_numpy(part.astype(np.float32)) for part in (place, *stacked)))


def _moments_of_points(place: Floats, found: NDArray[np.intp]) -> Floats:
    """Mean, and covariance (six of its nine numbers), of neighbourhoods `found` [n, k]: [n, 9]."""
    near = np.take(place, found, axis=0)  # [n, k, 3]
    mean = near.mean(axis=1)
    near -= mean[:, None]
    covariance = near.mT @ near / near.shape[1]
    return np.concatenate([mean, covariance[:, *_UPPER]], axis=1)


def _mixed(moments: Floats, found: NDArray[np.intp]) -> Floats:
    """Moments [n, 9] of the neighbours' distributions together.

    Of a mixture the mean is the mean of the means, and the covariance the mean of the covariances
    and the covariance of the means.
    """
    theirs = np.take(moments, found, axis=0)  # [n, k, 9]
    mixed = theirs.mean(axis=1)
    steps = theirs[:, :, :3] - mixed[:, None, :3]
    mixed[:, 3:] += (steps.mT @ steps / steps.shape[1])[:, *_UPPER]
    return mixed


def _fit(moments: Floats) -> tuple[Floats, Floats]:
    """Normals [n, 3] and surface variation [n] of distributions [n, 9]."""
    least, normals = smallest_eigenpairs(moments[:, 3:])
    total = moments[:, [3, 6, 8]].sum(axis=1)  # the trace is the sum of the eigenvalues
    variation = np.divide(least, total, out=np.zeros_like(total), where=total > 0)
    return normals, variation.clip(0, 1 / 3)


def stack(surfels: list[Surfels]) -> Surfels:
    """Clouds of the same number of points, as one with a leading dimension."""
    return Surfels(
        points=torch.stack([s.points for s in surfels]),
        flattened=torch.stack([s.flattened for s in surfels]),
        normals=torch.stack([s.normals for s in surfels]),
        variation=torch.stack([s.variation for s in surfels]),
    )
