"""`bench render`: images of clouds and meshes, sheets by several methods, turntables of these."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from bench.catalogue.chosen import budget_ms_of
from bench.catalogue.methods import ANY_SIZE, RECOMMENDED, allow_modules
from bench.commands.options import OptionSpec, options_from_dataclass, path_argument
from bench.draw.choice import (
    Notes,
    check_camera,
    check_colour,
    method_of_mesh,
    methods_to_draw,
    notes_on_methods,
    notes_on_size,
)
from bench.draw.cloud import Dots, Drawing, Drawn, Failed, Wanted, draw_each
from bench.draw.cloud_file import CloudFile
from bench.draw.files import (
    MOVING,
    check_opacity,
    files_of_views,
    image_of_cloud,
    images_of_clouds,
    moves,
    names_of_views,
    write_images,
)
from bench.draw.finish import Tile, columns_of, draw_sheet
from bench.draw.kept_mesh import check_kept
from bench.running.environment import cores
from bench.tables.markdown import visible
from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.files.pinholes import Pinholes, read_pinholes
from data_prep.progress import progress
from data_prep.scene import IMAGE_SIZE, View

_SHEET_SCALE = 2
_AZIMUTH, _ELEVATION = 30.0, 20.0  # in degrees, where neither angles nor a camera are given
CLOUD = "cloud"  # the label of the first tile of a sheet, which shows the points as dots
_FRAMES = 36  # images of a turntable by default: one every 10 degrees
# The most images of a turntable: one every 3 degrees. In a sheet of ten methods they take 300 MB.
_MOST_FRAMES = 120
# The most pixels in all images of a cloud together. They take 100 MB of memory, and ten times as
# much while a GIF is written.
_MOST_PIXELS = 2**25


def _option(value: Any, help: str, **parts: Any) -> Any:
    """Return a dataclass field that holds its option's help and other parts of an `OptionSpec`."""
    return field(default=value, metadata={"help": help, **parts})


def _angles(help: str) -> Any:
    """Return a dataclass field of angles, which are given in degrees, separated by commas."""

    def read(text: str | None) -> tuple[float, ...] | None:
        if text is None:
            return None
        try:
            return tuple(map(float, text.split(",")))
        except ValueError as error:
            raise BadInput(
                f"'{text}': not numbers; give degrees separated by commas, as in 0,90,180"
            ) from error

    more = {"metavar": "DEGREES", "kind": str | None, "convert": read}
    return _option(None, f"{help} Several, comma-separated, give an image for each.", **more)


def _size(text: str | None) -> int | None:
    if text is None:
        return None
    if text.lower().partition("x")[
        2
    ]:  # a width and a height, as in 512x512; 512px is another error
        raise BadInput(
            f"--size {text}: images are square, as the unit sphere just fits; give one number, as "
            "in 512"
        )
    try:
        size = int(text)
    except ValueError as error:
        raise BadInput(
            f"--size {text}: not a whole number of pixels; give a number such as 512"
        ) from error
    if size not in ANY_SIZE:
        raise BadInput(f"--size {size}: must be {ANY_SIZE[0]} to {ANY_SIZE[-1]}")
    return size


