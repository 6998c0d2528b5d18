"""Thumbnails of golden images in one PNG, for people; checksums compare the images themselves."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_prep.failures import BadInput
from data_prep.scene import IMAGE_SIZE, UInt8Images

SIDE = 64  # pixels: half an image
ACROSS = 24
NO_IMAGE = np.full((SIDE, SIDE, 3), 255, np.uint8)
COLOURS = 256  # of the whole sheet: a third of the bytes that all colours take


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image [IMAGE_SIZE, IMAGE_SIZE, 3] as [SIDE, SIDE, 3].

    Pixels are means of blocks, rounded half up.
    """
    block = IMAGE_SIZE // SIDE
    blocks = image.reshape(SIDE, block, SIDE, block, 3).astype(np.float64)
    return np.floor(blocks.mean(axis=(1, 3)) + 0.5).astype(np.uint8)


def to_png(thumbnails: Sequence[NDArray[np.uint8]]) -> bytes:
    """Return a sheet of thumbnails in their order, ACROSS in a row; the last row ends in white."""
    from PIL import Image

    rows = -(-len(thumbnails) // ACROSS)
    tiles = np.full((rows * ACROSS, SIDE, SIDE, 3), 255, np.uint8)
    tiles[: len(thumbnails)] = thumbnails
    grid = tiles.reshape(rows, ACROSS, SIDE, SIDE, 3).swapaxes(1, 2)
    sheet = Image.fromarray(grid.reshape(rows * SIDE, ACROSS * SIDE, 3))
    buffer = io.BytesIO()
    sheet.quantize(COLOURS).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def read_png(path: Path) -> UInt8Images:
    """Return the thumbnails [N, SIDE, SIDE, 3] of a sheet, up to the end of its last row.

    Raises BadInput for a file that is no sheet.
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
