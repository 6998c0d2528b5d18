"""The sheet of the objects that moved most, each beside its golden thumbnail."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.checking.objects import GoldenDeviation, StoredImages, golden_thumbnails, number
from bench.checking.thumbnails import SIDE
from bench.records.run_folder import read_manifest
from bench.rendering.files import write_images
from bench.rendering.sheet import Tile, draw_sheet
from bench.report.figure import FIGURES
from bench.tables.published import golden_name
from data_prep.failures import CannotWrite
from data_prep.scene import IMAGE_SIZE

MOVED = "moved.png"
MOST = 8  # objects
ACROSS = 4  # tiles: two objects in a row
SCALE = 2


def write_deviations(directory: Path, moved: Sequence[GoldenDeviation]) -> Path | None:
    """Draw the objects that moved most beside their golden thumbnails into a run's folder.

    The image is of the first view. Among the metrics of an object with a method at a condition, the
    one that moved most counts. Without any object an old file is removed. Raises CannotWrite.
    """
    path = directory / FIGURES / MOVED
    worst: dict[object, GoldenDeviation] = {}
    for deviation in sorted(moved, key=lambda deviation: -deviation.excess):
        worst.setdefault(deviation.item, deviation)
    shown = list(worst.values())[:MOST]
    if not shown:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise CannotWrite(f"{path}: cannot be removed ({error.strerror}); remove it") from error
        return None
    stored = StoredImages(directory)
    thumbnails = golden_thumbnails(golden_name(read_manifest(directory)))
    tiles = []
    times = IMAGE_SIZE // SIDE
    for deviation in shown:
        images = stored.images(deviation.item)
        method, condition, *obj = deviation.item
        drawn = "no image" if images is None else images[:1]
        value = f"{deviation.metric} {number(deviation.actual)}"
        tiles.append(Tile(f"{'/'.join(obj)}: {value}", drawn))
        before = f"golden {number(deviation.golden)}, {method}, {condition}"
        thumbnail = thumbnails[deviation.line].repeat(times, axis=0).repeat(times, axis=1)
        tiles.append(Tile(before, thumbnail[None]))
    write_images(draw_sheet(tiles, min(ACROSS, len(tiles)), SCALE), path)
    return path
