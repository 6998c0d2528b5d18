"""What a cloud says about its surface before any camera is chosen: normals, and where it is flat.

Two scales. Near: a point's `NEIGHBOURS` nearest points. Far: the neighbourhoods of these together,
as one distribution, which reaches twice as far without a second search (what noise needs; what the
first scale alone leaves ragged, the second smooths).
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
LARGEST_PART = 65_536  # points that are worked on at once: a bound on memory
_UPPER = np.triu_indices(3)

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surfels:
    """Points of one cloud or of several (leading dimensions ...), float32, unit-sphere coordinates.

    points     [..., N, 3]
    flattened  [..., N, 3]: the points moved onto the plane of their far neighbourhood
    normals    [..., N, 2, 3]: unit vectors of either sign, near and far
    variation  [..., N, 2]: surface variation, near and far: the smallest of the three eigenvalues
               of the covariance over their sum (Pauly, Gross and Kobbelt 2002), 0..1/3
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
    moments = np.concatenate([_near_moments(place, found[part]) for part in parts])
    pieces = [_fit(place, moments, part, found[part]) for part in parts]
    fitted = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return Surfels(*(torch.from_numpy(part.astype(np.float32)) for part in (place, *fitted)))


def _near_moments(place: Floats, found: NDArray[np.intp]) -> Floats:
    """Mean, and covariance (six of its nine numbers), of neighbourhoods `found` [n, k]: [n, 9]."""
    near = np.take(place, found, axis=0)  # [n, k, 3]
    mean = near.mean(axis=1)
    near -= mean[:, None]
    covariance = near.mT @ near / near.shape[1]
    return np.concatenate([mean, covariance[:, *_UPPER]], axis=1)


def _fit(
    place: Floats, moments: Floats, own: slice, found: NDArray[np.intp]
) -> tuple[Floats, Floats, Floats]:
    """Flattened points [n, 3], normals [n, 2, 3] and variation [n, 2] of the points `own`."""
    theirs = np.take(moments, found, axis=0)  # [n, k, 9]
    # Of a mixture: its mean is the mean of the means, its covariance the mean of the covariances
    # and the covariance of the means.
    mean = theirs[:, :, :3].mean(axis=1)
    steps = theirs[:, :, :3] - mean[:, None]
    far = theirs[:, :, 3:].mean(axis=1) + (steps.mT @ steps / steps.shape[1])[:, *_UPPER]
    both = np.concatenate([moments[own, 3:], far])
    least, normals = smallest_eigenpairs(both)
    total = both[:, [0, 3, 5]].sum(axis=1)  # the trace is the sum of the eigenvalues
    variation = np.divide(least, total, out=np.zeros_like(total), where=total > 0)
    count = len(far)
    normals = np.stack([normals[:count], normals[count:]], axis=1)
    variation = np.stack([variation[:count], variation[count:]], axis=1)
    height = ((place[own] - mean) * normals[:, 1]).sum(axis=1, keepdims=True)
    return place[own] - height * normals[:, 1], normals, variation.clip(0, 1 / 3)


def stack(surfels: list[Surfels]) -> Surfels:
    """Clouds of the same number of points, as one with a leading dimension."""
    return Surfels(
        points=torch.stack([s.points for s in surfels]),
        flattened=torch.stack([s.flattened for s in surfels]),
        normals=torch.stack([s.normals for s in surfels]),
        variation=torch.stack([s.variation for s in surfels]),
    )
