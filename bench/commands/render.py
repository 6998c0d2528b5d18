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
from bench.commands.options import Device, DeviceOption, WorkersOption, names, worker_count
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
class Request:
    """What is to be drawn by which methods, seen from where.

    out     an image, or a turntable by its name
    frames  of a turntable, which begins at the azimuth and goes all around; None: FRAMES
    """

    file: CloudFile
    methods: tuple[str, ...]
    azimuth_deg: float
    elevation_deg: float
    out: Path
    frames: int | None = None
    device: str = "auto"


@dataclass(frozen=True)
class Outcome:
    """The reasons of the methods that failed, and what the user should know of the others.

    failed  the reason of each method that failed
    notes   a line each: what of the file is not used, which methods know chairs only
    """

    failed: Mapping[str, str]
    notes: Notes


def render(request: Request) -> Outcome:
    """Draw what is requested and write it, unless all methods fail.

    One method gives its images as they are. Several give a sheet: the points as dots, then a
    tile for each method, with the reason in it where there is no image. Raises BadInput for what
    cannot be had; where the request alone shows it, before a worker is started.
    """
    check(request)
    views = views_of(request)
    drawings = [Drawing(method, views, request.device) for method in dict.fromkeys(request.methods)]
    dots = [Dots(views)] if len(drawings) > 1 else []
    drawn, notes = _drawn(request.file, [*dots, *drawings])
    failed = {
        one.method: remedied(images, request.file)
        for one, images in drawn.items()
        if isinstance(one, Drawing) and isinstance(images, Failed)
    }
    if len(failed) < len(drawings):
        write_images(_frames(drawn), request.out)
    return Outcome(failed, (*notes, *_of_chairs_only(request.methods)))


def _of_chairs_only(methods: Sequence[str]) -> Notes:
    """Return a line that names the methods that were trained on chairs; nothing without such."""
    chairs = [name for name in dict.fromkeys(methods) if find_method(name).trained_on == "chairs"]
    if not chairs:
        return ()
    return (
        f"{', '.join(chairs)}: trained on chairs, other objects may look like them; {RECOMMENDED} "
        f"knows {find_method(RECOMMENDED).trained_on}",
    )


def remedied(failed: Failed, file: CloudFile) -> str:
    """Return the reason, and the remedy where points may be too many."""
    timing = failed.reason.startswith(("timeout: ", "memory: "))
    return (
        f"{failed.reason}{'; --points 20000 would take less' if timing and not file.most else ''}"
    )


def check(request: Request) -> None:
    """Raise BadInput for what is wrong whatever the file holds and the methods do."""
    turns = moves(request.out)
    if request.frames is not None and not turns:
        raise BadInput(
            f"--frames {request.frames}: {request.out} is one picture; give a turntable's name, "
            f"{' or '.join(MOVING)}"
        )
    if request.frames is not None and not 2 <= request.frames <= MOST_FRAMES:
        raise BadInput(f"--frames {request.frames}: must be 2 to {MOST_FRAMES}")
    if request.file.most is not None and request.file.most < 1:
        raise BadInput(f"--points {request.file.most}: must be at least 1")
    upright(np.empty((0, 3)), request.file.up, request.file.front)
    if request.out.is_dir():
        raise BadInput(f"{request.out}: a folder; give another -o")
    if not request.out.parent.is_dir():
        raise BadInput(
            f"{request.out}: no such folder, {request.out.parent}; make it, or give another -o"
        )


def views_of(request: Request) -> tuple[View, ...]:
    """Return the view, or all of a turntable. Raises BadInput for an angle out of its range."""
    first = make_view(request.azimuth_deg, request.elevation_deg)
    if not moves(request.out):
        return (first,)
    frames = request.frames or FRAMES
    return tuple(
        View(first.azimuth_deg + 360 * i / frames, first.elevation_deg) for i in range(frames)
    )


def _drawn(
    file: CloudFile, wanted: Sequence[Wanted]
) -> tuple[dict[Wanted, UInt8Images | Failed], Notes]:
    """Return all images in the order in which they were wanted, and the notes on the file.

    Progress is shown where there is time for some.
    """
    quick = len(wanted) == 1 and len(wanted[0].views) == 1
    done: dict[Wanted, UInt8Images | Failed] = {}
    notes: dict[str, None] = {}  # each worker reads the file, and has the same notes
    with nullcontext() if quick else progress("drawing", len(wanted)) as advance:
        for one, images, of_file in draw_each(file, wanted, min(len(wanted), cores())):
            done[one] = images
            notes |= dict.fromkeys(of_file)
            if advance is not None:
                advance(sum(isinstance(images, Failed) for images in done.values()))
    return {one: done[one] for one in wanted}, tuple(notes)