@dataclass(frozen=True)
class RenderOptions:
    """The options of `bench render`, each with its help."""

    method: tuple[str, ...] | None = _option(
        None,
        "Method, see 'bench list'; several, comma-separated, make a sheet. Default: "
        f"{RECOMMENDED}, for any object; a mesh is drawn itself, as by true-mesh.",
    )
    budget: float | None = _option(  # in milliseconds
        None,
        "Time for one image of a new cloud, which chooses the method by the points of the file and "
        "by measured costs and scores. Default: no limit.",
        metavar="50ms|0.2s",
        kind=str | None,
        convert=lambda text: None if text is None else budget_ms_of(text),
    )
    out: Path | None = _option(  # noqa: RUF009
        None,
        "Image file, .png; or a turntable, .gif, .webp; of several clouds a folder, where "
        "images are replaced. Default: beside the cloud, with its name and .png.",
        flag="--out -o",
    )
    azimuth: tuple[float, ...] | None = _angles(
        f"Azimuth in degrees; 0 is the front. Default: {_AZIMUTH:g}."
    )
    elevation: tuple[float, ...] | None = _angles(
        f"Elevation in degrees, -90 to 90; 0 is level. Default: {_ELEVATION:g}."
    )
    camera: Path | None = _option(  # noqa: RUF009
        None,
        "JSON file of pinhole cameras, of Open3D or a transforms.json, in the coordinates of the "
        "cloud's file: an image for each, of their width and height. Default: --azimuth and "
        "--elevation.",
        metavar="FILE",
    )
    format: Literal["png", "jpg", "webp", "gif"] = _option(
        "png",
        "Format of the images that -o does not name: of those in a folder, or beside a cloud.",
    )
    frames: int | None = _option(
        None,
        "Images of a turntable, from the azimuth all around; of a .webp 1 is a still image. "
        f"Default: {_FRAMES}.",
    )
    size: int | None = _option(
        None,
        f"Width and height in pixels, {ANY_SIZE[0]} to {ANY_SIZE[-1]}. Surfaces and discs are "
        "drawn at that size, and details by fused-net; images of other networks are resampled to "
        f"it, and a note says so. Default: {IMAGE_SIZE}.",
        metavar="PIXELS",
        kind=str | None,
        convert=_size,
    )
    background: Literal["white", "transparent"] = _option(
        "white", "White, or transparent pixels (.png or .webp)."
    )
    colour: str = _option(
        "auto",
        "auto: in the colours of the file, where it has any; file: in these, or an error; grey: "
        "without them; invented: in those that a network makes up; height: by the height; or a "
        "column of the file, such as intensity.",
        metavar="auto|file|grey|invented|height|COLUMN",
    )
    up: str | None = _option(
        None, "Axis of the file that points up, -x to z; z for most scans. Default: y."
    )
    front: str | None = _option(
        None, "Axis of the file to the front. Default: -z, or -y where z is up."
    )
    points: int | None = _option(
        None,
        "The most points to draw, chosen at random; of a mesh so many on its surface, in place of "
        "the mesh itself. Default: all; of a mesh 2048, where a method draws points of it.",
    )
    drop_invalid: bool = _option(
        False,
        "Leave out points that are not finite, and print how many. Default: refuse them.",
    )
    drop_far: bool = _option(
        False,
        "Leave out points far from all others, and print how many. Default: draw them, and say so "
        "in a note.",
    )
    device: Literal["auto", "cpu", "cuda"] = _option(
        "auto", "Where networks run; auto: on a GPU if there is one."
    )
    keep_mesh: Path | None = _option(  # noqa: RUF009
        None,
        "PLY into which the surface is written that the method made, in the units and axes of the "
        "cloud's file; of one cloud, by one method that makes a surface. Default: none is kept.",
    )
    as_is: bool = _option(
        False, "Keep scale and place. Default: move the cloud into the unit sphere."
    )

    @property
    def views(self) -> tuple[View, ...]:
        """Return a view for each pair of angles. Raises BadInput for an angle out of its range."""
        angles = itertools.product(self.elevation or (_ELEVATION,), self.azimuth or (_AZIMUTH,))
        try:
            return tuple(dict.fromkeys(View(azimuth, elevation) for elevation, azimuth in angles))
        except ValueError as error:
            raise BadInput(f"no such view: {error}; see 'bench render --help'") from error

    @property
    def side(self) -> int:
        """Return the width and height of images in pixels, without a camera."""
        return self.size or IMAGE_SIZE

    @property
    def methods(self) -> tuple[str, ...]:
        """Return the methods of --method, each once, or else the one that the options choose.

        With a budget it is the one for 2,048 points; `Drawing` chooses for those of the file.

        Raises BadInput where no method is fast enough for --budget, and for options that exclude
        each other.
        """
        return methods_to_draw(self.method or (), self.colour == "invented", self.budget)

    @property
    def of_mesh(self) -> str | None:
        """Return the method that draws a mesh itself; None where points of it are to be drawn.

        That is where an option chooses the method, or speaks of points.
        """
        if self.method or self.budget is not None or self.points is not None or self.drop_far:
            return None
        return method_of_mesh(self.colour)


