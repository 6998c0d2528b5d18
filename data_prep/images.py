"""Pictures between their two forms: float32 in [0, 1] in memory, uint8 on disk and in metrics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import IMAGE_SIZE, Images


def to_uint8(images: Images) -> NDArray[np.uint8]:
    """[0, 1] to 0..255, rounded half up (as the original's PNG writer); values outside are clipped.

    NaN has no place on this scale: the caller checks for it first.
    """
    return np.floor(np.clip(images, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5)).astype(
        np.uint8
    )


def to_float(images: NDArray[np.uint8]) -> Images:
    """0..255 to float32 in [0, 1]; `to_uint8` takes it back exactly."""
    return images.astype(np.float32) / np.float32(255.0)


def blank(count: int) -> NDArray[np.uint8]:
    """`count` pictures of the white background, uint8 [count, IMAGE_SIZE, IMAGE_SIZE, 3]."""
    return np.full((count, IMAGE_SIZE, IMAGE_SIZE, 3), 255, dtype=np.uint8)
