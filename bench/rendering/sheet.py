"""Labelled images side by side, still or moving. Pure: arrays to arrays."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from data_prep.scene import IMAGE_SIZE, UInt8Images

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

MARGIN = 6
LABEL_HEIGHT = 18
_LABEL_PX = 13
PROBLEM_PX, PROBLEM_HEIGHT = 11, 14  # a line's
INK, PROBLEM_INK, PROBLEM_GROUND = (40, 40, 40), (150, 30, 30), (250, 243, 240)
_MOST_A_ROW = 5


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
