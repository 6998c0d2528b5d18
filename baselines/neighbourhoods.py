"""Planes of the neighbourhoods of points, at several scales.

Scales go by hops. One hop: a point's `NEIGHBOURS` nearest points. Two: the neighbourhoods of these
together, as one distribution, which reaches twice as far without a second search; and so on. The
clean cloud needs the first, noise the last.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from baselines.eigenpairs import smallest_eigenpairs
from data_prep.arrays import Floats

NEIGHBOURS = 10  # of a point, itself among them; that of the paper's reconstruction
_UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes of the neighbourhoods of N points, at one scale.

    normals    [N, 3]: unit vectors of either sign
    variation  [N]: surface variation: the smallest of the three eigenvalues of the covariance over
               their sum (Pauly, Gross and Kobbelt 2002), 0..1/3
    flattened  [N, 3]: the points moved onto their planes
    """

    normals: Floats
    variation: Floats
    flattened: Floats


def fit_planes(place: Floats, hops: Sequence[int], workers: int = 1) -> Iterator[Planes]:
    """Yield the planes of points [N, 3], N > 0, for each number of hops; those ascend.

    `workers` threads search for neighbours. Of a single place any vector is as good a normal as
    another: the result is finite, and variation 0.
    """
    # Of a mixture of distributions the mean is the mean of the means, and so are second moments:
    # a hop is one product with the sparse matrix that averages over neighbours. Moments about the
    # cloud's middle, so that covariances do not drown in a distant cloud's coordinates; the median,
    # so that one outlier does not take the middle along.
    local = place - np.median(place, axis=0)
    average = _average(place, workers)
    moments = np.concatenate([local, _products(local)], axis=1)
    for hop in range(1, hops[-1] + 1):
        moments = average @ moments
        if hop not in hops:
            continue
        mean = moments[:, :3]
        covariance = moments[:, 3:] - _products(mean)
        least, normal = smallest_eigenpairs(covariance)
        total = covariance[:, [0, 3, 5]].sum(axis=1)  # the trace is the sum of the eigenvalues
        share = np.divide(least, total, out=np.zeros_like(total), where=total > 0)
        height = ((local - mean) * normal).sum(axis=1, keepdims=True)
        yield Planes(normal, share.clip(0, 1 / 3), place - height * normal)


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
