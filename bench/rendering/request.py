"""The options of `bench render`: checks, and the results that they ask for."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.catalogue.chosen import best_within, budget_ms_of
from bench.catalogue.method import ANY_SIZE
from bench.catalogue.methods import RECOMMENDED, RECOMMENDED_IN_COLOUR, find_method
from bench.rendering.cloud import CloudFile, Notes, check_draws_colours
from bench.rendering.files import MOVING, check_opacity, moves
from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.scene import IMAGE_SIZE, View

_FRAMES = 36
_MOST_FRAMES = 120  # steps of 3 degrees; a sheet of ten methods takes 300 MB
_MOST_PIXELS = 2**25  # of a turntable of another size: 100 MB, and ten times as many for a GIF


def _option(value: Any, help: str, **parts: Any) -> Any:
    """Return a field with the parts of its option, `bench.commands.options.OptionSpec`."""
    return field(default=value, metadata={"help": help, **parts})


def _angles(default: float, help: str) -> Any:
    """Return a field of angles, given separated by commas."""

    def read(text: str) -> tuple[float, ...]:
        try:
            return tuple(map(float, text.split(",")))
        except ValueError as error:
            raise BadInput(
                f"'{text}': no angles; give degrees separated by commas, as in 0,90,180"
            ) from error

    more = {"metavar": "DEGREES", "kind": str, "convert": read, "default": f"{default:g}"}
    return _option((default,), f"{help}. Several, comma-separated, make an image each.", **more)


def _size(text: str) -> int:
    if text.lower().partition("x")[2]:  # 512x512, not 512px
        raise BadInput(
            f"--size {text}: images are square, as the unit sphere just fits; give one number"
        )
    try:
        size = int(text)
    except ValueError as error:
        raise BadInput(f"--size {text}: no whole number of pixels; give one, as in 512") from error
    if size not in ANY_SIZE:
        raise BadInput(f"--size {size}: must be {ANY_SIZE[0]} to {ANY_SIZE[-1]}")
    return size


@dataclass(frozen=True)
class RenderOptions:
    """The options of `bench render`, each with its help."""

    method: tuple[str, ...] | None = _option(
        None,
        "Method, see 'bench list'; several, comma-separated, make a sheet. Default: "
        f"{RECOMMENDED}, for any object.",
    )
    budget: float | None = _option(  # in milliseconds
        None,
        "Time for one image of a new cloud, which chooses the method by measured costs and scores. "
        "Default: no limit.",
        metavar="50ms|0.2s",
        kind=str | None,
        convert=lambda text: None if text is None else budget_ms_of(text),
    )
    out: Path | None = _option(  # noqa: RUF009
        None,
        "Image file, .png; or a turntable, .gif, .webp, .apng; of several clouds a folder, where "
        "images are replaced. Default: beside the cloud, with its name and .png.",
        flag="--out -o",
    )
    azimuth: tuple[float, ...] = _angles(30.0, "Azimuth in degrees; 0 is the front")
    elevation: tuple[float, ...] = _angles(20.0, "Elevation in degrees, -90 to 90; 0 is level")
    format: Literal["png", "jpg", "webp", "gif", "apng"] = _option(
        "png",
        "Format of the images that -o does not name: of those in a folder, or beside a cloud.",
    )
    frames: int | None = _option(
        None,
        "Images of a turntable, from the azimuth all around; of a .webp 1 is a still image. "
        f"Default: {_FRAMES}.",
    )
    size: int = _option(
        IMAGE_SIZE,
        f"Width and height in pixels, {ANY_SIZE[0]} to {ANY_SIZE[-1]}. Surfaces and discs are "
        "drawn so, images of networks resampled, which a note says.",
        metavar="PIXELS",
        kind=str,
        convert=_size,
        default=str(IMAGE_SIZE),
    )
    background: Literal["white", "transparent"] = _option(
        "white", "White, or transparent pixels (.png, .apng or .webp)."
    )
    colour: Literal["method", "invented", "file"] = _option(
        "method",
        "The method's colours; those that a network invents; or, with --method splat, those of the "
        "file.",
    )
    up: str | None = _option(
        None, "Axis of the file that points up, -x to z; z for most scans. Default: y."
    )
    front: str | None = _option(
        None, "Axis of the file to the front. Default: -z, or -y where z is up."
    )
    points: int | None = _option(
        None, "Points at most, chosen at random. Default: all; 2048 of the surface of a mesh."
    )
    drop_invalid: bool = _option(
        False,
        "Leave out points that are not finite, and print how many. Default: refuse them.",
    )
    drop_far: bool = _option(
        False,
        "Leave out points far from all others, and print how many. Default: draw them, and print "
        "it.",
    )
    device: Literal["auto", "cpu", "cuda"] = _option(
        "auto", "Where networks run; auto: on a GPU if there is one."
    )
    as_is: bool = _option(
        False, "Keep scale and place. Default: move the cloud into the unit sphere."
    )

    @property
    def views(self) -> tuple[View, ...]:
        """Return the views that the angles name. Raises BadInput for one out of its range."""
        angles = itertools.product(self.elevation, self.azimuth)
        try:
            return tuple(dict.fromkeys(View(azimuth, elevation) for elevation, azimuth in angles))
        except ValueError as error:
            raise BadInput(f"no such view: {error}; see 'bench render --help'") from error

    @property
    def methods(self) -> tuple[str, ...]:
        """Return the methods, each once, or the one that is meant. Raises BadInput for none."""
        return methods_to_draw(self.method or (), self.colour == "invented", self.budget)


def check(options: RenderOptions, out: Path) -> None:
    """Raise BadInput for options that are wrong whatever the file holds and the methods do."""
    is_turntable = moves(out)  # raises BadInput for the name of another kind of file
    size, frames, points = options.size, options.frames, options.points
    several = len(options.views) > 1
    turned = max(1, frames or _FRAMES) if is_turntable else 1
    shown = len(options.views) if several else turned
    sheet, transparent = len(options.methods) > 1, options.background == "transparent"
    for wrong, text in (
        (
            frames is not None and not is_turntable,
            f"--frames {frames}: {out} is one image; give a turntable's name, "
            f"{' or '.join(MOVING)}",
        ),
        (
            frames is not None and not 1 <= frames <= _MOST_FRAMES,
            f"--frames {frames}: must be 1 to {_MOST_FRAMES}",
        ),
        (
            several and (frames not in (None, 1) or out.suffix.lower() in (".gif", ".apng")),
            f"{out}: a turntable, which starts at one azimuth; of several angles give the name of "
            "an image, or one azimuth and one elevation",
        ),
        (points is not None and points < 1, f"--points {points}: must be at least 1"),
        (
            size != IMAGE_SIZE and sheet,
            f"--size {size}: a sheet of several methods has its own; give one method",
        ),
        (
            shown * size**2 > _MOST_PIXELS,
            f"--size {size}: at most {int((_MOST_PIXELS / shown) ** 0.5)} with {shown} images; "
            "give less of either",
        ),
        (transparent and sheet, "--background transparent: a sheet is white; give one method"),
    ):
        if wrong:
            raise BadInput(text)
    if transparent:
        check_opacity(out)
    for method in options.methods if options.colour == "file" else ():
        check_draws_colours(method)
    upright(np.empty((0, 3)), options.up or "y", options.front)


def views_of(options: RenderOptions, out: Path) -> tuple[View, ...]:
    """Return the views, or those of a turntable. Raises BadInput as `RenderOptions.views`."""
    first, *others = options.views
    if others or not moves(out):
        return options.views
    frames = options.frames or _FRAMES
    turned = (first.azimuth_deg + 360 * i / frames for i in range(frames))
    return tuple(View(azimuth, first.elevation_deg) for azimuth in turned)


def cloud_file(cloud: Path, options: RenderOptions) -> CloudFile:
    """Return the file of a cloud, to be read as the options say."""
    return CloudFile(
        cloud,
        options.as_is,
        options.up or "y",
        options.front,
        options.points,
        options.drop_invalid,
        options.drop_far,
        with_colors=options.colour == "file",
        up_unknown=options.up is None,
    )


def notes_on(options: RenderOptions) -> Notes:
    """Return notes on the methods and on a size that they do not draw."""
    return (
        *notes_on_methods(options.methods, options.budget),
        *notes_on_size(options.methods, options.size),
    )


def notes_on_size(methods: Sequence[str], size: int) -> Notes:
    """Return a line for each method whose images are resampled."""
    drawn = ((name, find_method(name).drawn_at(size)) for name in methods)
    return tuple(
        f"{name} draws {side} x {side} pixels; resampled to {size} x {size} (Lanczos)"
        + ", which adds no detail; surfaces and discs are drawn at any size" * (side < size)
        for name, side in drawn
        if side != size
    )


def methods_to_draw(
    methods: Sequence[str], in_colour: bool = False, budget_ms: float | None = None
) -> tuple[str, ...]:
    """Return the methods, each once, or the one that is meant where none is named.

    That is one within the budget, or the recommended one for an unknown object, in colours that a
    network makes up or in grey. Raises BadInput for wishes that exclude each other, and for a
    budget that no method meets.
    """
    if methods and budget_ms is not None:
        raise BadInput(
            f"budget {budget_ms:g}ms: it chooses the method, and {', '.join(methods)} is named; "
            "leave out one of the two"
        )
    if in_colour and budget_ms is not None:
        raise BadInput(
            f"budget {budget_ms:g}ms: the methods that it chooses from draw in grey; leave out "
            "the colour or the budget"
        )
    for method_id in methods if in_colour else ():
        if find_method(method_id).color == "none":
            raise BadInput(
                f"method '{method_id}' draws in grey; leave out the colour, or the method: then "
                f"{RECOMMENDED_IN_COLOUR} draws"
            )
    if methods:
        return tuple(dict.fromkeys(methods))
    if budget_ms is not None:
        return (best_within(budget_ms).method,)
    return (RECOMMENDED_IN_COLOUR if in_colour else RECOMMENDED,)


def notes_on_methods(methods: Sequence[str], budget_ms: float | None = None) -> Notes:
    """Return a line on the method that a budget chose, and one on those that know chairs only."""
    notes = []
    if budget_ms is not None:
        chosen = best_within(budget_ms)
        notes.append(
            f"budget {budget_ms:g}ms: {chosen.method}, of the measured methods within it the best "
            f"on real meshes (score {chosen.score:.3f}); {chosen.one_view_ms:.3g} ms for one image "
            "of 2,048 points, where it was measured"
        )
    if chairs := [name for name in methods if find_method(name).trained_on == "chairs"]:
        were = "was" if len(chairs) == 1 else "were"
        notes.append(
            f"{', '.join(chairs)} {were} trained on chairs and may draw a chair whatever the cloud "
            "is; for other objects leave out the method"
        )
    return tuple(notes)
