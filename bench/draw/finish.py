"""Images made ready to be written: at another size, without background, or side by side.

All functions take arrays and return arrays.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import IMAGE_SIZE, UInt8Images

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

# A coverage that is as near as this to 0 or 1 counts as 0 or 1, which networks hardly ever reach.
_UNSURE = 8 / 255
# The measures of a sheet, in pixels.
MARGIN = 6  # the space around tiles and between them
LABEL_HEIGHT = 18  # the height of the line above a tile that holds its label
_LABEL_PX = 13  # the size of the letters of a label
PROBLEM_PX = 11  # the size of the letters of a reason, which stands in place of an image
PROBLEM_HEIGHT = 14  # the distance from line to line in a reason
# The colours of a sheet, as red, green and blue: of labels, of reasons, and of their background.
INK, PROBLEM_INK, PROBLEM_GROUND = (40, 40, 40), (150, 30, 30), (250, 243, 240)
# The most tiles in a row: a sheet of bench render is then at most 1,316 pixels wide.
_MOST_A_ROW = 5


def resized(images: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return images [F, H, W, 3] resampled to [F, size, size, 3] with Lanczos' filter."""
    if images.shape[1:3] == (size, size):
        return images
    from PIL import Image

    lanczos = Image.Resampling.LANCZOS
    return np.stack(
        [np.asarray(Image.fromarray(image).resize((size, size), lanczos)) for image in images]
    )


def without_background(
    images: UInt8Images, coverage: NDArray[np.float32], size: int
) -> NDArray[np.uint8]:
    """Return images on white, [F, S, S, 3], as RGBA images [F, size, size, 4].

    The opacity of a pixel is its coverage, [F, S, S] in 0..1, rounded to 0 or 1 where it is within
    _UNSURE of them. Colours are such that, laid on white, the result is the image that `resized`
    returns, to within a grey level.
    """
    rgba = np.empty((len(images), size, size, 4), np.uint8)
    for image, share, out in zip(images, coverage, rgba, strict=True):
        (large,) = resized(image[None], size)
        covered = np.where(share < _UNSURE, 0, np.where(share > 1 - _UNSURE, 1, share))
        levels = np.floor(255 * enlarged(covered, size).clip(0, 1) + 0.5)
        # A pixel that is less opaque than it is dark would need a colour darker than black.
        levels = np.maximum(levels, 255 - large.min(axis=-1))[..., None]
        colour = np.full(large.shape, 255.0)
        np.divide(255 * (large + levels - 255), levels, out=colour, where=levels > 0)
        out[...] = np.concatenate([np.floor(colour + 0.5), levels], axis=-1)
    return rgba


def enlarged(share: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Return a coverage [S, S] resampled as `resized` does; values may go below 0 or above 1."""
    from PIL import Image

    if share.shape == (size, size):
        return share
    whole = Image.fromarray(share.astype(np.float32))
    return np.asarray(whole.resize((size, size), Image.Resampling.LANCZOS))


@dataclass(frozen=True, eq=False)
class Tile:
    """A label with an image for each frame, [F, S, S, 3], or with the reason of a failure."""

    label: str
    images: UInt8Images | str


def columns_of(count: int) -> int:
    """Return the number of tiles in a row, at most _MOST_A_ROW, so that rows are equally full."""
    rows = -(-count // _MOST_A_ROW)
    return -(-count // max(rows, 1))


def draw_sheet(
    tiles: Sequence[Tile], columns: int, scale: int, size: int = IMAGE_SIZE
) -> UInt8Images:
    """Return frames uint8 [F, H, W, 3] that show the tiles row by row, each under its label.

    columns  the number of tiles in a row
    scale    how many pixels wide and high a pixel of the images becomes
    size     width and height of an image in pixels; smaller images get larger pixels

    Where a tile has a reason, it stands in place of the images, as far as it fits. A sheet without
    any image has one frame. Raises ValueError where tiles have different numbers of frames.
    """
    from PIL import Image, ImageDraw

    side = scale * size
    zoom = max(1, side // (2 * IMAGE_SIZE))  # letters grow with the tiles
    above = zoom * LABEL_HEIGHT
    wide, high = side + MARGIN, side + above + MARGIN
    page = Image.new("RGB", (MARGIN + columns * wide, MARGIN + -(-len(tiles) // columns) * high))
    draw = ImageDraw.Draw(page)
    draw.rectangle((0, 0, *page.size), "white")
    corners = []  # column and row of the upper left pixel of each tile
    for i in range(len(tiles)):
        row, column = divmod(i, columns)
        corners.append((MARGIN + column * wide, MARGIN + row * high))
    for tile, (left, top) in zip(tiles, corners, strict=True):
        label_px = zoom * _LABEL_PX
        draw.text((left, top), shortened(tile.label, label_px, side), INK, _font(label_px))
        if isinstance(tile.images, str):
            low = top + above
            draw.rectangle((left, low, left + side - 1, low + side - 1), PROBLEM_GROUND)
            inner = side - 2 * MARGIN
            letters_px, step = zoom * PROBLEM_PX, zoom * PROBLEM_HEIGHT
            lines = wrapped(tile.images, letters_px, inner)[: inner // step]
            for i, line in enumerate(lines):
                at = (left + MARGIN, low + MARGIN + i * step)
                draw.text(at, line, PROBLEM_INK, _font(letters_px))
    counts = {len(tile.images) for tile in tiles if not isinstance(tile.images, str)}
    if len(counts) > 1:
        raise ValueError(f"tiles have {sorted(counts)} frames; give equally many")
    frames = np.repeat(np.asarray(page)[None], max(counts, default=1), axis=0)
    for tile, (left, top) in zip(tiles, corners, strict=True):
        if not isinstance(tile.images, str):
            low = top + above
            nearest = np.arange(side) * tile.images.shape[1] // side
            frames[:, low : low + side, left : left + side] = tile.images[:, nearest][:, :, nearest]
    return frames


def shortened(text: str, size_px: int, width: float) -> str:
    """Return the text; where it is wider than `width` pixels, its beginning and end around "…"."""
    font = _font(size_px)
    short, kept = text, len(text)
    while kept and font.getlength(short) > width:
        kept -= 1
        short = f"{text[: kept - kept // 2]}…{text[len(text) - kept // 2 :]}"
    return short


def wrapped(text: str, size_px: int, width: float) -> list[str]:
    """Return the text in lines that fit into `width` pixels; a word that does not is shortened."""
    font = _font(size_px)
    lines: list[str] = []
    for word in (shortened(word, size_px, width) for word in text.split()):
        if lines and font.getlength(f"{lines[-1]} {word}") <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


@functools.cache
def _font(size_px: int) -> FreeTypeFont | ImageFont:
    from PIL import ImageFont

    return ImageFont.load_default(size_px)  # Pillow's own: the same on every machine
