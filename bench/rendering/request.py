"""The options of `bench render`: checks, and the results that they ask for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bench.rendering.choice import methods_to_draw, note_on_budget, note_on_chairs
from bench.rendering.cloud import CloudFile, Notes, check_draws_colours, make_view
from bench.rendering.files import MOVING, check_opacity, moves
from bench.rendering.finish import LEAST_SIZE, MOST_SIZE
from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.scene import IMAGE_SIZE, View

_FRAMES = 36
_MOST_FRAMES = 120  # steps of 3 degrees; a sheet of ten methods takes 300 MB
MOST_PIXELS = 2**25  # of a turntable of another size: 100 MB, and ten times as many for a GIF


@dataclass(frozen=True)
class RenderOptions:
    """The options of `bench render`.

    Attributes
    ----------
    method : tuple of str
        Methods; several make a sheet. None: one within the budget, or the recommended one.
    out : Path or None
        An image, or a turntable by its name; None: beside the cloud, with its name and .png. Of
        several clouds the folder of the images.
    azimuth, elevation : float
        Degrees.
    frames : int or None
        Images of a turntable, which begins at the azimuth and goes all around; None: FRAMES.
    size : int or None
        Width and height of the image in pixels; None: as drawn.
    background : str
        "white", or "transparent" for an image with an opacity.
    colour : str
        "method" for the method's colours, "invented" for those that a network makes up, or "file"
        for points in the colours of the file.
    budget : float or None
        Most milliseconds for one image of a new cloud, which choose the method.
    up : str or None
        As in `bench.rendering.cloud.CloudFile`; None: y, and a note where z looks right.
    front, points, drop_invalid, drop_far, as_is
        See `bench.rendering.cloud.CloudFile`.
    """

    method: tuple[str, ...] | None = None
    out: Path | None = None
    azimuth: float = 30.0
    elevation: float = 20.0
    frames: int | None = None
    size: int | None = None
    background: Literal["white", "transparent"] = "white"
    colour: Literal["method", "invented", "file"] = "method"
    budget: float | None = None
    up: str | None = None
    front: str | None = None
    points: int | None = None
    drop_invalid: bool = False
    drop_far: bool = False
    device: str = "auto"
    as_is: bool = False

    @property
    def methods(self) -> tuple[str, ...]:
        """Return the methods, each once, or the one that is meant. Raises BadInput for none."""
        return methods_to_draw(self.method or (), self.colour == "invented", self.budget)


def check(options: RenderOptions, out: Path) -> None:
    """Raise BadInput for options that are wrong whatever the file holds and the methods do."""
    is_turntable = moves(out)  # raises BadInput for the name of another kind of file
    if options.frames is not None and not is_turntable:
        raise BadInput(
            f"--frames {options.frames}: {out} is one image; give a turntable's name, "
            f"{' or '.join(MOVING)}"
        )
    if options.frames is not None and not 2 <= options.frames <= _MOST_FRAMES:
        raise BadInput(f"--frames {options.frames}: must be 2 to {_MOST_FRAMES}")
    if options.points is not None and options.points < 1:
        raise BadInput(f"--points {options.points}: must be at least 1")
    _check_finish(options, out, is_turntable)
    upright(np.empty((0, 3)), options.up or "y", options.front)


def _check_finish(options: RenderOptions, out: Path, is_turntable: bool) -> None:
    """Raise BadInput for a size, a background or colours that these images cannot have."""
    size, sheet = options.size, len(options.methods) > 1
    if size is not None and not LEAST_SIZE <= size <= MOST_SIZE:
        raise BadInput(f"--size {size}: must be {LEAST_SIZE} to {MOST_SIZE}")
    if size is not None and sheet:
        raise BadInput(f"--size {size}: a sheet of several methods has its own; give one method")
    frames = (options.frames or _FRAMES) if is_turntable else 1
    if size is not None and frames * size**2 > MOST_PIXELS:
        most = int((MOST_PIXELS / frames) ** 0.5)
        raise BadInput(f"--size {size}: at most {most} with {frames} frames; give less of either")
    if options.background == "transparent":
        check_opacity(out)
        if sheet:
            raise BadInput("--background transparent: a sheet is white; give one method")
    if options.colour == "file":
        for method in options.methods:
            check_draws_colours(method)


def views_of(options: RenderOptions, out: Path) -> tuple[View, ...]:
    """Return the view, or all of a turntable. Raises BadInput for an angle out of its range."""
    first = make_view(options.azimuth, options.elevation)
    if not moves(out):
        return (first,)
    frames = options.frames or _FRAMES
    return tuple(
        View(first.azimuth_deg + 360 * i / frames, first.elevation_deg) for i in range(frames)
    )


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
    """Return notes on the budget's method, methods that know chairs only, and a size not drawn."""
    notes = []
    if of_budget := note_on_budget(options.budget):
        notes.append(of_budget)
    if options.size not in (None, IMAGE_SIZE):
        notes.append(
            f"methods draw {IMAGE_SIZE} x {IMAGE_SIZE} pixels; resampled to {options.size} x "
            f"{options.size} (Lanczos), which adds no detail"
        )
    if of_chairs := note_on_chairs(options.methods):
        notes.append(of_chairs)
    return tuple(notes)