def _frames(drawn: Mapping[Wanted, UInt8Images | Failed]) -> UInt8Images:
    """Return what is written: the images of the only method, or a sheet."""
    if len(drawn) == 1:
        (images,) = drawn.values()
        assert not isinstance(images, Failed)
        return images
    tiles = [
        Tile(
            visible(one.method) if isinstance(one, Drawing) else CLOUD,
            visible(shown.reason) if isinstance(shown, Failed) else shown,
        )
        for one, shown in drawn.items()
    ]
    return draw_sheet(tiles, columns_of(len(tiles)), SHEET_SCALE)


def render_cloud(
    cloud: Annotated[
        Path,
        typer.Argument(
            metavar="CLOUD", help="File: PLY, NPY, XYZ, TXT, CSV, PTS, LAS, LAZ, E57 or PCD."
        ),
    ],
    method: Annotated[
        str, typer.Option(help="Method, see 'bench list'; several, comma-separated, make a sheet.")
    ] = RECOMMENDED,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Image file, .png; or a turntable, .gif, .webp, .apng. Default: beside the cloud, "
            "with its name and .png.",
        ),
    ] = None,
    azimuth: Annotated[float, typer.Option(help="Azimuth in degrees; 0 is the front.")] = 30.0,
    elevation: Annotated[
        float, typer.Option(help="Elevation in degrees, -90 to 90; 0 is level.")
    ] = 20.0,
    frames: Annotated[
        int | None,
        typer.Option(help="Images of a turntable, from the azimuth all around. Default: 36."),
    ] = None,
    up: Annotated[
        str, typer.Option(help="Axis of the file that points up, -x to z; z for most scans.")
    ] = "y",
    front: Annotated[
        str | None,
        typer.Option(help="Axis of the file to the front. Default: -z, or -y where z is up."),
    ] = None,
    points: Annotated[
        int | None, typer.Option(help="Points at most, chosen at random. Default: all.")
    ] = None,
    drop_invalid: Annotated[
        bool,
        typer.Option(
            "--drop-invalid",
            help="Leave out points that are not finite, and print how many. Default: refuse them.",
        ),
    ] = False,
    device: DeviceOption = Device.auto,
    as_is: Annotated[
        bool,
        typer.Option(
            "--as-is", help="Keep scale and place. Default: move the cloud into the unit sphere."
        ),
    ] = False,
) -> None:
    """Draw the point cloud of a file. Exit 1 if the method fails; of several, if all fail.

    Each method gets all points, 120 seconds and 4 GiB of memory. pc2pix uses at most 8 x 1,024
    points. Surface reconstruction of 100,000 points takes about half a minute, surface-fit less;
    --points takes fewer.
    """
    methods = names(method) or ()
    _check_cloud(cloud)  # before its name becomes that of the image
    file = CloudFile(cloud, as_is, up, front, points, drop_invalid)
    target = out or _beside(cloud)
    outcome = render(Request(file, methods, azimuth, elevation, target, frames, device.value))
    for note in outcome.notes:
        print(f"note: {visible(note)}", file=sys.stderr)
    for name, reason in outcome.failed.items():
        print(f"bench: {visible(f'{name}: {reason}')}", file=sys.stderr)
    if len(outcome.failed) == len(set(methods)):
        raise typer.Exit(1)
    if out is None or method == RECOMMENDED:
        print(f"drawn by {visible(', '.join(methods))}; 'bench list' has others", file=sys.stderr)
    print(target)


def _check_cloud(path: Path) -> None:
    """Raise BadInput for a folder, a name of another format, and where nothing is."""
    if path.is_dir():
        raise BadInput(f"{path}: a folder; give a file")
    check_cloud_name(path)
    if not path.exists():
        raise BadInput(f"{path}: no such file; check its name")


def _beside(cloud: Path) -> Path:
    """Return the image's name where none is given. Raises BadInput rather than replace a file."""
    image = cloud.with_suffix(".png")
    if image.exists():
        raise BadInput(f"{image}: exists already; -o {image} replaces it, -o NAME keeps both")
    return image


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
        Path | None, typer.Option("--out", "-o", help="Folder. Default: DIR/shrunk/RECORD.")
    ] = None,
) -> None:
    """Reduce the cloud of a failed record to the points that make it fail. Exit 1 if it does not
    fail here."""
    from bench.rendering import shrink as shrinking
    from bench.running.environment import cores

    found = shrinking.shrink(record, budget_s, worker_count(workers) or cores(), out)
    if isinstance(found, shrinking.NotReproduced):
        print(f"bench: {found.message}", file=sys.stderr)
        raise typer.Exit(1)
    print(found.message)