def check(options: RenderOptions, out: Path) -> None:
    """Raise BadInput for options that are wrong whatever the file holds and the methods do."""
    is_turntable = moves(out)  # raises BadInput where the name has no suffix of an image
    size, views = options.side, len(options.views)
    if options.camera is None:
        _check_frames(options, out, is_turntable)
    else:
        _check_beside_camera(options, out)
    if options.points is not None and options.points < 1:
        raise BadInput(f"--points {options.points}: must be at least 1")
    is_sheet = len(options.methods) > 1
    images = views
    if views == 1 and is_turntable and options.camera is None:
        images = options.frames or _FRAMES
    if is_sheet:
        images *= 1 + len(options.methods)  # the first tile shows the points
    if images * size**2 > _MOST_PIXELS:
        raise BadInput(
            f"--size {size}: at most {int((_MOST_PIXELS / images) ** 0.5)} with {images} images; "
            "give a smaller size, or fewer images"
        )
    transparent = options.background == "transparent"
    if transparent and is_sheet:
        raise BadInput("--background transparent: a sheet is white; give one method")
    if transparent:
        check_opacity(out)
    for method in options.methods:
        check_colour(method, options.colour)
    upright(np.empty((0, 3)), options.up or "y", options.front)


def _check_frames(options: RenderOptions, out: Path, is_turntable: bool) -> None:
    """Raise BadInput for a number of frames that is out of range or does not suit the file."""
    frames = options.frames
    if frames is not None and not is_turntable:
        raise BadInput(
            f"--frames {frames}: {out} is one image; give a turntable's name, {' or '.join(MOVING)}"
        )
    if frames is not None and not 1 <= frames <= _MOST_FRAMES:
        raise BadInput(f"--frames {frames}: must be 1 to {_MOST_FRAMES}")
    always_turns = out.suffix.lower() == ".gif"  # a .webp may be a still image
    if len(options.views) > 1 and (frames not in (None, 1) or always_turns):
        raise BadInput(
            f"{out}: a turntable starts at one azimuth; give one azimuth and one elevation, or the "
            "name of a still image for several angles"
        )


def _check_beside_camera(options: RenderOptions, out: Path) -> None:
    """Raise BadInput for options that contradict a camera, and for methods that know none."""
    for name in ("azimuth", "elevation", "size", "frames"):
        if getattr(options, name) is not None:
            raise BadInput(
                f"--{name}: the file of --camera says where its cameras stand, and how large their "
                f"images are; leave out --{name}, or --camera"
            )
    if options.as_is:
        raise BadInput("--as-is: a camera moves with its cloud; leave out --as-is, or --camera")
    if out.suffix.lower() == ".gif":
        raise BadInput(f"{out}: cameras give still images; give a name that ends in .png")
    if len(options.methods) > 1:
        raise BadInput(
            f"--camera {options.camera}: a sheet of several methods has its own cameras; give one "
            "method, or leave out --camera"
        )
    for method in options.methods:
        check_camera(method)


