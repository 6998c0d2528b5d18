"""Surfels of a cloud, independent of the camera: normals, density, and where the surface is flat.

Several scales, by hops. One hop: a point's `NEIGHBOURS` nearest points. Two: the neighbourhoods of
these together, as one distribution, which reaches twice as far without a second search; and so on.
The clean cloud needs the first, noise the last.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import KDTree
from torch import Tensor

from baselines.splat_net.eigenpairs import smallest_eigenpairs
from data_prep.arrays import Floats

NEIGHBOURS = 10  # of a point, itself among them; that of the paper's reconstruction
HOPS = (1, 2, 4)
FLATTENED = (1, 2)  # the scales that points are flattened by
_UPPER = np.triu_indices(3)
_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, eq=False)
class Surfels:
    """The surfels of one cloud, or of several (leading dimensions ...), in unit-sphere coordinates.

    Tensors are float32.

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


def find_surfels(
    points: NDArray[np.float32], workers: int = 1, *, surfaces: bool = True
) -> Surfels:
    """Return the surfels of a cloud [N, 3] of finite points, N > 0: sorted, and each place once.

    Their order says nothing, nor does a point that is listed twice. `workers` threads search for
    neighbours. Of a single place any vector is as good a normal as another: the result is finite,
    and variation 0. Without `surfaces` there are the points alone, of no scale: the search costs
    many times as much as they do.
    """
    place = np.unique(points, axis=0).astype(np.float64)
    if not surfaces:
        none = torch.empty((len(place), 0, 3))
        return Surfels(torch.from_numpy(place.astype(np.float32)), none, none, none[..., 0])
    # Of a mixture of distributions the mean is the mean of the means, and so are second moments:
    # a hop is one product with the sparse matrix that averages over neighbours. Moments about the
    # cloud's middle, so that covariances do not drown in a distant cloud's coordinates; the median,
    # so that one outlier does not take the middle along.
    local = place - np.median(place, axis=0)
    average = _average(place, workers)
    moments = np.concatenate([local, _products(local)], axis=1)
    normals, variation, flattened = [], [], []
    for hop in range(1, HOPS[-1] + 1):
        moments = average @ moments
        if hop not in HOPS:
            continue
        mean = moments[:, :3]
        covariance = moments[:, 3:] - _products(mean)
        least, normal = smallest_eigenpairs(covariance)
        total = covariance[:, [0, 3, 5]].sum(axis=1)  # the trace is the sum of the eigenvalues
        share = np.divide(least, total, out=np.zeros_like(total), where=total > 0)
        normals.append(normal)
        variation.append(share.clip(0, 1 / 3))
        if HOPS.index(hop) in FLATTENED:
            height = ((local - mean) * normal).sum(axis=1, keepdims=True)
            flattened.append((place - height * normal).clip(-_LARGEST, _LARGEST))
    stacked = (np.stack(scales, axis=1) for scales in (flattened, normals, variation))
    return Surfels(*(torch.from_numpy(part.astype(np.float32)) for part in (place, *stacked)))


def _average(place: Floats, workers: int) -> csr_array:
    """Return the matrix [N, N] that averages over each point's neighbours."""
    # Split in the middle, not at the median: where that is exactly 0 (half of a cloud in one
    # plane), SciPy 1.17 steps to the next number, which is denormal. Inside a training
    # (`learning.training_loop.denormals_flushed`) that is 0 again, and so on without end.
    tree = KDTree(place, balanced_tree=False)
    count = min(NEIGHBOURS, len(place))
    _, neighbours = tree.query(place, k=count, workers=workers)
    first = np.arange(0, neighbours.size + 1, count)
    shares = np.full(neighbours.size, 1 / count)
    return csr_array((shares, neighbours.ravel(), first), shape=(len(place), len(place)))


def _products(vectors: Floats) -> Floats:
    """Return upper triangles [n, 6] of the products v v^T of vectors [n, 3]."""
    rows, columns = _UPPER
    return vectors[:, rows] * vectors[:, columns]


def stack(surfels: list[Surfels]) -> Surfels:
    """Return clouds as one with a leading dimension; the last place of shorter ones repeats."""
    most = max(len(s) for s in surfels)

    def together(name: str) -> Tensor:
        parts = [vars(s)[name] for s in surfels]
        return torch.stack([part[torch.arange(most).clamp(max=len(part) - 1)] for part in parts])

    return Surfels(*(together(field.name) for field in fields(Surfels)))
