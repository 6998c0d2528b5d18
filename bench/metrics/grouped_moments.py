"""Fréchet distances of sets that come in parts, and without each group of their objects."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrics.frechet import (
    MOST_KEPT,
    Centred,
    Moments,
    TooFewSamples,
    centred_to_frechet,
    checked_features,
    merged,
    moments,
    moments_without_each,
    no_rows,
    to_centred,
)
from data_prep.arrays import Floats

_WAITING = 1024  # rows of a group that are kept as they are before they become moments
_PANEL = 32  # columns that LAPACK reduces at a time


class GroupedMoments:
    """A feature set that comes in parts, and of which groups of objects can be left out.

    Rows wait as they come, float32 say, until a group has _WAITING of them, or as many as features.
    Then they are merged into its moments.
    """

    def __init__(self, count: int) -> None:
        """Take the number of groups."""
        self._waiting: list[list[NDArray[Any]]] = [[] for _ in range(count)]
        self._moments: list[Moments | None] = [None] * count
        self._merged: dict[tuple[int, int], Moments] = {}  # of consecutive groups
        self._whole: Centred | None = None
        self._kept: list[Centred] | None = None

    def add(self, features: NDArray[Any], groups: NDArray[np.intp]) -> None:
        """Add rows [n, d] of the groups [n]. Raises ValueError as `moments`."""
        features = checked_features(features)
        self._merged, self._whole, self._kept = {}, None, None
        order = np.argsort(groups, kind="stable")
        present, starts = np.unique(groups[order], return_index=True)
        for group, rows in zip(present.tolist(), np.split(order, starts[1:]), strict=True):
            waiting = self._waiting[group]
            waiting.append(features[rows])
            if sum(map(len, waiting)) > max(_WAITING, features.shape[1]):
                self._group(group)

    def whole(self) -> Centred:
        """Return the moments of all rows, kept for the next call.

        Raises TooFewSamples: fewer than two rows.
        """
        if self._whole is None:
            self._whole = to_centred(self._between(0, len(self)))
        return self._whole

    def __len__(self) -> int:
        """Return the number of groups."""
        return len(self._moments)

    def without_each(self) -> Iterable[Centred]:
        """Return the moments without each group, kept for the next call where they are small.

        Raises TooFewSamples: fewer than two rows left.
        """
        if self._kept is not None:
            return self._kept
        without = moments_without_each(len(self), self._between, _merged_triangles)
        if self._are_small():
            without = self._kept = list(without)
            self._merged = {}
        return without

    def _are_small(self) -> bool:
        return len(self) * self._width() ** 2 <= MOST_KEPT

    def _between(self, low: int, high: int) -> Moments:
        """Return the moments of groups low .. high - 1, kept where they are small."""
        if high - low < 2:
            return self._group(low) if low < high else no_rows(self._width())
        if (low, high) in self._merged:
            return self._merged[low, high]
        middle = (low + high) // 2
        rows = _merged_triangles(self._between(low, middle), self._between(middle, high))
        if self._are_small():  # large ones are merged anew
            self._merged[low, high] = rows
        return rows

    def _group(self, group: int) -> Moments:
        """Return the moments of a group. More rows than features do not wait any longer."""
        known, waiting = self._moments[group], self._waiting[group]
        if not waiting:
            return known or no_rows(self._width())
        fresh = moments(np.concatenate(waiting))
        rows = merged(known, fresh) if known else fresh
        if rows.n > rows.mean.size:
            self._moments[group] = rows
            waiting.clear()
        return rows

    def _width(self) -> int:
        """Return the number of features, which any group with rows tells."""
        widths = [m.mean.size for m in self._moments if m]
        widths += [waiting[0].shape[1] for waiting in self._waiting if waiting]
        return widths[0] if widths else 0


def grouped_distances(a: GroupedMoments, b: GroupedMoments) -> tuple[float, Floats]:
    """Return the distance of two sets, and the distances [g] without each of their groups.

    These are all NaN where a group leaves fewer than two rows of a set. Raises TooFewSamples where
    a set has fewer.
    """
    value = centred_to_frechet(a.whole(), b.whole())
    try:
        pairs = zip(a.without_each(), b.without_each(), strict=True)
        return value, np.array([centred_to_frechet(*pair) for pair in pairs])
    except TooFewSamples:
        return value, np.full(len(a), np.nan)


def _merged_triangles(a: Moments, b: Moments) -> Moments:
    """Return `merged(a, b)`, up to three times as fast where a root is a triangle of d rows."""
    if not _is_triangle(a.root):
        a, b = b, a
    if not _is_triangle(a.root):
        return merged(a, b)
    from scipy.linalg.lapack import dtpqrt  # a moment to import, which most commands need not

    d = a.mean.size
    share = b.n / (a.n + b.n)
    shift = b.mean - a.mean
    rows, between = b.root, np.sqrt(a.n * share) * shift[None]
    triangular = d if _is_triangle(rows) else 0  # rows of which LAPACK knows that they are one
    if not triangular:
        rows = np.concatenate([rows, between])
    root, *_ = dtpqrt(triangular, min(_PANEL, d), a.root, rows)
    if triangular:
        root, *_ = dtpqrt(0, min(_PANEL, d), root, between)
    return Moments(a.n + b.n, a.mean + share * shift, np.ascontiguousarray(root))


def _is_triangle(root: Floats) -> bool:
    from scipy.linalg import bandwidth

    return root.shape[0] == root.shape[1] > 1 and bandwidth(root)[0] == 0
