"""Kernel distance of two feature sets: the squared maximum mean discrepancy, unbiased.

With the cubic kernel k(x, y) = (x.y / d + 1)^3 it is what Binkowski et al. 2018
(https://arxiv.org/abs/1801.01401) call KID when the features are those of
`bench.metrics.inception`. Unlike a Fréchet distance, its mean does not depend on the number of
samples, so that small sets can be compared with large ones; it may fall below 0, and is 0 in the
mean where two sets are drawn alike.

torch-fidelity and clean-fid average over random subsets of 1,000; here all samples are one subset:
no randomness, and the least variance.

Sums over pairs are taken in the cheaper of two ways. With u = (x / sqrt(d), 1) and v likewise of y,
k(x, y) = (u.v)^3 is the inner product of the third powers u_i u_j u_k and v_i v_j v_k. So the sum
over two sets is the inner product of their third moments, for d^3 / 3 multiplications a row; pairs
take d for each row of the other set, and half the time for each multiplication. Moments are cheaper
above 5,600 rows of 64 features, and 88,000 of 256. In memory are the features as they are given,
and a few thousand rows of them in float64.

Each mean of kernels is off by at most (n + m + d^2 + 6 d + 200) 2^-53 of the same mean of
(|x|.|y| / d + 1)^3: so many numbers are rounded on the way of a product to the result, n + m of
them in sums over rows, and d in u.v or d^2 in sums over moments.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats

_ROWS, _COLUMNS = 256, 1024  # kernels are taken of so many rows with so many: they fit the cache
_MOMENT_ROWS = 4096  # of a block that are in float64 at a time


def kernel_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the unbiased kernel distance of x [n, d] and y [m, d]; lower is better, symmetric.

        mean of k(x_i, x_j), i != j  +  mean of k(y_i, y_j), i != j  -  2 mean of k(x_i, y_j)

    In float64. Raises ValueError where an array is not [n, d], has fewer than two rows or values
    that are not finite, and where d differs.
    """
    sets = (KernelSet(rows, np.zeros(len(rows), np.intp), 1) for rows in (x, y))
    return kernel_distances(*sets)[0]


class KernelSet:
    """A feature set in blocks, each of which can be left out."""

    def __init__(self, features: NDArray[Any], member: NDArray[np.intp], count: int) -> None:
        """Take rows [n, d] and the block of each [n], 0 .. count - 1; a block may have no rows.

        Raises ValueError where features are not [n, d], where there are fewer than two rows, and
        where values are not finite.
        """
        values = _checked(features)
        order = np.argsort(member, kind="stable")
        self.member = member[order]
        self.ends = np.searchsorted(self.member, np.arange(count + 1))
        self.count, self.width = values.shape
        self._values = values[order]  # in float32 where they are: half of the memory

    def rows(self, low: int, high: int) -> Floats:
        """Return rows u of the head of this module, [high - low, d + 1], in float64."""
        # A feature that is 1 takes the place of the 1 in the kernel, for all pairs at once.
        values = self._values[low:high]
        rows = np.ones((len(values), self.width + 1))
        np.divide(values, np.sqrt(self.width), out=rows[:, :-1], dtype=np.float64)
        return rows

    @property
    def sizes(self) -> Floats:
        """The number of rows of each block [g]."""
        return np.diff(self.ends).astype(np.float64)

    @cached_property
    def within(self) -> Floats:
        """The sums of kernels between blocks [g, g], without those of a row with itself.

        They are kept, because one set is compared with many.
        """
        if _moments_are_cheaper(self, self):
            sums = _moment_sums(self, self)
        else:
            sums = np.triu(_pair_sums(self, self, from_own_block=True))
            sums += np.triu(sums, 1).T
        parts = (self.rows(low, low + _COLUMNS) for low in range(0, self.count, _COLUMNS))
        squares = np.concatenate([np.einsum("nd,nd->n", rows, rows) for rows in parts])
        return sums - np.diag(np.bincount(self.member, squares**3, len(sums)))


