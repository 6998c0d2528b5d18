"""Kernel distance of two feature sets: the squared maximum mean discrepancy, unbiased.

With the cubic kernel k(x, y) = (x.y / d + 1)^3 it is what Binkowski et al. 2018
(https://arxiv.org/abs/1801.01401) call KID when the features are those of
`bench.metrics.inception`. Unlike a Fréchet distance, its mean does not depend on the number of
samples, so that small sets can be compared with large ones; it may fall below 0, and is 0 in the
mean where two sets are drawn alike.

torch-fidelity and clean-fid average over random subsets of 1,000; here all samples are one subset:
no randomness, and the least variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrics.frechet import object_blocks
from data_prep.arrays import Floats

_ROWS = 1024  # kernels are taken of so many rows with as many at a time


def kernel_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the unbiased kernel distance of x [n, d] and y [m, d]; lower is better, symmetric.

        mean of k(x_i, x_j), i != j  +  mean of k(y_i, y_j), i != j  -  2 mean of k(x_i, y_j)

    In float64. Raises ValueError where an array is not [n, d], has fewer than two rows or values
    that are not finite, and where d differs.
    """
    member_x, member_y = np.zeros(len(x), np.int64), np.zeros(len(y), np.int64)
    return _distance(_block_sums(x, y, member_x, member_y, 1), np.ones(1))


def left_out_kernel_distances(
    x: NDArray[Any], y: NDArray[Any], groups_x: NDArray[Any], groups_y: NDArray[Any]
) -> tuple[float, Floats]:
    """Return the distance, and those [g] without each object, left out as in `frechet`.

    groups_x [n] and groups_y [m] name the object of each row; objects in sorted order, of many
    objects groups of them (`bench.metrics.frechet.object_blocks`). NaN without one that leaves
    fewer than two rows of a set. Raises as `kernel_distance`.
    """
    names, block = object_blocks(np.concatenate([np.unique(groups_x), np.unique(groups_y)]))
    count = int(block.max()) + 1
    member_x, member_y = (block[np.searchsorted(names, groups)] for groups in (groups_x, groups_y))
    sums = _block_sums(x, y, member_x, member_y, count)
    without = np.array([_distance(sums, kept) for kept in 1.0 - np.eye(count)])
    return _distance(sums, np.ones(count)), without


@dataclass(frozen=True, eq=False)
class _BlockSums:
    """The sums of kernels between the blocks of two sets, [g, g] each, and rows of a block [g].

    Within a set no row is taken with itself.
    """

    xx: Floats
    yy: Floats
    xy: Floats
    rows_x: Floats
    rows_y: Floats


def _block_sums(
    x: NDArray[Any], y: NDArray[Any], member_x: NDArray[Any], member_y: NDArray[Any], count: int
) -> _BlockSums:
    a, b = _checked(x), _checked(y)
    if a.shape[1] != b.shape[1]:
        raise ValueError(f"sets of {a.shape[1]} and {b.shape[1]} features cannot be compared")
    return _BlockSums(
        xx=_within(a, member_x, count),
        yy=_within(b, member_y, count),
        xy=_sums(a, b, member_x, member_y, count),
        rows_x=np.bincount(member_x, minlength=count).astype(np.float64),
        rows_y=np.bincount(member_y, minlength=count).astype(np.float64),
    )


def _within(a: Floats, member: NDArray[Any], count: int) -> Floats:
    """Return the sums of one set, without the kernels of rows with themselves."""
    themselves = (np.einsum("nd,nd->n", a, a) / a.shape[1] + 1.0) ** 3
    return _sums(a, a, member, member, count) - np.diag(np.bincount(member, themselves, count))


def _sums(
    a: Floats, b: Floats, member_a: NDArray[Any], member_b: NDArray[Any], count: int
) -> Floats:
    """Return sums of kernels between blocks [g, g], some rows at a time to save memory."""
    sums, blocks = np.zeros((count, count)), np.eye(count)
    for i in range(0, len(a), _ROWS):
        rows = slice(i, i + _ROWS)
        for j in range(0, len(b), _ROWS):
            columns = slice(j, j + _ROWS)
            products = a[rows] @ b[columns].T / a.shape[1] + 1.0
            kernels = products * products * products  # a power of arrays takes five times as long
            sums += blocks[member_a[rows]].T @ (kernels @ blocks[member_b[columns]])
    return sums


def _distance(sums: _BlockSums, kept: Floats) -> float:
    """Return the distance of the objects that are kept [g], 0 or 1 each."""
    n, m = kept @ sums.rows_x, kept @ sums.rows_y
    if min(n, m) < 2:
        return float("nan")
    within_x = kept @ sums.xx @ kept / (n * (n - 1))
    within_y = kept @ sums.yy @ kept / (m * (m - 1))
    return float(within_x + within_y - 2.0 * (kept @ sums.xy @ kept) / (n * m))


def _checked(features: NDArray[Any]) -> Floats:
    values = np.asarray(features, np.float64)
    if values.ndim != 2 or len(values) < 2 or not values.shape[1]:
        raise ValueError(f"features must be [n, d] with n >= 2, got {list(values.shape)}")
    if not np.isfinite(values).all():
        raise ValueError("features must be finite")
    return values
