"""Kernel distance of two feature sets: the squared maximum mean discrepancy, unbiased.

With the cubic kernel k(x, y) = (x.y / d + 1)^3 it is what Binkowski et al. 2018
(https://arxiv.org/abs/1801.01401) call KID when the features are those of
`bench.metrics.inception`. Unlike a Fréchet distance, its mean does not depend on the number of
samples, so that small sets can be compared with large ones; it may fall below 0, and is 0 in the
mean where two sets are drawn alike.

torch-fidelity and clean-fid average over random subsets of 1,000; here all samples are one subset:
no randomness, and the least variance.

In memory are the features as they are given, and a few thousand rows of them in float64. Each mean
of kernels is off by at most (n + m + 7 d + 200) 2^-53 of the same mean of (|x|.|y| / d + 1)^3: so
many numbers are rounded on the way of a product to the result, n + m of them in sums over rows.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrics.frechet import checked_set
from data_prep.arrays import Floats

_ROWS, _COLUMNS = 256, 1024  # kernels are taken of so many rows with so many: they fit the cache


def kernel_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the unbiased kernel distance of x [n, d] and y [m, d]; lower is better, symmetric.

        mean of k(x_i, x_j), i != j  +  mean of k(y_i, y_j), i != j  -  2 mean of k(x_i, y_j)

    In float64. Raises as `bench.metrics.frechet.frechet_distance`.
    """
    sets = (KernelSet(rows, np.zeros(len(rows), np.intp), 1) for rows in (x, y))
    return kernel_distances(*sets)[0]


class KernelSet:
    """A feature set in blocks, each of which can be left out."""

    def __init__(self, features: NDArray[Any], member: NDArray[np.intp], count: int) -> None:
        """Take rows [n, d] and the block of each [n], 0 .. count - 1; a block may have no rows.

        Raises as `bench.metrics.frechet.frechet_distance`.
        """
        values = checked_set(features)
        order = np.argsort(member, kind="stable")
        self.member = member[order]
        self.ends = np.searchsorted(self.member, np.arange(count + 1))
        self.count, self.width = values.shape
        self._values = values[order]  # in float32 where they are: half of the memory

    def rows(self, low: int, high: int) -> Floats:
        """Return rows u = (x / sqrt(d), 1) [high - low, d + 1]; a kernel is (u.v)^3."""
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
    across = _pair_sums(x, y)

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
