"""`bench render`: images of clouds, sheets by several methods, or a turntable of either."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import fields
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from bench.catalogue.method import allow_modules
from bench.commands.options import OptionSpec, options_from_dataclass, path_argument
from bench.rendering.cloud import (
    CloudFile,
    Dots,
    Drawing,
    Drawn,
    Failed,
    Notes,
    Wanted,
    draw_each,
)
from bench.rendering.files import files_of_views, image_of_cloud, images_of_clouds, write_images
from bench.rendering.finish import Tile, columns_of, draw_sheet
from bench.rendering.request import RenderOptions, check, cloud_file, notes_on, views_of
from bench.running.environment import cores
from bench.tables.markdown import visible
from data_prep.failures import BadInput
from data_prep.progress import progress

_SHEET_SCALE = 2
CLOUD = "cloud"  # the label of the dots


class _RenderResult(NamedTuple):
    """The result of `bench render`.

    images         that were written
    drawn          number of clouds that have images
    failed         a line for each cloud that cannot be used, and for each method that failed
    without_image  number of clouds that are not usable, or whose methods all failed
    notes          lines on parts of files that are not used, and on what the methods did
    """

    images: tuple[Path, ...]
    drawn: int
    failed: tuple[str, ...]
    without_image: int
    notes: Notes


def render(clouds: Sequence[Path], options: RenderOptions) -> _RenderResult:
    """Draw clouds and write an image of each, unless all methods fail.

    One method gives its images as they are. Several give a sheet: the points as dots, then a
    tile for each method, with the reason in it where there is no image. Of several angles each has
    an image of its own. Raises BadInput for options
    and names that cannot be used, before a worker is started, and for the file of a cloud alone;
    of several clouds a file that cannot be used is among the failed.
    """
    left_out: Notes = ()
    alone = len(clouds) == 1 and not clouds[0].is_dir()
    if alone:
        images = {clouds[0]: image_of_cloud(clouds[0], options.out, options.format)}
    elif options.out is None:
        kind = "a folder" if clouds[0].is_dir() else "one of several clouds"
        raise BadInput(f"{clouds[0]}: {kind}; give a folder for the images, -o FOLDER")
    else:
        images, left_out = images_of_clouds(clouds, options.out, options.format)
    any_image = next(iter(images.values()))
    check(options, any_image)
    views = views_of(options, any_image)
    shots = {cloud: files_of_views(image, options.views) for cloud, image in images.items()}
    for image in shots[clouds[0]] if options.out is None else ():
        if image.exists():
            raise BadInput(
                f"{image}: exists already; -o {any_image} replaces it, -o NAME keeps both"
            )
    size, background = options.size, options.background
    drawings = [
        Drawing(method, views, options.device, size=size, background=background)
        for method in options.methods
    ]
    wanted = [*([Dots(views)] if len(drawings) > 1 else []), *drawings]
    files = {cloud: cloud_file(cloud, options) for cloud in images}
    failed: dict[Path, list[str]] = {}
    notes: dict[Path, Notes] = {}
    written = set()
    for file, drawn, of_file in _draw_all(tuple(files.values()), wanted):
        cloud = file.path
        unusable = next((d for d in drawn.values() if isinstance(d, BadInput)), None)
        if alone and unusable is not None:
            raise unusable
        notes[cloud] = of_file
        failed[cloud] = [str(unusable)] if unusable else _failures(file, drawn, named=not alone)
        if unusable is None and len(failed[cloud]) < len(drawings):
            frames, shot = _finished(drawn), shots[cloud]
            for i, image in enumerate(shot):
                write_images(frames if len(shot) == 1 else frames[i : i + 1], image)
            written.add(cloud)
    return _RenderResult(
        tuple(image for cloud, shot in shots.items() if cloud in written for image in shot),
        len(written),
        tuple(line for cloud in images for line in failed[cloud]),
        len(images) - len(written),
        left_out + _joined({cloud: notes[cloud] for cloud in images}) + notes_on(options),
    )


def with_remedy(failed: Failed, file: CloudFile) -> str:
    """Return the reason, and the remedy where points may be too many."""
    over_limit = failed.reason.startswith(("timeout: ", "memory: "))
    remedy = "; --points 20000 would take less" if over_limit and not file.most else ""
    return failed.reason + remedy


def _failures(file: CloudFile, drawn: Mapping[Wanted, Drawn], named: bool) -> list[str]:
    """Return a line for each method that failed, with the name of the file if `named`."""
    return [
        f"{file.path}: " * named + f"{drawing.method}: {with_remedy(images, file)}"
        for drawing, images in drawn.items()
        if isinstance(drawing, Drawing) and isinstance(images, Failed)
    ]


def _joined(notes: Mapping[Path, Notes]) -> Notes:
    """Return all notes; one line for a note that several files share."""
    clouds: dict[str, list[Path]] = {}
    for cloud, lines in notes.items():
        for line in lines:
            clouds.setdefault(line.removeprefix(f"{cloud}: "), []).append(cloud)
    return tuple(
        f"{first} and {len(others)} more: {text}" if others else f"{first}: {text}"
        for text, (first, *others) in clouds.items()
    )


def _draw_all(
    files: Sequence[CloudFile], wanted: Sequence[Wanted]
) -> Iterator[tuple[CloudFile, dict[Wanted, Drawn], Notes]]:
    """Yield each file with all images in the order of `wanted`, and the notes on it.

    The images of few files are held at a time.
    """
    tasks = len(files) * len(wanted)
    quick = tasks == 1 and len(wanted[0].views) == 1  # over before a progress is read
    under_way: dict[CloudFile, dict[Wanted, Drawn]] = {}
    notes: dict[CloudFile, dict[Wanted, Notes]] = {}
    failures = 0
    with nullcontext() if quick else progress("drawing", tasks) as advance:
        for file, request, images, of_drawing in draw_each(files, wanted, min(tasks, cores())):
            drawn = under_way.setdefault(file, {})
            drawn[request] = images
            notes.setdefault(file, {})[request] = of_drawing
            failures += isinstance(images, Failed | BadInput)
            if advance is not None:
                advance(failures)
            if len(drawn) == len(wanted):
                del under_way[file]
                of_requests = notes.pop(file)
                # Each worker reads the file, and has the same notes on it.
                lines = (line for request in wanted for line in of_requests[request])
                in_order = {request: drawn[request] for request in wanted}
                yield file, in_order, tuple(dict.fromkeys(lines))


def _finished(drawn: Mapping[Wanted, Drawn]) -> NDArray[np.uint8]:
    """Return the images to write: those of the only method, or a sheet."""
    if len(drawn) == 1:
        (images,) = drawn.values()
        assert isinstance(images, np.ndarray)
        return images
    tiles = []
    for drawing, images in drawn.items():
        assert not isinstance(images, BadInput)
        label = visible(drawing.method) if isinstance(drawing, Drawing) else CLOUD
        tiles.append(Tile(label, visible(images.reason) if isinstance(images, Failed) else images))
    return draw_sheet(tiles, columns_of(len(tiles)), _SHEET_SCALE)


@options_from_dataclass(
    RenderOptions, {option.name: OptionSpec(**option.metadata) for option in fields(RenderOptions)}
)
def render_clouds(
    options: RenderOptions,
    clouds: Annotated[
        list[Path],
        path_argument(
            "CLOUD",
            "Files, or folders of them: PLY, NPY, XYZ, TXT, CSV, ASC, PTS, LAS, LAZ, E57, PCD.",
        ),
    ],
) -> None:
    """Draw the point clouds of files. Exit 1 if a cloud has no image: all its methods failed.

    Each method gets 120 seconds, 4 GiB of memory and all points, of a scan at most 2,097,152. Some
    use fewer, chosen at random: occupancy-net 2,048, pc2pix 8 x 1,024, alpha-wrap, denoised-wrap,
    upsampled-wrap and splat-fill 8,192. Notes on stderr say how many, and what else a method did
    to the points. Surface reconstruction of 100,000 points takes about half a minute, surface-fit
    less; --points takes fewer.
    """
    allow_modules(options.method or ())
    result = render(clouds, options)
    for note in result.notes:
        print(f"note: {visible(note)}", file=sys.stderr)
    for line in result.failed:
        print(f"bench: {visible(line)}", file=sys.stderr)
    count = result.drawn + result.without_image
    if result.without_image and count > 1:
        print(f"bench: {result.without_image} of {count} clouds have no image", file=sys.stderr)
    if result.images and (options.out is None or options.method is None):
        methods = visible(", ".join(options.methods))
        # The methods that a budget chooses from draw in grey.
        by_default = options.method is options.budget is None and options.colour != "invented"
        faster = "--budget 50ms is faster, " if by_default else ""
        print(f"drawn by {methods}; {faster}'bench list' has others", file=sys.stderr)
    for image in result.images:
        print(image)
    if result.without_image:
        raise typer.Exit(1)
