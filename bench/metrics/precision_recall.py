"""Precision and recall of images by features (Kynkaanniemi et al. 2019, arXiv 1904.06991).

A set of features stands for the union of balls, one about each of its rows, that reach the row's
k-th nearest neighbour in the set. Precision is the share of drawn images within the balls of the
true ones: do they look like true images? Recall is the share of true images within the balls of
the drawn ones: are all kinds of true images drawn? A network whose mode has collapsed draws a few
images for all clouds and has a recall near 0, whatever its precision.

Variant: k = 10 in place of the paper's 3, which is for 50,000 independent images. The sets here
have 20 views of each of a few dozen objects, and of the 3 nearest neighbours of a true image 91 %
show its own object, so that even true images of 12 chairs have a precision of .17 against true
images of 12 others (k = 10: .61). Values for other k, other features or other numbers of images
must not be compared.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrics.frechet import object_blocks
from data_prep.arrays import Floats

NEIGHBOURS = 10
_ROWS = 1024  # distances are taken of so many rows with all others at a time


def share_within(x: NDArray[Any], y: NDArray[Any], k: int = NEIGHBOURS) -> float:
    """Return the share 0..1 of the rows of x [n, d] within the balls of y [m, d].

    It is the precision of x against true features y, and the recall of y for true features x.
    Raises ValueError where an array is not [n, d] with more than k rows or has values that are not
    finite, and where d differs.
    """
    return float(_shares(x, y, np.zeros(len(x), np.intp), np.zeros(len(y), np.intp), k)[0])


def left_out_shares(
    x: NDArray[Any],
    y: NDArray[Any],
    groups_x: NDArray[Any],
    groups_y: NDArray[Any],
    k: int = NEIGHBOURS,
) -> Floats:
    """Return the shares [g] without each object, left out as in `bench.metrics.frechet`.

    groups_x [n] and groups_y [m] name the object of each row; objects in sorted order, of many
    objects blocks of them (`bench.metrics.frechet.object_blocks`). NaN without one that leaves
    k rows or fewer of y, or none of x. Raises as `share_within`.
    """
    names, block = object_blocks(np.concatenate([np.unique(groups_x), np.unique(groups_y)]))
    member_x, member_y = (block[np.searchsorted(names, groups)] for groups in (groups_x, groups_y))
    return _shares(x, y, member_x, member_y, k)[1:]


def _shares(
    x: NDArray[Any], y: NDArray[Any], member_x: NDArray[Any], member_y: NDArray[Any], k: int
) -> Floats:
    """Return the share of all rows, then those without each block, [1 + g]."""
    x, y = _checked(x, k), _checked(y, k)
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"sets of {x.shape[1]} and {y.shape[1]} features cannot be compared")
    count = int(max(member_x.max(), member_y.max())) + 1
    radii = _radii(y, member_y, count, k)
    # Without a block a ball grows if it had a neighbour there; the others stay as they are.
    grown = [np.flatnonzero((radii[1 + g] > radii[0]) & (member_y != g)) for g in range(count)]
    blocks = np.eye(count, dtype=np.float32)[member_y]
    inside = np.empty((1 + count, len(x)), np.bool_)
    for start in range(0, len(x), _ROWS):
        rows = slice(start, start + _ROWS)
        distances = _distances(x[rows], y)
        balls = (distances <= radii[0]).astype(np.float32) @ blocks  # numbers by block, [r, g]
        inside[0, rows] = balls.any(axis=1)
        for g, columns in enumerate(grown):
            in_grown = (distances[:, columns] <= radii[1 + g, columns]).any(axis=1)
            inside[1 + g, rows] = np.delete(balls, g, axis=1).any(axis=1) | in_grown
    shares = [inside[0].mean()]
    for g in range(count):
        kept = member_x != g
        possible = kept.any() and np.count_nonzero(member_y != g) > k
        shares.append(inside[1 + g, kept].mean() if possible else np.nan)
    return np.array(shares)


def _radii(y: Floats, member: NDArray[Any], count: int, k: int) -> Floats:
    """Return the distances to the k-th neighbour among all rows, and without each block.

    [1 + g, m]; infinite where too few rows are left.
    """
    radii = np.full((1 + count, len(y)), np.inf)
    most = min(k + int(np.bincount(member).max()), len(y) - 1)  # neighbours that may count
    for start in range(0, len(y), _ROWS):
        rows = np.arange(start, min(start + _ROWS, len(y)))
        distances = _distances(y[rows], y)
        distances[np.arange(len(rows)), rows] = np.inf  # no row is its own neighbour
        nearest = np.argpartition(distances, most - 1, axis=1)[:, :most]
        ordered = np.take_along_axis(distances, nearest, axis=1)
        order = np.argsort(ordered, axis=1, kind="stable")
        ordered = np.take_along_axis(ordered, order, axis=1)
        members = member[np.take_along_axis(nearest, order, axis=1)]
        radii[0, rows] = ordered[:, k - 1]
        for g in range(count):
            rank = np.cumsum(members != g, axis=1)
            place = np.argmax(rank == k, axis=1)
            reached = rank[:, -1] >= k
            radii[1 + g, rows[reached]] = ordered[reached, place[reached]]
    return radii


def _distances(a: Floats, b: Floats) -> Floats:
    from scipy.spatial.distance import cdist  # a moment to import, which most commands need not

    # By differences, not by products of rows: equal rows are at 0 exactly.
    return cdist(a, b)


def _checked(features: NDArray[Any], k: int) -> Floats:
    values = np.asarray(features, np.float64)
    if values.ndim != 2 or len(values) <= k or not values.shape[1]:
        raise ValueError(f"features must be [n, d] with n > {k}, got {list(values.shape)}")
    if not np.isfinite(values).all():
        raise ValueError("features must be finite")
    return values
