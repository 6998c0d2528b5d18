"""`bench render`: an image of a cloud, a sheet by several methods, or a turntable of either."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from bench.catalogue.methods import RECOMMENDED, find_method
from bench.commands.options import (
    DEVICE,
    Device,
    OptionSpec,
    WorkersOption,
    options_from_dataclass,
    path_argument,
    path_option,
    worker_count,
)
from bench.rendering.cloud import (
    CloudFile,
    Dots,
    Drawing,
    Failed,
    Notes,
    Wanted,
    draw_each,
    make_view,
)
from bench.rendering.files import MOVING, moves, write_images
from bench.rendering.sheet import Tile, columns_of, draw_sheet
from bench.running.environment import cores
from bench.tables.markdown import visible
from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.files.clouds import check_cloud_name
from data_prep.progress import progress
from data_prep.scene import UInt8Images, View

FRAMES = 36
MOST_FRAMES = 120  # steps of 3 degrees; a sheet of ten methods takes 300 MB
SHEET_SCALE = 2
CLOUD = "cloud"  # the label of the dots


@dataclass(frozen=True)
class RenderOptions:
    """The options of `bench render`.

    Attributes
    ----------
    method : tuple of str
        Methods; several make a sheet.
    out : Path or None
        An image, or a turntable by its name; None: beside the cloud, with its name and .png.
    azimuth, elevation : float
        Degrees.
    frames : int or None
        Images of a turntable, which begins at the azimuth and goes all around; None: FRAMES.
    up, front, points, drop_invalid, as_is
        See `bench.rendering.cloud.CloudFile`.
    """

    method: tuple[str, ...] = (RECOMMENDED,)
    out: Path | None = None
    azimuth: float = 30.0
    elevation: float = 20.0
    frames: int | None = None
    up: str = "y"
    front: str | None = None
    points: int | None = None
    drop_invalid: bool = False
    device: str = "auto"
    as_is: bool = False


@dataclass(frozen=True)
class RenderResult:
    """The result of `bench render`.

    Attributes
    ----------
    path : Path
        The image; it was not written where all methods failed.
    failed : mapping
        The reason of each method that failed.
    notes : tuple of str
        A line for each part of the file that is not used, and for methods that know chairs only.
    """

    path: Path
    failed: Mapping[str, str]
    notes: Notes


def render(cloud: Path, options: RenderOptions) -> RenderResult:
    """Draw a cloud and write the image, unless all methods fail.

    One method gives its images as they are. Several give a sheet: the points as dots, then a
    tile for each method, with the reason in it where there is no image. Raises BadInput for options
    and files that cannot be used; before a worker is started where the options alone show it.
    """
    # The cloud's name is checked before it becomes that of the image.
    if cloud.is_dir():
        raise BadInput(f"{cloud}: a folder; give a file")
    check_cloud_name(cloud)
    if not cloud.exists():
        raise BadInput(f"{cloud}: no such file; check its name")
    out = options.out or cloud.with_suffix(".png")
    if options.out is None and out.exists():
        raise BadInput(f"{out}: exists already; -o {out} replaces it, -o NAME keeps both")
    check(options, out)
    views = views_of(options, out)
    methods = tuple(dict.fromkeys(options.method))
    drawings = [Drawing(method, views, options.device) for method in methods]
    dots = [Dots(views)] if len(drawings) > 1 else []
    file = CloudFile(
        cloud, options.as_is, options.up, options.front, options.points, options.drop_invalid
    )
    drawn, notes = _draw(file, [*dots, *drawings])
    failed = {
        drawing.method: with_remedy(images, file)
        for drawing, images in drawn.items()
        if isinstance(drawing, Drawing) and isinstance(images, Failed)
    }
    if len(failed) < len(drawings):
        write_images(_frames(drawn), out)
    chairs = [name for name in methods if find_method(name).trained_on == "chairs"]
    if chairs:
        notes += (
            f"{', '.join(chairs)}: trained on chairs, other objects may look like them; "
            f"{RECOMMENDED} knows {find_method(RECOMMENDED).trained_on}",
        )
    return RenderResult(out, failed, notes)


def with_remedy(failed: Failed, file: CloudFile) -> str:
    """Return the reason, and the remedy where points may be too many."""
    over_limit = failed.reason.startswith(("timeout: ", "memory: "))
    remedy = "; --points 20000 would take less" if over_limit and not file.most else ""
    return failed.reason + remedy


def check(options: RenderOptions, out: Path) -> None:
    """Raise BadInput for options that are wrong whatever the file holds and the methods do."""
    is_turntable = moves(out)  # raises BadInput for the name of another kind of file
    if options.frames is not None and not is_turntable:
        raise BadInput(
            f"--frames {options.frames}: {out} is one image; give a turntable's name, "
            f"{' or '.join(MOVING)}"
        )
    if options.frames is not None and not 2 <= options.frames <= MOST_FRAMES:
        raise BadInput(f"--frames {options.frames}: must be 2 to {MOST_FRAMES}")
    if options.points is not None and options.points < 1:
        raise BadInput(f"--points {options.points}: must be at least 1")
    upright(np.empty((0, 3)), options.up, options.front)
    if out.is_dir():
        raise BadInput(f"{out}: a folder; give another -o")
    if not out.parent.is_dir():
        raise BadInput(f"{out}: no such folder, {out.parent}; make it, or give another -o")


def views_of(options: RenderOptions, out: Path) -> tuple[View, ...]:
    """Return the view, or all of a turntable. Raises BadInput for an angle out of its range."""
    first = make_view(options.azimuth, options.elevation)
    if not moves(out):
        return (first,)
    frames = options.frames or FRAMES
    return tuple(
        View(first.azimuth_deg + 360 * i / frames, first.elevation_deg) for i in range(frames)
    )


def _draw(
    file: CloudFile, wanted: Sequence[Wanted]
) -> tuple[dict[Wanted, UInt8Images | Failed], Notes]:
    """Return all images in the order of `wanted`, and the notes on the file."""
    quick = len(wanted) == 1 and len(wanted[0].views) == 1  # over before a progress is read
    done: dict[Wanted, UInt8Images | Failed] = {}
    notes: dict[str, None] = {}  # each worker reads the file, and has the same notes
    with nullcontext() if quick else progress("drawing", len(wanted)) as advance:
        for drawing, images, of_file in draw_each(file, wanted, min(len(wanted), cores())):
            done[drawing] = images
            notes |= dict.fromkeys(of_file)
            if advance is not None:
                advance(sum(isinstance(images, Failed) for images in done.values()))
    return {drawing: done[drawing] for drawing in wanted}, tuple(notes)


def _frames(drawn: Mapping[Wanted, UInt8Images | Failed]) -> UInt8Images:
    """Return the images to write: those of the only method, or a sheet."""
    if len(drawn) == 1:
        (images,) = drawn.values()
        assert not isinstance(images, Failed)
        return images
    tiles = [
        Tile(
            visible(drawing.method) if isinstance(drawing, Drawing) else CLOUD,
            visible(images.reason) if isinstance(images, Failed) else images,
        )
        for drawing, images in drawn.items()
    ]
    return draw_sheet(tiles, columns_of(len(tiles)), SHEET_SCALE)


RENDER_OPTIONS: dict[str, str | OptionSpec] = {
    "method": OptionSpec(
        "Method, see 'bench list'; several, comma-separated, make a sheet.", default=RECOMMENDED
    ),
    "out": OptionSpec(
        "Image file, .png; or a turntable, .gif, .webp, .apng. Default: beside the cloud, with its "
        "name and .png.",
        flag="--out -o",
    ),
    "azimuth": "Azimuth in degrees; 0 is the front.",
    "elevation": "Elevation in degrees, -90 to 90; 0 is level.",
    "frames": "Images of a turntable, from the azimuth all around. Default: 36.",
    "up": "Axis of the file that points up, -x to z; z for most scans.",
    "front": "Axis of the file to the front. Default: -z, or -y where z is up.",
    "points": "Points at most, chosen at random. Default: all.",
    "drop_invalid": "Leave out points that are not finite, and print how many. Default: refuse "
    "them.",
    "device": OptionSpec(DEVICE, kind=Device),
    "as_is": "Keep scale and place. Default: move the cloud into the unit sphere.",
}


@options_from_dataclass(RenderOptions, RENDER_OPTIONS)
def render_cloud(
    options: RenderOptions,
    cloud: Annotated[
        Path, path_argument("CLOUD", "File: PLY, NPY, XYZ, TXT, CSV, PTS, LAS, LAZ, E57 or PCD.")
    ],
) -> None:
    """Draw the point cloud of a file. Exit 1 if the method fails; of several, if all fail.

    Each method gets all points, 120 seconds and 4 GiB of memory. pc2pix uses at most 8 x 1,024
    points. Surface reconstruction of 100,000 points takes about half a minute, surface-fit less;
    --points takes fewer.
    """
    result = render(cloud, options)
    for note in result.notes:
        print(f"note: {visible(note)}", file=sys.stderr)
    for name, reason in result.failed.items():
        print(f"bench: {visible(f'{name}: {reason}')}", file=sys.stderr)
    if len(result.failed) == len(set(options.method)):
        raise typer.Exit(1)
    if options.out is None or options.method == (RECOMMENDED,):
        methods = visible(", ".join(options.method))
        print(f"drawn by {methods}; 'bench list' has others", file=sys.stderr)
    print(result.path)


def shrink_record(
    record: Annotated[
        str,
        typer.Argument(
            metavar="RECORD",
            help="DIR:METHOD/CONDITION/CLASS/OBJECT; of the suite stability DIR:METHOD/CASE. "
            "DIR alone lists some that failed.",
        ),
    ],
    budget_s: Annotated[
        float, typer.Option(help="Seconds after which the smallest cloud so far is kept.")
    ] = 600.0,
    workers: WorkersOption = None,
    out: Annotated[
        Path | None, path_option("Folder. Default: DIR/shrunk/RECORD.", "--out", "-o")
    ] = None,
) -> None:
    """Find the smallest cloud that still makes a method fail. Exit 1 if it does not fail here."""
    from bench.rendering import shrink as shrinking

    result = shrinking.shrink(record, budget_s, worker_count(workers) or cores(), out)
    if isinstance(result, shrinking.NotReproduced):
        print(f"bench: {result.message}", file=sys.stderr)
        raise typer.Exit(1)
    print(result.message)
