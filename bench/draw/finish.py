"""Images made ready to be written: at another size, without background, or side by side.

Pure: arrays to arrays.
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

# Darkness, 0 to 1, below which a pixel is background: networks draw it a little off white.
_BACKGROUND = 8 / 255
# A coverage so near to 0 or 1 counts as 0 or 1, which networks hardly ever reach.
_UNSURE = 8 / 255
_EDGE_PX = 2  # width in pixels of the smoothed edges of networks; those of meshes have one
# The parts of a sheet, in pixels.
MARGIN = 6  # around and between tiles
LABEL_HEIGHT = 18  # of the line above a tile
_LABEL_PX = 13  # size of its letters
PROBLEM_PX = 11  # size of the letters of a reason in place of an image
PROBLEM_HEIGHT = 14  # from line to line of such a reason
# Colours of a sheet: of labels, and of the letters and the ground of a reason.
INK, PROBLEM_INK, PROBLEM_GROUND = (40, 40, 40), (150, 30, 30), (250, 243, 240)
_MOST_A_ROW = 5  # tiles: a sheet of bench render is then at most 1,316 pixels wide


def resized(images: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return images [F, H, W, 3] as [F, size, size, 3], by Lanczos' filter."""
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
    """Return images on white, [F, S, S, 3], as RGBA [F, size, size, 4] that are the same on white.

    The opacity of a pixel is its coverage, [F, S, S] in 0..1, rounded to 0 or 1 within _UNSURE. Its
    colour is the one that on white gives the pixel of the opaque image (of `resized`) again, within
    a grey level.
    """
    rgba = np.empty((len(images), size, size, 4), np.uint8)
    for image, share, out in zip(images, coverage, rgba, strict=True):
        (large,) = resized(image[None], size)
        covered = np.where(share < _UNSURE, 0, np.where(share > 1 - _UNSURE, 1, share))
        levels = np.floor(255 * _enlarged(covered, size).clip(0, 1) + 0.5)
        # Less opaque than dark, a pixel would need a colour darker than black.
        levels = np.maximum(levels, 255 - large.min(axis=-1))[..., None]
        colour = np.full(large.shape, 255.0)
        np.divide(255 * (large + levels - 255), levels, out=colour, where=levels > 0)
        out[...] = np.concatenate([np.floor(colour + 0.5), levels], axis=-1)
    return rgba


def _enlarged(share: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Return an image [S, S] of one number as `resized` makes it, which may leave 0..1."""
    from PIL import Image

    if share.shape == (size, size):
        return share
    whole = Image.fromarray(share.astype(np.float32))
    return np.asarray(whole.resize((size, size), Image.Resampling.LANCZOS))


def guessed_coverage(images: UInt8Images) -> NDArray[np.float32]:
    """Return the coverage [F, S, S], 0 to 1, that images on white [F, S, S, 3] seem to have.

    White is background. Within _EDGE_PX of the background a pixel counts as covered by the share
    of its darkness in that of the object beside it. So thin and bright parts are taken for half
    transparent.
    """
    return np.array([_guessed(image) for image in images], np.float32).reshape(images.shape[:3])


def _guessed(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    darkness, around = 1 - image.min(axis=-1) / 255, 2 * _EDGE_PX + 1
    within = minimum_filter(darkness, around) >= _BACKGROUND
    # The object beside an edge is what is near of its inside; a thin part has none near by, and is
    # measured by its darkest pixel.
    share = uniform_filter(within.astype(float), 2 * around - 1)
    inside = uniform_filter(darkness * within, 2 * around - 1) / np.maximum(share, 1e-9)
    beside = np.where(share > 1e-9, inside, maximum_filter(darkness, around))
    edge = np.minimum(darkness / np.maximum(beside, _BACKGROUND), 1.0)
    return np.where(within, 1.0, np.where(darkness < _BACKGROUND, darkness, edge))


@dataclass(frozen=True, eq=False)
class Tile:
    """A label with the images [F, 128, 128, 3] of the frames, or with the reason of a failure."""

    label: str
    images: UInt8Images | str


def columns_of(count: int) -> int:
    """Return the tiles a row: at most _MOST_A_ROW, with rows as equally long as possible."""
    rows = -(-count // _MOST_A_ROW)
    return -(-count // max(rows, 1))


def draw_sheet(tiles: Sequence[Tile], columns: int, scale: int) -> UInt8Images:
    """Return frames uint8 [F, H, W, 3] of the tiles, row by row, each under its label.

    Images are enlarged `scale` times, every pixel becoming a square. A reason stands in place of
    the images, as far as it fits. A sheet without images has one frame. Raises ValueError where
    tiles have different numbers of frames.
    """
    from PIL import Image, ImageDraw

    side = scale * IMAGE_SIZE
    wide, high = side + MARGIN, side + LABEL_HEIGHT + MARGIN
    page = Image.new("RGB", (MARGIN + columns * wide, MARGIN + -(-len(tiles) // columns) * high))
    draw = ImageDraw.Draw(page)
    draw.rectangle((0, 0, *page.size), "white")
    corners = []  # column and row of the upper left pixel of each tile
    for i in range(len(tiles)):
        row, column = divmod(i, columns)
        corners.append((MARGIN + column * wide, MARGIN + row * high))
    for tile, (left, top) in zip(tiles, corners, strict=True):
        draw.text((left, top), shortened(tile.label, _LABEL_PX, side), INK, _font(_LABEL_PX))
        if isinstance(tile.images, str):
            low = top + LABEL_HEIGHT
            draw.rectangle((left, low, left + side - 1, low + side - 1), PROBLEM_GROUND)
            inner = side - 2 * MARGIN
            lines = wrapped(tile.images, PROBLEM_PX, inner)[: inner // PROBLEM_HEIGHT]
            for i, line in enumerate(lines):
                at = (left + MARGIN, low + MARGIN + i * PROBLEM_HEIGHT)
                draw.text(at, line, PROBLEM_INK, _font(PROBLEM_PX))
    counts = {len(tile.images) for tile in tiles if not isinstance(tile.images, str)}
    if len(counts) > 1:
        raise ValueError(f"tiles have {sorted(counts)} frames; give equally many")
    frames = np.repeat(np.asarray(page)[None], max(counts, default=1), axis=0)
    for tile, (left, top) in zip(tiles, corners, strict=True):
        if not isinstance(tile.images, str):
            low = top + LABEL_HEIGHT
            enlarged = tile.images.repeat(scale, axis=1).repeat(scale, axis=2)
            frames[:, low : low + side, left : left + side] = enlarged
    return frames


def shortened(text: str, size_px: int, width: float) -> str:
    """Return the text, or as much of its beginning and end as fits into `width` pixels."""
    font = _font(size_px)
    short, kept = text, len(text)
    while kept and font.getlength(short) > width:
        kept -= 1
        short = f"{text[: kept - kept // 2]}…{text[len(text) - kept // 2 :]}"
    return short


def wrapped(text: str, size_px: int, width: float) -> list[str]:
    """Return the text in lines that fit into `width` pixels; a longer word is shortened."""
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
