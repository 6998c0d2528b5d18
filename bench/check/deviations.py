"""The sheet of the objects whose images have moved most from the golden ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.check.golden_values import golden_name
from bench.check.objects import GoldenDeviation, golden_thumbnails, stored_images
from bench.check.objects import number as rounded
from bench.check.thumbnails import SIDE
from bench.draw.files import write_images
from bench.draw.finish import Tile, draw_sheet
from bench.records.folder import read_manifest
from bench.records.frames import stored_artifacts
from bench.report.plots import FIGURES
from data_prep.failures import CannotWrite
from data_prep.scene import IMAGE_SIZE

_MOST_MOVED = 8  # objects shown in the sheet of those that moved most: as many as fit on a screen
_TILES_IN_A_ROW = 4  # in that sheet; an object takes two tiles, so that a row shows two objects


def moved_path(directory: Path) -> Path:
    """Return the path of the sheet in the folder of a run."""
    return directory / FIGURES / "moved.png"


def write_deviations(directory: Path, moved: Sequence[GoldenDeviation], ours: bool) -> Path | None:
    """Draw the objects that moved most, and return the path of the sheet; None without any.

    Each object has two tiles: its image from the first view, labelled with the metric that moved
    most, and beside it the golden thumbnail. Golden values that are not `ours` have no thumbnails;
    the true image stands in their place. Where no object moved, an older sheet is removed.
    Raises CannotWrite.
    """
    path = moved_path(directory)
    worst: dict[object, GoldenDeviation] = {}
    for deviation in sorted(moved, key=lambda deviation: -deviation.excess):
        worst.setdefault(deviation.item, deviation)
    if not worst:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise CannotWrite(
                f"{path}: shows an earlier check and cannot be removed ({error.strerror}); "
                "remove it yourself"
            ) from error
        return None
    stored = stored_artifacts(directory)
    thumbnails = golden_thumbnails(golden_name(read_manifest(directory))) if ours else None
    tiles, enlargement = [], IMAGE_SIZE // SIDE
    for deviation in list(worst.values())[:_MOST_MOVED]:
        images = stored_images(stored, deviation.item)
        method, condition, *obj = deviation.item
        drawn = "no image" if images is None else images[:1]
        now, was = rounded(deviation.actual), f"golden {rounded(deviation.golden)}"
        moved_to, drawn_by = f"{deviation.metric} {now}", f"{method}, {condition}"
        if thumbnails is not None:
            thumbnail = thumbnails[[deviation.line]]
            thumbnail = thumbnail.repeat(enlargement, axis=1).repeat(enlargement, axis=2)
            tiles.append(Tile(f"{'/'.join(obj)}: {moved_to}", drawn))
            tiles.append(Tile(f"{was}, {drawn_by}", thumbnail))
        else:
            truth = stored_images(stored, deviation.item.truth)
            tiles.append(Tile(f"{'/'.join(obj)}, {drawn_by}", drawn))
            shown = "no true image" if truth is None else truth[:1]
            tiles.append(Tile(f"truth; {moved_to}, {was}", shown))
    write_images(draw_sheet(tiles, min(_TILES_IN_A_ROW, len(tiles)), scale=2), path)
    return path
