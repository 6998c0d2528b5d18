"""The objects that moved most against the golden values, side by side with how they were."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.checking.objects import GoldenDeviation, StoredImages, golden_thumbnails, number
from bench.checking.thumbnails import SIDE
from bench.records.journal import read_manifest
from bench.rendering.files import write_images
from bench.rendering.sheet import Tile, draw_sheet
from bench.tables.figure import FIGURES
from data_prep.failures import CannotWrite
from data_prep.scene import IMAGE_SIZE

MOVED = "moved.png"
MOST = 8  # objects
ACROSS = 4  # tiles: two objects in a row
SCALE = 2


def write_deviations(directory: Path, moved: Sequence[GoldenDeviation]) -> Path | None:
    """Draw the objects that moved most beside their golden thumbnails into a run's folder.

    The image is of the first view. Of an object with a method at a condition, the metric counts
    that moved most. Where nothing moved there is no file, and an old one is removed. Raises
    CannotWrite.
    """
    path = directory / FIGURES / MOVED
    worst: dict[object, GoldenDeviation] = {}
    for one in sorted(moved, key=lambda one: -one.excess):
        worst.setdefault(one.item, one)
    shown = list(worst.values())[:MOST]
    if not shown:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise CannotWrite(f"{path}: cannot be removed ({error.strerror}); remove it") from error
        return None
    stored = StoredImages(directory)
    thumbnails = golden_thumbnails(str(read_manifest(directory)["suite"]))
    tiles = []
    for one in shown:
        images = stored.images(one.item)
        method, condition, *obj = one.item
        drawn = "no image" if images is None else images[:1]
        tiles.append(Tile(f"{'/'.join(obj)}: {one.metric} {number(one.actual)}", drawn))
        before = f"golden {number(one.golden)}, {method}, {condition}"
        tiles.append(Tile(before, _enlarged(thumbnails[one.line])))
    write_images(draw_sheet(tiles, min(ACROSS, len(tiles)), SCALE), path)
    return path


def _enlarged(thumbnail: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """[1, IMAGE_SIZE, IMAGE_SIZE, 3]: each pixel a square."""
    times = IMAGE_SIZE // SIDE
    return thumbnail.repeat(times, axis=0).repeat(times, axis=1)[None]
