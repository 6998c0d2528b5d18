"""Images of an array of points, or of a file, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, cast, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.catalogue.method import ANY_SIZE
from bench.catalogue.methods import METHODS
from bench.rendering.cloud import (
    Background,
    CloudFile,
    Drawing,
    DrawnViews,
    Notes,
    draw_views,
    find_drawer,
    places,
    warn,
)
from bench.rendering.drawing_thread import on_drawing_thread
from bench.rendering.request import methods_to_draw, notes_on_methods, notes_on_size
from bench.running.work import load_renderer
from data_prep.clouds.normalise import cloud_of_points, real_points
from data_prep.failures import BadInput
from data_prep.files.cloud_contents import axis_columns
from data_prep.files.safe_read import shown
from data_prep.rendering.camera import FARTHEST
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import IMAGE_SIZE, Mesh, PointCloud, View

_MOST_FRAMES = 3_600  # steps of a tenth of a degree, in 180 MB of 128 pixels each way
_SPELT = {  # what a note on a file names, in Python
    "--drop-invalid": "drop_invalid=True",
    "--drop-far": "drop_far=True",
    "--up z": 'up="z"',
    "--up y": 'up="y"',
    "; '--method splat --colour file' draws its colours": "",
    "; --points takes another number": "",
}


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """The surface that a method has made, in an image.

    Attributes
    ----------
    depth : ndarray
        float32 [size, size]: the distance to the camera along its axis, in unit-sphere units (the
        centre is 4 away), mean of a pixel's samples; infinite where the surface is not.
    mask : ndarray
        float32 [size, size]: the share of a pixel that the surface covers, 0 to 1.
    normals : ndarray
        float32 [size, size, 3]: the mean normal of what a pixel shows in the camera's frame, +X to
        the right, +Y up and +Z to the camera; 0 where the surface is not.
    """

    depth: NDArray[np.float32]
    mask: NDArray[np.float32]
    normals: NDArray[np.float32]


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
        Whether to leave out points far from all others, which make the object small; else a
        warning tells of them.
    device : str
        "auto", "cpu" or "cuda", for networks.
    size : int
        Side of the images in pixels, 16 to 2048. Surfaces and discs are drawn so; images of
        networks are resampled, and a warning says so.
    background : str
        "white", or "transparent", with the opacity as a fourth channel.
    drop_invalid : bool
        Whether to leave out points that are not finite, with a warning; else they are refused.
    columns : sequence or None
        The columns of x, y and z in an array, counted from 0, or their names in a DataFrame. None:
        the only three, the first three of six, or those named x, y and z.
    """

    up: str = "y"
    front: str | None = None
    method: str | None = None
    colour: bool = False
    budget_ms: float | None = None
    drop_far: bool = False
    device: str = "auto"
    size: int = IMAGE_SIZE
    background: Background = "white"
    drop_invalid: bool = False
    columns: Sequence[int | str] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.size, int | np.integer) or self.size not in ANY_SIZE:
            raise BadInput(
                f"size {self.size!r}: must be a whole number, {ANY_SIZE[0]} to {ANY_SIZE[-1]}"
            )
        if not isinstance(self.method, str | None):
            raise BadInput(f"method {self.method!r}: must be the id of one method")
        if not isinstance(self.budget_ms, int | float | None):
            raise BadInput(f"budget_ms {self.budget_ms!r}: must be a number of milliseconds")
        if self.device not in ("auto", "cpu", "cuda"):
            raise BadInput(f"device {self.device!r}: must be auto, cpu or cuda")
        if self.background not in get_args(Background):
            raise BadInput(f"background {self.background!r}: must be white or transparent")

    def draw(self, points: ArrayLike | Path, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return the images, uint8 [V, size, size, 3 or 4]. Raises as `draw_cloud`."""
        return self._draw(points, views).images

    def draw_with_maps(
        self, points: ArrayLike | Path, view: View
    ) -> tuple[NDArray[np.uint8], SurfaceMaps]:
        """Return the image, and the surface in it. Raises as `draw_cloud`."""
        drawn = self._draw(points, [view])
        if not isinstance(mesh := getattr(drawn.state, "mesh", None), Mesh):
            (method,) = self._methods()
            some = ", ".join(m.id for m in METHODS if m.kind == "reconstruction")
            raise BadInput(
                f"method '{method}' makes no surface, so that there are no maps of it; give "
                f"method='occupancy-net' or one of {some}, or leave out return_maps"
            )
        maps = partial(surface_maps, mesh, [view], self.size, limited=False)
        ((mask, nearness, *normal),) = on_drawing_thread(maps)
        depth = np.where(mask > 0, FARTHEST - 2 * nearness, np.float32(np.inf))
        return drawn.images[0], SurfaceMaps(depth, mask, np.stack(normal, axis=-1))

    def _methods(self) -> tuple[str, ...]:
        named = (self.method,) if self.method is not None else ()
        return methods_to_draw(named, self.colour, self.budget_ms)

    def _draw(self, points: ArrayLike | Path, views: Sequence[View]) -> DrawnViews:
        """Draw on the drawing thread, and warn of what is to be known even if that fails."""
        notes: list[str] = []
        try:
            return on_drawing_thread(partial(self._drawn, points, views, notes))
        finally:
            warn(notes, levels=4)  # of `draw_cloud` or `turntable`

    def _drawn(
        self, points: ArrayLike | Path, views: Sequence[View], notes: list[str]
    ) -> DrawnViews:
        """Return the images, and add to the notes."""
        (method_id,) = self._methods()
        find_drawer(method_id)
        cloud, on_points = (
            self._of_file(Path(points))
            if isinstance(points, str | Path)
            else self._of_array(points)
        )
        notes += on_points
        notes += notes_on_methods((method_id,), self.budget_ms)
        notes += notes_on_size((method_id,), self.size)
        renderer = load_renderer(method_id, self.device)
        more = {"size": int(self.size), "background": self.background}
        drawn = draw_views(renderer, cloud, Drawing(method_id, tuple(views), **more))
        notes += drawn.notes
        return drawn

    def _of_file(self, path: Path) -> tuple[PointCloud, Notes]:
        if self.columns is not None:
            raise BadInput(
                f"{path}: columns are of an array; name those of a file in its first line"
            )
        if path.is_dir():
            raise BadInput(f"{path}: a folder; give a file of points")
        drops = {"drop_invalid": self.drop_invalid, "drop_far": self.drop_far}
        file = CloudFile(path, False, self.up, self.front, up_unknown=self.up == "y", **drops)
        try:
            cloud, notes = file.load_with_notes()
        except BadInput as error:
            raise BadInput(_in_python(str(error))) from error
        return cloud, tuple(map(_in_python, notes))

    def _of_array(self, points: ArrayLike) -> tuple[PointCloud, Notes]:
        chosen, notes = _three_columns(points, self.columns)
        values = real_points(chosen)
        broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
        count = f"{len(broken)} of {len(values)} points"
        if len(broken) and not self.drop_invalid:
            raise BadInput(
                f"{count} are not finite (the first is row {broken[0]}, from 0); remove them, or "
                "leave them out with drop_invalid=True"
            )
        if len(broken):
            values = np.delete(values, broken, axis=0)
            notes = (*notes, f"{count} are left out, they are not finite")
        far, of_places = places(values, self.drop_far, "drop_far=True")
        values = values[~far] if self.drop_far else values
        return cloud_of_points(values, self.up, self.front), (*notes, *of_places)


def _in_python(text: str) -> str:
    for option, spelt in _SPELT.items():
        text = text.replace(option, spelt)
    return text


def _three_columns(points: Any, columns: Sequence[int | str] | None) -> tuple[ArrayLike, Notes]:
    """Return the columns of x, y and z, and a note where others are left out unasked."""
    labels = [label for label in getattr(points, "columns", ()) if isinstance(label, str)]
    is_array = hasattr(points, "shape") and (labels or not hasattr(points, "columns"))
    given = points if is_array else cast("Any", np.asarray(points))
    if columns is not None:
        try:
            some = list(columns)
            chosen = points[some] if labels else given[:, some]
        except (LookupError, TypeError, ValueError) as error:
            raise BadInput(
                f"columns {columns!r}: not in points of shape {list(given.shape)}; give three "
                "numbers from 0, or three names of a DataFrame"
            ) from error
        return chosen, ()
    if axes := axis_columns(labels):
        return points[[labels[i] for i in axes]], ()
    if not all(map(str.isdigit, labels)):
        raise BadInput(
            f"points: columns {shown(', '.join(labels))}; name three of them x, y and z, or give "
            "columns="
        )
    if not labels and len(given.shape) == 2 and given.shape[1] == 6:
        return given[:, :3], (
            "points: columns 3 to 5 of [N, 6], colours or normals, are not used; columns= chooses",
        )
    return points, ()


@overload
def draw_cloud(
    points: ArrayLike | Path,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    *,
    return_maps: Literal[False] = False,
    **options: Any,
) -> NDArray[np.uint8]: ...
@overload
def draw_cloud(
    points: ArrayLike | Path,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    *,
    return_maps: Literal[True],
    **options: Any,
) -> tuple[NDArray[np.uint8], SurfaceMaps]: ...
def draw_cloud(
    points: ArrayLike | Path,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    *,
    return_maps: bool = False,
    **options: Any,
) -> Any:
    """Return an image of points in any units, as `bench render` draws it.

    The method runs in this process, where a native library may crash or hang; the default is a
    network. Its weights are read once a process. Any thread may call this; draws are done one after
    the other, in a thread of their own.

    A UserWarning each tells what the method did to the points (used fewer of them, smoothed them,
    made no mesh), a method that was trained on chairs alone, images that are resampled, columns
    that are not used, points far from the others, and coordinates that lie in steps.

    Parameters
    ----------
    points : array_like or path
        Real numbers [N, 3], or [N, 6] of which the first three count; rows with masked values are
        left out, with a warning. Of a DataFrame the columns named x, y and z. Or a file of points,
        as `bench render` reads it.
    azimuth_deg : float
        0 is the front, 90 the side of +X (see `data_prep.scene`).
    elevation_deg : float
        -90..90; the networks were trained within -40..40.
    return_maps : bool
        Whether to return the depth, mask and normals of the method's surface as well.
    **options
        `up`, `front`, `method`, `colour`, `budget_ms`, `drop_far`, `device`, `size`, `background`,
        `drop_invalid` and `columns` of `bench.rendering.points.DrawRequest`.

    Returns
    -------
    ndarray, or ndarray and SurfaceMaps
        uint8 [size, size, 3] on white, or [size, size, 4]; with `return_maps` also the maps.

    Raises
    ------
    data_prep.failures.BadInput
        For a cloud without points, without extent or with points that are not finite, for a file
        that is no cloud, for an unknown axis, method, size, background or column, for unusable
        weights, for a budget below the cheapest method, for a method with a budget, and for maps
        of a method that makes no surface. It is a ValueError.
    ValueError
        For `points` that are no array [N, 3] of real numbers, and for an angle out of its range.
    TypeError
        For an option that there is not.
    data_prep.failures.StageFailure
        Where the method cannot draw this cloud.
    """
    request = _request("draw_cloud", "azimuth_deg", options)
    view = View(_angle("azimuth_deg", azimuth_deg), _angle("elevation_deg", elevation_deg))
    return request.draw_with_maps(points, view) if return_maps else request.draw(points, [view])[0]


def _angle(name: str, value: float) -> float:
    """Return an angle in degrees. Raises ValueError for what is no number."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name} must be a number of degrees, got {value!r:.40}")
    return value


