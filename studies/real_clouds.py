"""What every method makes of real scans: a sheet to look at, and why methods fail.

    python -m studies.real_clouds FOLDER [-o docs/real-clouds.png] [--methods a,b]
                                     [--view=30,20 --view=-150,20] [--up y] [--front=-z]

FOLDER is searched for clouds, sub-folders included. A row of the sheet is a cloud from one view:
its points, then each method; without --methods all that draw a bare cloud and look at it, those of
other installed packages included. Nothing is scored, for there is no truth. Failures are printed
and stand in the sheet.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.catalogue.methods import FLOORS, METHODS, plugin_ids
from bench.rendering.cloud import CloudFile, Dots, Drawing, Failed, draw_each
from bench.rendering.files import write_pictures
from bench.rendering.sheet import Tile, draw_sheet
from bench.running.environment import cores
from bench.running.work import Pictures
from bench.tables.markdown import visible
from data_prep.cloud_files import CLOUD_SUFFIXES
from data_prep.failures import BadInput
from data_prep.scene import View

VIEWS = (View(30.0, 20.0), View(-150.0, 20.0))


def main() -> None:
    """Draw and write the sheet."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    options.add_argument("-o", "--out", type=Path, default=Path("docs/real-clouds.png"))
    options.add_argument("--methods", help="comma-separated")
    options.add_argument(
        "--view", action="append", type=parse_view, help="azimuth,elevation in degrees; repeatable"
    )
    options.add_argument("--up", default="y", help="axis of the files that points up")
    options.add_argument("--front", help="axis of the files to the front")
    given = options.parse_args()
    methods = given.methods.split(",") if given.methods else drawers()
    try:
        views = tuple(given.view or VIEWS)
        rows: list[Tile] = []
        for path in cloud_files(given.folder):
            rows += rows_of(CloudFile(path, False, given.up, given.front), methods, views)
        write_pictures(draw_sheet(rows, len(methods) + 1, 1), given.out)
    except BadInput as error:
        sys.exit(f"real_clouds: {error}")
    print(given.out)


def parse_view(text: str) -> View:
    """The view of AZIMUTH,ELEVATION. Raises ValueError for anything else."""
    azimuth, elevation = map(float, text.split(","))
    return View(azimuth, elevation)


def drawers() -> list[str]:
    """All methods that draw a bare cloud, and look at it."""
    ours = [method.id for method in METHODS if not method.sees_mesh and method.id not in FLOORS]
    return [*ours, *plugin_ids()]


def cloud_files(folder: Path) -> list[Path]:
    """All of a folder, by name. Raises BadInput where there is none."""
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in CLOUD_SUFFIXES)
    if not found:
        raise BadInput(f"{folder}: no point cloud there; give a folder that has some")
    return found


def rows_of(file: CloudFile, methods: Sequence[str], views: tuple[View, ...]) -> Iterator[Tile]:
    """Tiles of a cloud: a row for each view."""
    wanted = [Dots(views), *(Drawing(method, views) for method in methods)]
    drawn = dict(draw_each(file, wanted, cores()))
    for one, pictures in drawn.items():
        if isinstance(pictures, Failed) and isinstance(one, Drawing):
            print(f"{file.path.stem}: {one.method}: {visible(pictures.reason)}")
    for i, view in enumerate(views):
        for one in wanted:
            label = (
                one.method
                if isinstance(one, Drawing)
                else f"{view.azimuth_deg:g}°, {file.path.stem}"
            )
            yield Tile(visible(label), _frame(drawn[one], i))


def _frame(pictures: Pictures | Failed, i: int) -> Pictures | str:
    """One view of the pictures, or why there are none."""
    return visible(pictures.reason) if isinstance(pictures, Failed) else pictures[i : i + 1]


if __name__ == "__main__":
    main()
