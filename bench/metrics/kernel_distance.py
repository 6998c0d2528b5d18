"""Kernel distance of two feature sets: the squared maximum mean discrepancy, unbiased.

The kernel is k(x, y) = (x.y / d + 1)^3, where d is the number of features. With the features of
`bench.metrics.inception` Binkowski et al. 2018 (https://arxiv.org/abs/1801.01401) call the distance
KID. Unlike a Fréchet distance, its expected value does not depend on the number of samples, so that
small sets can be compared with large ones. For two sets from the same distribution this value is 0,
so that a single distance may fall below 0.

torch-fidelity and clean-fid average over random subsets of 1,000 samples. Here all samples are one
subset, so that there is no randomness and the variance is the least.

The memory holds the features as they are given, and a few thousand rows of them in float64. Each
mean of kernels has a rounding error of at most (n + m + 7 d + 200) 2^-53 times the same mean of
(|x|.|y| / d + 1)^3, because that many roundings, n + m of them in sums over rows, stand between a
product and the result.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrics.frechet import checked_set
from data_prep.arrays import Floats

# How many rows of one set and of the other make a block of kernels; such a block fits the cache.
_ROWS, _COLUMNS = 256, 1024


def kernel_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the unbiased kernel distance of x [n, d] and y [m, d]; lower is better, symmetric.

        mean of k(x_i, x_j), i != j  +  mean of k(y_i, y_j), i != j  -  2 mean of k(x_i, y_j)

    It is computed in float64. Raises as `bench.metrics.frechet.frechet_distance`.
    """
    sets = (KernelSet(rows, np.zeros(len(rows), np.intp), 1) for rows in (x, y))
    return kernel_distances(*sets)[0]


class KernelSet:
    """A feature set in blocks, each of which can be left out.

    member  [n], the block of each row; the rows are sorted by their blocks
    ends    [count + 1], the first row of each block, and at last n
    count   the number of rows n
    width   the number of features d
    """

    def __init__(self, features: NDArray[Any], member: NDArray[np.intp], count: int) -> None:
        """Take the rows [n, d] and the block of each row [n].

        Blocks are 0 .. count - 1, of which some may have no rows. Raises as
        `bench.metrics.frechet.frechet_distance`.
        """
        values = checked_set(features)
        order = np.argsort(member, kind="stable")
        self.member = member[order]
        self.ends = np.searchsorted(self.member, np.arange(count + 1))
        self.count, self.width = values.shape
        self._values = values[order]  # float32 stays float32, which takes half of the memory

    def rows(self, low: int, high: int) -> Floats:
        """Return the rows u = (x / sqrt(d), 1) [high - low, d + 1] of some features x.

        The kernel of two such rows is (u.v)^3.
        """
        # The last feature, which is 1, makes the 1 in the kernel, so that it need not be added.
        values = self._values[low:high]
        rows = np.ones((len(values), self.width + 1))
        np.divide(values, np.sqrt(self.width), out=rows[:, :-1], dtype=np.float64)
        return rows

    @property
    def sizes(self) -> Floats:
        """The number of rows of each of the g blocks."""
        return np.diff(self.ends).astype(np.float64)

    @cached_property
    def within(self) -> Floats:
        """The sums of the kernels of all rows of two blocks, for all pairs of blocks [g, g].

        Kernels of a row with itself are left out. The sums are kept, because one set is compared
        with many.
        """
        sums = np.triu(_pair_sums(self, self, from_own_block=True))
        sums += np.triu(sums, 1).T
        parts = (self.rows(low, low + _COLUMNS) for low in range(0, self.count, _COLUMNS))
        squares = np.concatenate([np.einsum("nd,nd->n", rows, rows) for rows in parts])
        return sums - np.diag(np.bincount(self.member, squares**3, len(sums)))


def kernel_distances(x: KernelSet, y: KernelSet) -> tuple[float, Floats]:
    """Return the distance of two sets, and the distances [g] when each block is left out.

    The second are NaN for a block without which a set has fewer than two rows. Raises ValueError
    where the numbers of features differ.
    """
    if x.width != y.width:
        raise ValueError(f"sets of {x.width} and {y.width} features cannot be compared")
    across = _pair_sums(x, y)

    def distance(kept: Floats) -> float:
        """Return the distance of the sets when some blocks are left out.

        kept  [g], 1 for each block that is kept, else 0
        """
        n, m = kept @ x.sizes, kept @ y.sizes
        if min(n, m) < 2:
            return float("nan")
        within_x = kept @ x.within @ kept / (n * (n - 1))
        within_y = kept @ y.within @ kept / (m * (m - 1))
        return float(within_x + within_y - 2.0 * (kept @ across @ kept) / (n * m))

    count = len(across)
    return distance(np.ones(count)), np.array([distance(kept) for kept in 1.0 - np.eye(count)])


def _pair_sums(a: KernelSet, b: KernelSet, from_own_block: bool = False) -> Floats:
    """Return the sums of the kernels of all rows of two blocks, for all pairs of blocks [g, g].

    from_own_block  where a is b: take only pairs of a block with itself and with later blocks,
                    since the others have the same sums

    The kernels are computed some rows at a time, which saves memory.
    """
    count = len(a.sizes)
    sums = np.zeros((count, count))
    for block, (low, high) in enumerate(zip(a.ends[:-1], a.ends[1:], strict=True)):
        for start in range(low, high, _ROWS):
            rows = a.rows(start, min(start + _ROWS, high))
            for begin in range(low if from_own_block else 0, b.count, _COLUMNS):
                columns = slice(begin, begin + _COLUMNS)
                products = rows @ b.rows(begin, begin + _COLUMNS).T
                # Written as a product, because a power of arrays takes five times as long.
                kernels = np.einsum("nm,nm->m", products * products, products)
                sums[block] += np.bincount(b.member[columns], kernels, count)
    return sums
