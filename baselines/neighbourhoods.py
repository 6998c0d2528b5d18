"""Neighbourhoods of points: the distance to the nearest, and planes fitted at several scales.

A scale is a number of hops. At one hop a neighbourhood is the `NEIGHBOURS` nearest points of a
point. At two hops it is the neighbourhoods of all of these, taken as one distribution of points;
it reaches twice as far without a second search. More hops go on likewise. The planes of few hops
keep the details of a clean cloud, and those of many hops average noise out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import KDTree, cKDTree

from baselines.eigenpairs import smallest_eigenpairs
from data_prep.arrays import Floats
from data_prep.clouds.sampling import random_rows
from data_prep.clouds.sorting import repeats, sorted_points
from data_prep.scene import Points

# Points of a neighbourhood at one hop, the point itself included. The paper's reconstruction
# estimates normals from as many.
NEIGHBOURS = 10
# Points of which the nearest other one is searched for: the median is then found in milliseconds,
# with a standard error of 0.8 % on a random sample of a surface.
_MOST_SEARCHED = 8192
_UPPER = np.triu_indices(3)  # rows and columns of the upper triangle of a 3x3 matrix


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes fitted to the neighbourhoods of N points, at one scale.

    normals    [N, 3]: unit vectors, whose signs are arbitrary
    variation  [N]: the surface variation of Pauly, Gross and Kobbelt 2002: the smallest eigenvalue
               of the neighbourhood's covariance divided by the sum of the three, 0 (flat) to 1/3
    flattened  [N, 3]: each point projected onto its plane
    """

    normals: Floats
    variation: Floats
    flattened: Floats


def nearest_distance(points: Points) -> float:
    """Return the median distance of finite points [N, 3] to the nearest other one.

    It is 0 for fewer than two points. Of more than 8,192 points as many are drawn at random, which
    are searched among all: of a random sample of a surface the result is then within some 2 % of
    that of all. The order of the points does not matter.
    """
    if len(points) < 2:
        return 0.0
    ordered = sorted_points(points)
    repeated = repeats(ordered)
    # The search takes time in proportion to the points that coincide, because the tree cannot
    # divide them. Their distance is known to be 0, so only the others are searched for.
    coincide = repeated | np.append(repeated[1:], False)
    some = random_rows(len(points), _MOST_SEARCHED)
    distances = np.zeros(len(some))
    alone = ~coincide[some]
    # Boxes split in the middle take half the time of those split at the median of their points.
    tree = cKDTree(ordered[~repeated], balanced_tree=False, compact_nodes=False)
    if alone.any():
        distances[alone] = np.asarray(tree.query(ordered[some[alone]], k=[2])[0])[:, 0]
    return float(np.median(distances))


def fit_planes(place: Floats, hops: Sequence[int], workers: int = 1) -> Iterator[Planes]:
    """Yield the planes of points [N, 3], N > 0, for each number of hops.

    hops     ascending numbers of at least 1
    workers  threads that search for neighbours

    Where all points of a neighbourhood coincide, every plane fits: the normal is an arbitrary unit
    vector, and the variation is 0.
    """
    # The first and second moments of a mixture of distributions are the means of theirs, so a hop
    # is one product with the sparse matrix that averages over neighbours. Coordinates are relative
    # to the cloud's median: far from the origin, covariances would be lost in rounding errors, and
    # a mean would follow a single outlier.
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
    """Return the sparse matrix [N, N] that averages values over each point's neighbours."""
    # The tree splits boxes in the middle and not at the median of their points. Where the median is
    # exactly 0 (half of a cloud lies in one plane), SciPy 1.17 splits at the next larger number,
    # which is denormal. A training flushes denormal numbers to 0
    # (`learning.training_loop.denormals_flushed`), and SciPy would search without end.
    tree = KDTree(place, balanced_tree=False)
    count = min(NEIGHBOURS, len(place))
    _, neighbours = tree.query(place, k=count, workers=workers)
    first = np.arange(0, neighbours.size + 1, count)
    shares = np.full(neighbours.size, 1 / count)
    return csr_array((shares, neighbours.ravel(), first), shape=(len(place), len(place)))


def _products(vectors: Floats) -> Floats:
    """Return the upper triangles [n, 6] of the matrices v v^T of vectors v, [n, 3]."""
    rows, columns = _UPPER
    return vectors[:, rows] * vectors[:, columns]
