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

_BACKGROUND = 8 / 255  # less dark is background: networks draw it a little off white
_EDGE_PX = 2  # the smoothed edges of networks; those of meshes take one
MARGIN = 6
LABEL_HEIGHT = 18
_LABEL_PX = 13
PROBLEM_PX, PROBLEM_HEIGHT = 11, 14  # a line's
INK, PROBLEM_INK, PROBLEM_GROUND = (40, 40, 40), (150, 30, 30), (250, 243, 240)
_MOST_A_ROW = 5


def resized(images: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return images [F, H, W, 3] as [F, size, size, 3], by Lanczos' filter."""
    if images.shape[1:3] == (size, size):
        return images
    from PIL import Image

    lanczos = Image.Resampling.LANCZOS
    return np.stack(
        [np.asarray(Image.fromarray(image).resize((size, size), lanczos)) for image in images]
    )


def without_background(images: UInt8Images, size: int) -> NDArray[np.uint8]:
    """Return images on white, [F, S, S, 3], as RGBA [F, size, size, 4] that are the same on white.

    White is transparent, the object opaque. Within _EDGE_PX of the background a pixel is as opaque
    as it is dark, compared with the object beside it. Its colour is the one that on white gives
    the pixel of the opaque image (of `resized`) again, within a grey level.
    """
    from PIL import Image

    large = resized(images, size)
    opacity = np.stack([_opacity(image) for image in images]).astype(np.float32)
    if opacity.shape[1:] != large.shape[1:3]:
        lanczos = Image.Resampling.LANCZOS
        enlarged = [Image.fromarray(o).resize((size, size), lanczos) for o in opacity]
        opacity = np.stack([np.asarray(o) for o in enlarged])
    # Less opaque than dark, a pixel would need a colour darker than black.
    opacity = np.clip(opacity, _darkness(large), 1.0)
    steps = np.ceil(opacity * 255 - 1e-3)[..., None]  # up, for the same reason
    alpha = steps / 255
    colour = np.full(large.shape, 255.0)
    np.divide(large - 255 * (1 - alpha), alpha, out=colour, where=alpha > 0)
    rgb = np.floor(np.clip(colour, 0, 255) + 0.5)
    return np.concatenate([rgb, steps], axis=3).astype(np.uint8)


def _darkness(images: NDArray[np.uint8]) -> NDArray[np.float64]:
    return 1 - images.min(axis=-1) / 255


def _opacity(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    darkness, around = _darkness(image), 2 * _EDGE_PX + 1
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
    places = [
        (MARGIN + i % columns * wide, MARGIN + i // columns * high) for i in range(len(tiles))
    ]
    for tile, (left, top) in zip(tiles, places, strict=True):
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
    for tile, (left, top) in zip(tiles, places, strict=True):
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
