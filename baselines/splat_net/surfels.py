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

NEIGHBOURS = 10  # of a point, itself among them; that of the paper's reconstruction


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

    Where points coincide, or N is 1, the eigenvectors of a zero matrix are as good as any: the
    result is finite, and variation 0.
    """
    place = points[np.lexsort(points.T)].astype(np.float64)
    # Split in the middle, not at the median: where that is exactly 0 (half of a cloud in one
    # plane), SciPy 1.17 steps to the next number, which is denormal; trainings flush it to 0, and
    # so on without end.
    tree = KDTree(place, balanced_tree=False)
    _, found = tree.query(place, k=min(NEIGHBOURS, len(place)), workers=workers)
    found = found.reshape(len(place), -1)
    near = place[found]  # [N, k, 3]
    mean = near.mean(axis=1)
    near -= mean[:, None]
    covariance = near.mT @ near / near.shape[1]
    # Far: the mean and covariance of a mixture are those of its parts, and of their means.
    far_mean = mean[found].mean(axis=1)
    steps = mean[found] - far_mean[:, None]
    far_covariance = covariance[found].mean(axis=1) + steps.mT @ steps / steps.shape[1]
    values, vectors = np.linalg.eigh(np.stack([covariance, far_covariance], axis=1))
    total = values.sum(axis=-1)
    variation = np.divide(values[..., 0], total, out=np.zeros_like(total), where=total > 0)
    normals = vectors[..., 0]  # of the smallest eigenvalue: eigh sorts them
    height = ((place - far_mean) * normals[:, 1]).sum(axis=1, keepdims=True)
    flattened = place - height * normals[:, 1]
    parts = (place, flattened, normals, variation.clip(0, 1 / 3))
    return Surfels(*(torch.from_numpy(part.astype(np.float32)) for part in parts))


def stack(surfels: list[Surfels]) -> Surfels:
    """Clouds of the same number of points, as one with a leading dimension."""
    return Surfels(
        points=torch.stack([s.points for s in surfels]),
        flattened=torch.stack([s.flattened for s in surfels]),
        normals=torch.stack([s.normals for s in surfels]),
        variation=torch.stack([s.variation for s in surfels]),
    )