def _pinholes(options: RenderOptions) -> Pinholes | None:
    """Return the cameras of --camera, in our axes; None without it.

    Raises BadInput where the file holds none, or too many.
    """
    if options.camera is None:
        return None
    pinholes = read_pinholes(options.camera, ANY_SIZE)
    count, side = len(pinholes.names), max(pinholes.width, pinholes.height)
    most = min(_MOST_FRAMES, _MOST_PIXELS // side**2)
    if count > most:
        raise BadInput(
            f"{options.camera}: {count} cameras, and at most {most} of {pinholes.width} x "
            f"{pinholes.height} pixels are drawn; divide the file, or make the images smaller"
        )
    return pinholes.turned(options.up or "y", options.front)


def views_of(options: RenderOptions, out: Path) -> tuple[View, ...]:
    """Return the views that the options name, or, where the file is a turntable, all its views.

    Raises BadInput as `RenderOptions.views` does.
    """
    first, *others = options.views
    if others or options.camera or not moves(out):
        return options.views
    frames = options.frames or _FRAMES
    turned = (first.azimuth_deg + 360 * i / frames for i in range(frames))
    return tuple(View(azimuth, first.elevation_deg) for azimuth in turned)


def cloud_file(cloud: Path, options: RenderOptions) -> CloudFile:
    """Return the file of a cloud together with how the options say that it is read."""
    return CloudFile(
        cloud,
        as_is=options.as_is,
        up=options.up or "y",
        front=options.front,
        most=options.points,
        drop_invalid=options.drop_invalid,
        drop_far=options.drop_far,
        colours="grey" if options.colour == "invented" else options.colour,
        up_unknown=options.up is None,
    )


def notes_on(options: RenderOptions, methods: Sequence[str]) -> Notes:
    """Return notes on the methods, and on those that draw another size, which is resampled.

    With a budget there are none: each file has its own method, and the notes on it say which.
    """
    if options.budget is not None:
        return ()
    notes = notes_on_methods(methods)
    if options.camera is None:
        notes += notes_on_size(methods, options.side)
    return notes


class _RenderResult(NamedTuple):
    """The result of `bench render`.

    images         the files that were written: images, and behind them the surface that is kept
    drawn          the number of clouds that have images
    failed         a line for each cloud that cannot be used, and for each method that failed
    without_image  the number of clouds that cannot be used, or whose methods all failed
    notes          lines on parts of files that are not used, and on what the methods did
    methods        the methods that were to draw: where none is named, meshes have one of their own
    """

    images: tuple[Path, ...]
    drawn: int
    failed: tuple[str, ...]
    without_image: int
    notes: Notes
    methods: tuple[str, ...]


def render(clouds: Sequence[Path], options: RenderOptions) -> _RenderResult:
    """Draw clouds and write an image of each, unless all methods fail.

    The images of a single method are written as they are. Several methods give a sheet: the points
    as dots, then a tile for each method, which holds the reason where a method has failed. Several
    angles give a file each.

    Raises BadInput for options and names that cannot be used, before a worker is started. Where the
    only file holds no cloud, that raises BadInput, too; among several files such a file is reported
    in `failed`.
    """
    alone = len(clouds) == 1 and not clouds[0].is_dir()
    images, left_out = _image_of_each(clouds, options)
    any_image = next(iter(images.values()))
    check(options, any_image)
    if options.keep_mesh is not None:
        check_kept(options.keep_mesh, clouds, options.methods)
    views, pinholes = views_of(options, any_image), _pinholes(options)
    names = names_of_views(options.views) if pinholes is None else pinholes.names
    shots = {cloud: files_of_views(image, names) for cloud, image in images.items()}
    for image in shots[clouds[0]] if alone else ():
        if options.out is None and image.exists():
            raise BadInput(
                f"{image}: exists already; -o {any_image} replaces it, -o NAME keeps both"
            )
    size, background = options.side, options.background
    drawings = [
        Drawing(
            method,
            views,
            options.device,
            size=size,
            background=background,
            budget_ms=options.budget,
            pinholes=pinholes,
            of_mesh=options.of_mesh,
            keep_mesh=options.keep_mesh,
        )
        for method in options.methods
    ]
    wanted: list[Wanted] = list(drawings)
    if len(drawings) > 1:  # a sheet, which begins with the points themselves
        wanted.insert(0, Dots(views))
    files = {cloud: cloud_file(cloud, options) for cloud in images}
    failed: dict[Path, list[str]] = {}
    notes: dict[Path, Notes] = {}
    used = dict.fromkeys(options.methods if options.of_mesh is None else ())
    written = set()
    for file, drawn, of_file in _draw_all(tuple(files.values()), wanted):
        cloud = file.path
        unusable = next((d for d in drawn.values() if isinstance(d, BadInput)), None)
        if alone and unusable is not None:
            raise unusable
        notes[cloud] = of_file
        failed[cloud] = [str(unusable)] if unusable else _failures(file, drawn, named=not alone)
        used |= {request.method: None for request in drawn if isinstance(request, Drawing)}
        if unusable is None and len(failed[cloud]) < len(drawings):
            frames, shot = _finished(drawn, size), shots[cloud]
            for i, image in enumerate(shot):
                write_images(frames if len(shot) == 1 else frames[i : i + 1], image)
            written.add(cloud)
    methods = tuple(used)
    files_written = [image for cloud, shot in shots.items() if cloud in written for image in shot]
    if written and options.keep_mesh is not None:
        files_written.append(options.keep_mesh)
    return _RenderResult(
        tuple(files_written),
        len(written),
        tuple(line for cloud in images for line in failed[cloud]),
        len(images) - len(written),
        left_out + _joined({cloud: notes[cloud] for cloud in images}) + notes_on(options, methods),
        methods,
    )


def _image_of_each(
    clouds: Sequence[Path], options: RenderOptions
) -> tuple[Mapping[Path, Path], Notes]:
    """Return the image file for each cloud, and notes on files of folders that hold no cloud."""
    first = clouds[0]
    if len(clouds) == 1 and not first.is_dir():
        return {first: image_of_cloud(first, options.out, options.format)}, ()
    if options.out is None:
        kind = "a folder" if first.is_dir() else "one of several clouds"
        raise BadInput(f"{first}: {kind}; give a folder for the images, -o FOLDER")
    return images_of_clouds(clouds, options.out, options.format)


def with_remedy(failed: Failed, file: CloudFile) -> str:
    """Return why a method failed, with a remedy where fewer points may help."""
    over_limit = failed.reason.startswith(("timeout: ", "memory: "))
    if over_limit and not file.most:
        return f"{failed.reason}; --points 20000 would take less"
    return failed.reason


def _failures(file: CloudFile, drawn: Mapping[Wanted, Drawn], named: bool) -> list[str]:
    """Return a line for each method that failed; with `named`, it begins with the file's name."""
    lines = []
    for request, images in drawn.items():
        if isinstance(request, Drawing) and isinstance(images, Failed):
            method = request.method if request.budget_ms is None else "the budget's method"
            line = f"{method}: {with_remedy(images, file)}"
            lines.append(f"{file.path}: {line}" if named else line)
    return lines


def _joined(notes: Mapping[Path, Notes]) -> Notes:
    """Return the notes on all files, where a note that several files share is one line."""
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
    """Yield each file with its images, in the order of `wanted`, and with the notes on it.

    A file is yielded as soon as its last image is drawn, so that the images of few files are in
    memory at a time.
    """
    tasks = len(files) * len(wanted)
    quick = tasks == 1 and len(wanted[0].views) == 1  # ends before anybody reads a progress bar
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
                # The only request may have been drawn by the method for meshes, as another one.
                in_order = drawn if len(wanted) == 1 else {each: drawn[each] for each in wanted}
                # Each request has the same notes on the file: they are kept once.
                lines = (line for request in in_order for line in of_requests[request])
                yield file, in_order, tuple(dict.fromkeys(lines))


def _finished(drawn: Mapping[Wanted, Drawn], size: int) -> NDArray[np.uint8]:
    """Return the images to write, uint8: those of the only method, or a sheet of all methods.

    size  width and height of the image of a method, in pixels
    """
    if len(drawn) == 1:
        (images,) = drawn.values()
        assert isinstance(images, np.ndarray)
        return images
    tiles = []
    for drawing, images in drawn.items():
        assert not isinstance(images, BadInput)
        label = visible(drawing.method) if isinstance(drawing, Drawing) else CLOUD
        tiles.append(Tile(label, visible(images.reason) if isinstance(images, Failed) else images))
    # Images of the usual size are small beside their labels; larger ones are shown as they are.
    scale = 1 if size > IMAGE_SIZE else _SHEET_SCALE
    return draw_sheet(tiles, columns_of(len(tiles)), scale, size)


@options_from_dataclass(
    RenderOptions, {option.name: OptionSpec(**option.metadata) for option in fields(RenderOptions)}
)
def render_clouds(
    options: RenderOptions,
    clouds: Annotated[
        list[Path],
        path_argument(
            "CLOUD",
            "Files, or folders of them: PLY, NPY, XYZ, TXT, CSV, ASC, PTS, LAS, LAZ, E57, PCD; of "
            "meshes PLY, OBJ, OFF, STL, GLB, GLTF.",
        ),
    ],
) -> None:
    """Draw the clouds and meshes of files. Exit 1 if one has no image as all its methods failed.

    Where no method is named, a mesh is drawn itself, in its colours. A method that is named draws
    points of its surface; true-mesh beside others in a sheet draws the mesh.

    Each method gets 120 seconds, 4 GiB of memory and all points; of a large scan at most 2,097,152.
    Some methods use fewer, chosen at random: occupancy-net 2,048, pc2pix 8 x 1,024, fused-net,
    splat-net, denoised-wrap, upsampled-wrap and splat-fill 8,192, alpha-wrap 32,768. Notes on
    stderr say how many, and what else a method did to the points. Of 100,000 points surface-fit
    takes seconds, other surface reconstruction half a minute, and longer where points are noisy, up
    to the limit of 120 seconds; --points takes fewer.
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
    # The method that a budget chose stands in a note on each file.
    if result.images and options.budget is None and None in (options.out, options.method):
        methods = visible(", ".join(result.methods))
        # --budget is no advice where colours are wanted: it chooses among methods that draw grey.
        by_default = options.method is None and RECOMMENDED in result.methods
        faster = "--budget 50ms is faster, " if by_default else ""
        print(f"drawn by {methods}; {faster}'bench list' has others", file=sys.stderr)
    for image in result.images:
        print(image)
    if result.without_image:
        raise typer.Exit(1)
