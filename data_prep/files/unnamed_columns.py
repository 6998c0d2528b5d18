"""Guesses at columns that no line names: poses, times and colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# The most columns that a cloud without names has: x, y, z, colour, normal, and some ten scalars. A
# matrix or an image has a hundred.
MOST_UNNAMED = 20
_UNIT = 0.02  # how far from 1 the length of a unit vector is that was written with two decimals
# How many times as large as the coordinates behind it a column of times is. A cloud that is sorted
# by x grows as well, and is rarely a hundred times as far from the origin as it is wide.
_TIMES_LARGER = 100
_FEWEST_TIMES = 5  # rows that grow by chance once in 120 files


def are_poses(numbers: NDArray[np.float64]) -> bool:
    """Return whether rows [N, columns] are poses of a camera: rotations with a translation.

    They are matrices of 3 x 4 or 4 x 4 numbers, by rows or by columns, each in one row of 12 or 16
    numbers or in four rows of 4; or a time, a position and a quaternion.
    """
    rows, width = numbers.shape
    if width == 4 and rows >= 4:
        whole = numbers[: rows - rows % 4].reshape(-1, 4, 4)
        return bool((whole[:, 3] == [0, 0, 0, 1]).all()) and _are_rotations(whole[:, :3, :3])
    if width == 8:  # four such columns may also be a normal and a curvature
        return _only_grows(numbers[:, 0]) and _are_units(numbers[:, 4:])
    if width == 12:
        return _are_rotations(numbers.reshape(-1, 3, 4)[:, :, :3])
    return width == 16 and _are_rotations(numbers.reshape(-1, 4, 4)[:, :3, :3])


def colors_of_nine(numbers: NDArray[np.float64]) -> tuple[int, ...]:
    """Return the columns of red, green and blue in rows of 9 numbers; () where that is not certain.

    They stand before or behind a normal, and are whole numbers of 0 to 255 that are not all 0 or 1.
    """
    halves = (3, 4, 5), (6, 7, 8)
    for colors, normals in (halves, halves[::-1]):
        values = numbers[:, colors]
        in_range = (values == np.floor(values)) & (values >= 0) & (values <= 255)
        if in_range.all() and values.max(initial=0) > 1 and _are_units(numbers[:, normals]):
            return colors
    return ()


def are_times(first: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether a column [N] only grows, and is far larger than those behind it [N, 2]."""
    if not _only_grows(first):
        return False
    size = np.abs(others[np.isfinite(others)]).max(initial=0)
    return bool(np.abs(np.median(first)) > _TIMES_LARGER * size)


def _only_grows(values: NDArray[np.float64]) -> bool:
    """Return whether each of many values is at least the one before, and the last one larger."""
    enough = len(values) >= _FEWEST_TIMES and values[0] != values[-1]
    return enough and bool((np.diff(values) >= 0).all())


def _are_units(vectors: NDArray[np.float64]) -> bool:
    """Return whether vectors [N, D] have the length 1."""
    lengths = np.linalg.norm(vectors, axis=1)
    return bool((np.abs(lengths - 1) < _UNIT).all())


def _are_rotations(matrices: NDArray[np.float64]) -> bool:
    """Return whether the rows of matrices [N, 3, 3] are unit vectors at right angles."""
    products = matrices @ matrices.transpose(0, 2, 1)
    return bool((np.abs(products - np.eye(3)) < _UNIT).all())
