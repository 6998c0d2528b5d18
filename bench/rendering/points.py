"""Images of an array of points, in one call."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.rendering.cloud import find_drawer, places
from bench.rendering.drawing_thread import on_drawing_thread
from bench.rendering.request import methods_to_draw, notes_on_methods
from bench.running.work import draw, load_renderer
from data_prep.clouds.normalise import cloud_of_points, real_points
from data_prep.failures import BadInput
from data_prep.files.cloud_contents import axis_columns
from data_prep.files.safe_read import shown
from data_prep.randomness import generator
from data_prep.scene import View


class DrawOptions(TypedDict, total=False):
    """The options of `draw_cloud` and `turntable`, as `DrawRequest` explains them."""

    up: str
    front: str | None
    method: str | None
    colour: bool
    budget_ms: float | None
    drop_far: bool
    device: str


@dataclass(frozen=True)
class DrawRequest:
    """The options of `draw_cloud` and `turntable` with their defaults.

    Attributes
    ----------
    up, front : str
        Axes of the points that point up and to the front, such as "z" or "-x". The default of
        `front` is "-z", or "-y" where z is up.
    method : str or None
        Id of a method, see `bench list`. None: one within the budget, or without a budget one
        that knows objects of 13 classes.
    colour : bool
        Whether that one draws in colours that it makes up; else in grey.
    budget_ms : float or None
        Most milliseconds for one image of a new cloud, by costs measured on one machine.
    drop_far : bool
        Whether to leave out points far from all others, which make the object small; else a line
        on stderr tells of them.
    device : str
        "auto", "cpu" or "cuda", for networks.
    """

    up: str = "y"
    front: str | None = None
    method: str | None = None
    colour: bool = False
    budget_ms: float | None = None
    drop_far: bool = False
    device: str = "auto"

    def draw(self, points: ArrayLike, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return the images, uint8 [V, 128, 128, 3]. Raises as `draw_cloud`."""
        return on_drawing_thread(partial(self._draw, points, views))

    def _draw(self, points: ArrayLike, views: Sequence[View]) -> NDArray[np.uint8]:
        named = (self.method,) if self.method is not None else ()
        (method_id,) = methods_to_draw(named, self.colour, self.budget_ms)
        method = find_drawer(method_id)
        labels = [label for label in getattr(points, "columns", ()) if isinstance(label, str)]
        axes = axis_columns(labels)
        if not axes and not all(map(str.isdigit, labels)):
            raise BadInput(
                f"points: columns {shown(', '.join(labels))}; name three of them x, y and z"
            )
        values = real_points(cast("Any", points)[[labels[i] for i in axes]] if axes else points)
        far, notes = places(values, self.drop_far, "drop_far=True")
        cloud = cloud_of_points(values[~far] if self.drop_far else values, self.up, self.front)
        renderer = load_renderer(method_id, self.device)
        for note in (*notes, *notes_on_methods((method_id,), self.budget_ms)):
            _note_once(note)
        return draw(method, renderer, cloud, views, generator("render")).images


def draw_cloud(
    points: ArrayLike,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    **options: Unpack[DrawOptions],
) -> NDArray[np.uint8]:
    """Return an image of points in any units and anywhere, as `bench render` draws it.

    The method runs in this process, where a native library may crash or hang; the default is a
    network. Its weights are read once a process. Any thread may call this; draws are done one after
    the other, in a thread of their own. Lines on stderr, each once a process, name a method that
    was trained on chairs alone, points far from the others, and coordinates that lie in steps.

    Parameters
    ----------
    points : array_like
        Real numbers [N, 3]; rows with masked values are left out, with a warning. Of a DataFrame
        the columns named x, y and z.
    azimuth_deg : float
        0 is the front, 90 the side of +X (see `data_prep.scene`).
    elevation_deg : float
        -90..90; the networks were trained within -40..40.
    **options
        `up`, `front`, `method`, `colour`, `budget_ms`, `drop_far` and `device` of `DrawRequest`.

    Returns
    -------
    ndarray
        uint8 [128, 128, 3] on white.

    Raises
    ------
    data_prep.failures.BadInput
        For a cloud without points, without extent or with points that are not finite, for an
        unknown axis or method, for unusable weights, for a budget below the cheapest method, and
        for a method with a budget. It is a ValueError.
    ValueError
        For `points` that are no array [N, 3] of real numbers, and for an angle out of its range.
    data_prep.failures.StageFailure
        Where the method cannot draw this cloud.
    """
    request = _request("draw_cloud", "azimuth_deg", options)
    return request.draw(points, [View(azimuth_deg, elevation_deg)])[0]


def turntable(
    points: ArrayLike,
    frames: int = 36,
    elevation_deg: float = 20.0,
    **options: Unpack[DrawOptions],
) -> NDArray[np.uint8]:
    """Return images of points from all around, in equal steps; the cloud is prepared once.

    Parameters
    ----------
    points, elevation_deg, **options
        As in `draw_cloud`; a budget is for the first image.
    frames : int
        Number of images, at least 1; the first has azimuth 0.

    Returns
    -------
    ndarray
        uint8 [frames, 128, 128, 3] on white.

    Raises
    ------
    ValueError, data_prep.failures.StageFailure
        As in `draw_cloud`, and for less than one frame.
    """
    if frames < 1:
        raise ValueError(f"frames must be at least 1, got {frames}")
    views = [View(360 * i / frames, elevation_deg) for i in range(frames)]
    return _request("turntable", "frames", options).draw(points, views)


def _request(caller: str, first: str, options: DrawOptions) -> DrawRequest:
    allowed = DrawOptions.__annotations__
    if unknown := ", ".join(options.keys() - allowed.keys()):
        raise TypeError(
            f"{caller}: no option {unknown}; there are {first}, elevation_deg, {', '.join(allowed)}"
        )
    return DrawRequest(**options)


@cache
def _note_once(note: str) -> None:
    print(f"note: {note}", file=sys.stderr)