def kernel_distances(x: KernelSet, y: KernelSet) -> tuple[float, Floats]:
    """Return the distance, and those [g] without each block.

    NaN without a block that leaves fewer than two rows of a set. Raises ValueError where d differs.
    """
    if x.width != y.width:
        raise ValueError(f"sets of {x.width} and {y.width} features cannot be compared")
    across = (_moment_sums if _moments_are_cheaper(x, y) else _pair_sums)(x, y)

    def distance(kept: Floats) -> float:
        """Return the distance of the blocks that are kept [g], 0 or 1 each."""
        n, m = kept @ x.sizes, kept @ y.sizes
        if min(n, m) < 2:
            return float("nan")
        within_x = kept @ x.within @ kept / (n * (n - 1))
        within_y = kept @ y.within @ kept / (m * (m - 1))
        return float(within_x + within_y - 2.0 * (kept @ across @ kept) / (n * m))

    count = len(across)
    return distance(np.ones(count)), np.array([distance(kept) for kept in 1.0 - np.eye(count)])


def _moments_are_cheaper(a: KernelSet, b: KernelSet) -> bool:
    n, m, d = a.count, b.count, a.width + 1
    return 2 * (n + m) * d * d < 3 * n * m  # one of moments takes twice as long, as measured


def _pair_sums(a: KernelSet, b: KernelSet, from_own_block: bool = False) -> Floats:
    """Return the sums of kernels between blocks [g, g], some rows at a time to save memory.

    With `from_own_block`, where a is b, only those of a block with itself and with later ones.
    """
    count = len(a.sizes)
    sums = np.zeros((count, count))
    for block, (low, high) in enumerate(zip(a.ends[:-1], a.ends[1:], strict=True)):
        for start in range(low, high, _ROWS):
            rows = a.rows(start, min(start + _ROWS, high))
            for begin in range(low if from_own_block else 0, b.count, _COLUMNS):
                columns = slice(begin, begin + _COLUMNS)
                products = rows @ b.rows(begin, begin + _COLUMNS).T
                # A power of arrays takes five times as long.
                kernels = np.einsum("nm,nm->m", products * products, products)
                sums[block] += np.bincount(b.member[columns], kernels, count)
    return sums


def _moment_sums(a: KernelSet, b: KernelSet) -> Floats:
    """Return the sums of kernels between blocks [g, g] from third moments, a part at a time.

    A part has the moments whose smallest index is `first`. The moment (first, j, k) with j, k >
    first stands for three orders of its indices; (first, first, k) has three, too, but is in the
    part twice.
    """
    sums = np.zeros((len(a.sizes), len(b.sizes)))
    for first in range(a.width + 1):
        moments_a = _moments_from(a, first)
        moments_b = moments_a if a is b else _moments_from(b, first)
        weights = np.full(moments_a.shape[1:], 3.0)
        weights[0] = weights[:, 0] = 1.5
        weights[0, 0] = 1.0
        sums += np.tensordot(moments_a * weights, moments_b, ([1, 2], [1, 2]))
    return sums


def _moments_from(rows: KernelSet, first: int) -> Floats:
    """Return the sums over the rows of each block of u_first u_j u_k, j and k >= first."""
    size = rows.width + 1 - first
    moments = np.empty((len(rows.sizes), size, size))
    for block, (low, high) in enumerate(zip(rows.ends[:-1], rows.ends[1:], strict=True)):
        moments[block] = 0.0
        for start in range(low, high, _MOMENT_ROWS):
            part = rows.rows(start, min(start + _MOMENT_ROWS, high))[:, first:]
            moments[block] += (part * part[:, :1]).T @ part
    return moments


def _checked(features: NDArray[Any]) -> NDArray[Any]:
    values = np.asarray(features)
    if values.dtype != np.float32:
        values = values.astype(np.float64)
    if values.ndim != 2 or len(values) < 2 or not values.shape[1]:
        raise ValueError(f"features must be [n, d] with n >= 2, got {list(values.shape)}")
    if not np.isfinite(values).all():
        raise ValueError("features must be finite")
    return values
