"""Points sorted by their coordinates, for what is not to depend on their order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import Points


def sorted_points(points: Points) -> Points:
    """Return points [N, 3] sorted by x, those of equal x by y, and then by z.

    No coordinate is NaN.
    """
    # One column is sorted in a tenth of the time of three, and few points share their x: only these
    # are sorted by all columns. They lie together, so each group of them stays in its place.
    by_x = points[np.argsort(points[:, 0])]
    equal = by_x[1:, 0] == by_x[:-1, 0]
    shared = np.zeros(len(by_x), bool)
    shared[1:] = equal
    shared[:-1] |= equal
    tied = by_x[shared]
    by_x[shared] = tied[np.lexsort(tied.T[::-1])]
    return by_x


def repeats(ordered: Points) -> NDArray[np.bool_]:
    """Return of sorted points [N, 3] which coincide with the one before them, bool [N]."""
    same = np.zeros(len(ordered), bool)
    same[1:] = (ordered[1:] == ordered[:-1]).all(axis=1)
    return same


def different_points(points: Points) -> Points:
    """Return points [N, 3] sorted by x, y and z, and of points that coincide one, [M, 3].

    They are those of `np.unique(points, axis=0)`, in a sixth to a third of its time.
    """
    ordered = sorted_points(points)
    return ordered[~repeats(ordered)]
