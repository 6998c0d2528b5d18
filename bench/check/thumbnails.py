"""Thumbnails of golden images, and the PNG with a sheet of them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.scene import IMAGE_SIZE, UInt8Images

SIDE = 64  # side of a thumbnail in pixels, half that of an image
ACROSS = 24  # number of thumbnails in a row of the sheet
_COLOURS = 256  # number of colours of the sheet; with all colours it takes three times the bytes


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image uint8 [IMAGE_SIZE, IMAGE_SIZE, 3] reduced to [SIDE, SIDE, 3].

    Each pixel is the mean of a block of pixels, rounded half up.
    """
    block = IMAGE_SIZE // SIDE
    blocks = image.reshape(SIDE, block, SIDE, block, 3).astype(np.float64)
    return np.floor(blocks.mean(axis=(1, 3)) + 0.5).astype(np.uint8)


def to_png(thumbnails: Sequence[NDArray[np.uint8]]) -> bytes:
    """Return thumbnails as a PNG, ACROSS in a row; the last row is filled up with white."""
    from PIL import Image

    rows = -(-len(thumbnails) // ACROSS)
    tiles = np.full((rows * ACROSS, SIDE, SIDE, 3), 255, np.uint8)
    tiles[: len(thumbnails)] = thumbnails
    grid = tiles.reshape(rows, ACROSS, SIDE, SIDE, 3).swapaxes(1, 2)
    sheet = Image.fromarray(grid.reshape(rows * SIDE, ACROSS * SIDE, 3))
    buffer = io.BytesIO()
    sheet.quantize(_COLOURS).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def read_png(path: Path) -> UInt8Images:
    """Return the thumbnails [N, SIDE, SIDE, 3] of a sheet that `to_png` made.

    The white ones at the end of the last row are returned, too. Raises BadInput for another file.
    """
    from PIL import Image

    try:
        with Image.open(path, formats=("PNG",)) as image:
            sheet = np.asarray(image.convert("RGB"))
    except OSError as error:
        raise BadInput(f"{path}: not a readable PNG ({error}); restore it with git") from error
    rows, width = len(sheet) // SIDE, ACROSS * SIDE
    if sheet.shape != (rows * SIDE, width, 3):
        raise BadInput(
            f"{path}: no sheet of thumbnails, which is {width} pixels wide; restore it with git"
        )
    return sheet.reshape(rows, SIDE, ACROSS, SIDE, 3).swapaxes(1, 2).reshape(-1, SIDE, SIDE, 3)
