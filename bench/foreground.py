"""Where a picture shows something: white is background, by the conventions of all pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WHITE = 255


def foreground(images: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The pixels [N, H, W] that are not white, of uint8 [N, H, W, C]; edges count as a whole."""
    return np.any(images < WHITE, axis=-1)


def contrast(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Contrast to white [N, H, W], 0..255: 255 minus the mean of the channels."""
    total = images.sum(axis=-1, dtype=np.int32)
    return (WHITE - total / images.shape[-1]).astype(np.float32)


def object_boxes(truth: NDArray[np.uint8]) -> NDArray[np.intp]:
    """The box [N, (top, bottom, left, right)] of the foreground of each true picture.

    In pixels, bottom and right exclusive; all 0 for a blank picture.
    """
    shown = foreground(truth)
    boxes = np.zeros((len(shown), 4), np.intp)
    for box, mask in zip(boxes, shown, strict=True):
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        if len(rows):
            box[:] = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    return boxes
