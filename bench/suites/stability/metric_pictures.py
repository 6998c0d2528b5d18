"""Pictures to try metrics on: flat, noise, one pixel, a thin leg, boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import IMAGE_SIZE

Pictures = NDArray[np.uint8]


def flat(level: int, count: int = 1, side: int = IMAGE_SIZE) -> Pictures:
    """Every pixel of one level."""
    return np.full((count, side, side, 3), level, np.uint8)


def noise(seed: int, side: int = IMAGE_SIZE, count: int = 1) -> Pictures:
    """Independent levels, all 256 as likely."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (count, side, side, 3), dtype=np.uint8)


def speck(background: int, level: int, at: int) -> Pictures:
    """One pixel of another level: (64, 64) is in 121 windows, the corner (0, 0) in one."""
    return _painted(flat(background), slice(at, at + 1), slice(at, at + 1), level)


def leg(level: int = 80, rows: slice = slice(40, 80), columns: slice = slice(60, 63)) -> Pictures:
    """A bar of 40 x 3 px on white, all of it thin."""
    return _painted(flat(255), rows, columns, level)


def boxes(count: int = 6) -> Pictures:
    """Coloured boxes of different sizes on white: something for the networks to look at."""
    rng = np.random.default_rng(0)
    images = flat(255, count)
    for image in images:
        top, left, height, width = rng.integers(10, 60, 4)
        image[top : top + height, left : left + width] = rng.integers(0, 255, 3)
    return images


def grey(images: Pictures) -> Pictures:
    """Luma (Rec. 601), rounded half up, in three channels."""
    luma = np.floor((images @ np.array([299.0, 587.0, 114.0]) + 500) / 1000)
    return np.repeat(luma.astype(np.uint8)[..., None], 3, axis=-1)


def _painted(image: Pictures, rows: slice, columns: slice, level: int) -> Pictures:
    image = image.copy()
    image[:, rows, columns] = level
    return image
