"""Where a picture shows something: white is background, by the conventions of all pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WHITE = 255


def foreground(images: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The pixels [N, H, W] that are not white, of uint8 [N, H, W, C]; edges count as a whole.

    Raises ValueError where the images are not uint8.
    """
    _require_uint8(images)
    return np.any(images < WHITE, axis=-1)


def contrast(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Contrast to white [N, H, W], 0..255: 255 minus the mean of the channels.

    Raises ValueError where the images are not uint8.
    """
    _require_uint8(images)
    total = images.sum(axis=-1, dtype=np.int32)
    return (WHITE - total / images.shape[-1]).astype(np.float32)


def object_boxes(truth: NDArray[np.uint8]) -> NDArray[np.intp]:
    """The box [N, (top, bottom, left, right)] of the foreground of each true picture.

    In pixels, bottom and right exclusive; all 0 for a blank picture.

    Raises ValueError where the pictures are not uint8 or not [N, H, W, C].
    """
    shown = foreground(truth)
    if truth.ndim != 4:
        raise ValueError(f"images must be [N, H, W, C], got {truth.dtype} {list(truth.shape)}")
    boxes = np.zeros((len(shown), 4), np.intp)
    for box, mask in zip(boxes, shown, strict=True):
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        if len(rows):
            box[:] = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    return boxes


def _require_uint8(images: NDArray[np.uint8]) -> None:
    """On the scale 0..1 all is dark, and NaN is not: neither may pass for a picture."""
    if images.dtype != np.uint8:
        found = f"{images.dtype} {list(images.shape)}"
        raise ValueError(f"images must be uint8 (range 0..255), got {found}")