def turntable(
    points: ArrayLike | Path,
    frames: int = 36,
    elevation_deg: float = 20.0,
    **options: Any,
) -> NDArray[np.uint8]:
    """Return images of points from all around, in equal steps.

    Parameters
    ----------
    points, elevation_deg, **options
        As in `draw_cloud`; a budget is for the first image.
    frames : int
        Number of images, 1 to 3600; the first has azimuth 0.

    Returns
    -------
    ndarray
        uint8 [frames, size, size, 3] on white, or [frames, size, size, 4].

    Raises
    ------
    ValueError, data_prep.failures.StageFailure
        As in `draw_cloud`, and for other numbers of frames.
    """
    whole = isinstance(frames, Integral) and not isinstance(frames, bool)
    if not whole or not 1 <= frames <= _MOST_FRAMES:
        raise ValueError(f"frames must be a whole number from 1 to {_MOST_FRAMES}, got {frames!r}")
    elevation_deg = _angle("elevation_deg", elevation_deg)
    views = [View(360 * i / frames, elevation_deg) for i in range(frames)]
    return _request("turntable", "frames", options).draw(points, views)


def _request(caller: str, first: str, options: dict[str, Any]) -> DrawRequest:
    allowed = [field.name for field in fields(DrawRequest)]
    if unknown := ", ".join(options.keys() - {*allowed}):
        raise TypeError(
            f"{caller}: no option {unknown}; there are {first}, elevation_deg, {', '.join(allowed)}"
        )
    return DrawRequest(**options)
