"""Images of an array of points, or of a file, in one call."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.catalogue.methods import ANY_SIZE, find_method
from bench.draw.choice import (
    Notes,
    check_camera,
    check_colour,
    method_of_mesh,
    methods_to_draw,
    notes_on_methods,
    notes_on_size,
)
from bench.draw.cloud import Background, Drawing, DrawnViews, draw_views, suited, warn
from bench.draw.cloud_file import CloudFile, LoadedCloud, far_with_notes
from bench.draw.kept_mesh import surface_methods
from bench.draw.shots import shots_of
from bench.draw.thread import on_drawing_thread
from bench.draw.value_colours import HEIGHT, WORDS, column_of, no_column, scale_of
from bench.running.work import load_renderer
from data_prep.clouds.normalise import numbers_in, placed_points, real_points, unmasked_rows
from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.files.cloud_contents import (
    NoColumn,
    NotACloud,
    PointColors,
    axis_columns,
    color_columns,
    colors_of,
    column_index,
)
from data_prep.files.pinholes import Pinholes, pinholes_of, read_pinholes
from data_prep.files.safe_read import shown
from data_prep.rendering.camera import farthest_depth
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import IMAGE_SIZE, Mesh, View

# The most images of a turntable: one every tenth of a degree. At 128 x 128 pixels they take 180 MB.
_MOST_FRAMES = 3_600
# The most pixels in all images of a turntable together: 64 images of 2048 x 2048 take 800 MB.
_MOST_PIXELS = 2**28
# Notes on files name options of the command line: what stands for them in calls from Python.
_SPELT = {
    "--drop-invalid": "drop_invalid=True",
    "--drop-far": "drop_far=True",
    "--colour file": 'colour="file"',
    "--colour grey": 'colour="grey"',
    "--up z": 'up="z"',
    "--up y": 'up="y"',
    "; --points takes another number": "",
    "; --method draws from": "; method= draws from",
}


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """Maps of the surface that a method has reconstructed, as seen in an image.

    Attributes
    ----------
    depth : ndarray
        float32 [size, size]: the distance from the camera along its axis, in unit-sphere units (the
        centre is 4 away), as a mean over the samples of a pixel; infinite where a pixel shows no
        surface.
    mask : ndarray
        float32 [size, size]: the share of a pixel that the surface covers, 0 to 1.
    normals : ndarray
        float32 [size, size, 3]: the mean normal of the surface in a pixel, in the camera's frame
        with +X to the right, +Y up and +Z to the camera; 0 where a pixel shows no surface.
    """

    depth: NDArray[np.float32]
    mask: NDArray[np.float32]
    normals: NDArray[np.float32]


def _draw(
    points: ArrayLike | Path,
    views: Sequence[View],
    pinholes: Pinholes | None = None,
    *,
    up: str = "y",
    front: str | None = None,
    method: str | None = None,
    colour: str = "auto",
    colors: ArrayLike | None = None,
    budget_ms: float | None = None,
    drop_far: bool = False,
    device: str = "auto",
    size: int = IMAGE_SIZE,
    background: Background = "white",
    drop_invalid: bool = False,
    columns: Sequence[int | str] | None = None,
) -> tuple[Drawing, DrawnViews]:
    """Draw on the drawing thread, and give all notes as warnings, even where drawing fails.

    The options are those of `draw_cloud`, which states the errors that are raised.
    """
    if not isinstance(method, str | None):
        raise BadInput(f"method {method!r}: must be the id of one method")
    is_number = isinstance(budget_ms, int | float) and not isinstance(budget_ms, bool)
    if budget_ms is not None and not (is_number and not math.isnan(budget_ms)):
        raise BadInput(f"budget_ms {budget_ms!r}: must be a number of milliseconds")
    if not isinstance(colour, str):
        words = ", ".join(WORDS)
        raise BadInput(f"colour {colour!r}: must be {words}, {HEIGHT} or the name of a column")
    notes: list[str] = []
    of_points = "grey" if colour == "invented" else colour

    def load_and_draw() -> tuple[Drawing, DrawnViews]:
        named = () if method is None else (method,)
        (method_id,) = methods_to_draw(named, colour == "invented", budget_ms)
        find_method(method_id)
        check_colour(method_id, colour)
        turned = None
        if pinholes is not None:
            check_camera(method_id)
            turned = pinholes.turned(up, front)
        # As in `bench render`, a mesh is drawn itself where nothing else asks for points of it.
        by_default = method is budget_ms is None and not drop_far
        drawing = Drawing(
            method_id,
            tuple(views),
            device=device,
            size=size,
            background=background,
            pinholes=turned,
            budget_ms=budget_ms,
            of_mesh=method_of_mesh(colour) if by_default else None,
        )
        if len(views) * size**2 > _MOST_PIXELS:
            raise BadInput(
                f"size {size}: at most {int((_MOST_PIXELS / len(views)) ** 0.5)} with "
                f"{len(views)} images; give a smaller size, or fewer images"
            )
        of_rows = {"drop_far": drop_far, "drop_invalid": drop_invalid}
        loaded = loaded_cloud(points, of_points, columns, colors, up=up, front=front, **of_rows)
        drawing, on_points = suited(drawing, loaded)
        notes.extend(on_points)
        notes.extend(notes_on_methods((drawing.method,)))
        shots = None
        if turned is not None:
            shots = shots_of(turned, loaded.cloud, loaded.place_for(drawing.method))
        elif budget_ms is None:
            notes.extend(notes_on_size((drawing.method,), size))
        renderer = load_renderer(drawing.method, device)
        drawn = draw_views(renderer, loaded.cloud, drawing, shots)
        notes.extend(drawn.notes)
        return drawing, drawn

    try:
        return on_drawing_thread(load_and_draw)
    finally:
        warn(notes, levels=3)  # at the line that calls `draw_cloud` or `turntable`


OPTIONS = tuple(inspect.signature(_draw).parameters)[3:]  # the names of all but points and cameras


def loaded_cloud(
    points: ArrayLike | Path,
    colour: str,
    columns: Sequence[int | str] | None,
    colors: ArrayLike | None,
    **options: Any,
) -> LoadedCloud:
    """Return points, or those of a file, with their colours; all arguments are of `draw_cloud`."""
    if isinstance(points, str | Path):
        if columns is not None or colors is not None:
            given = "colors" if columns is None else "columns"
            raise BadInput(
                f"{points}: {given}= is for arrays; leave it out, and name the columns of a file "
                "in its first line"
            )
        return _cloud_of_file(points, colour, **options)
    table: Any = points
    if hasattr(table, "to_pandas"):  # of Arrow or Polars: the names of its columns count
        table = table.to_pandas()
    loaded = _cloud_of_array(table, columns, colour=colour, colors=colors, **options)
    if colour == "file" and loaded.cloud.colors is None:
        raise BadInput('points: no colours of them; give colors=, or leave out "file"')
    return loaded


def _cloud_of_file(
    file: str | Path,
    colours: str,
    *,
    up: str,
    front: str | None,
    drop_far: bool = False,
    drop_invalid: bool = False,
) -> LoadedCloud:
    path = Path(file)
    if path.is_dir():
        raise BadInput(f"{path}: is a folder; give a file of points or of a mesh")
    as_asked = CloudFile(
        path,
        as_is=False,
        up=up,
        front=front,
        drop_invalid=drop_invalid,
        drop_far=drop_far,
        colours=colours,
        up_unknown=up == "y",  # "y" is the default, which the caller may not have thought about
    )
    try:
        loaded = as_asked.load_all()
    except BadInput as error:
        raise BadInput(_in_python(str(error))) from error
    notes, mesh_notes = (tuple(map(_in_python, n)) for n in (loaded.notes, loaded.mesh_notes))
    return replace(loaded, notes=notes, mesh_notes=mesh_notes)


def _cloud_of_array(
    points: ArrayLike,
    columns: Sequence[int | str] | None,
    *,
    up: str,
    front: str | None,
    drop_far: bool = False,
    drop_invalid: bool = False,
    colour: str,
    colors: ArrayLike | None,
) -> LoadedCloud:
    chosen, notes = _three_columns(points, columns)
    values = real_points(chosen)
    inks, numbers = None, _numbers_of_colour(points, colour, colors)
    if numbers is not None:
        numbers = numbers._replace(values=_of_points(numbers.values, chosen, len(values)))
    elif colour == HEIGHT:
        numbers = _Numbers(HEIGHT, upright(values, up, front)[:, 1])
    elif colour != "grey":
        inks = _colours_of_array(points, colors)
        inks = None if inks is None else _of_points(inks, chosen, len(values))
    kept = np.arange(len(values))
    broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
    count = f"{len(broken)} of {len(values)} points"
    if len(broken) and not drop_invalid:
        raise BadInput(
            f"{count} are not finite (the first is row {broken[0]}, from 0); remove them, or "
            "leave them out with drop_invalid=True"
        )
    if len(broken):
        kept = np.delete(kept, broken)
        notes = (*notes, f"{count} are left out, they are not finite")
    far, of_far = far_with_notes(values[kept], drop_far, "drop_far=True")
    if drop_far:
        kept = kept[~far]
    cloud, place = placed_points(upright(values[kept], up, front))
    if numbers is not None:
        scale, on_values = scale_of(numbers.name, numbers.values[kept], _labels(points))
        cloud = replace(cloud, colors=scale.colors(numbers.values[kept]))
        notes = (*notes, *on_values)
    elif inks is not None:
        cloud = replace(cloud, colors=inks[kept])
    return LoadedCloud(cloud, (*notes, *of_far), place)


def _of_points(given: NDArray[Any], points: ArrayLike, count: int) -> NDArray[Any]:
    """Return what is given for each of the points, without the rows of masked points.

    count  of the points that are not masked

    Raises BadInput for another number of rows.
    """
    unmasked = unmasked_rows(points)
    rows = count if unmasked is None else len(numbers_in(points))
    if len(given) != rows:
        raise BadInput(f"colors: {len(given)} rows for {rows} points; give a colour for each point")
    return given if unmasked is None else given[unmasked]


def _labels(points: Any) -> list[str]:
    """Return the names of columns of a DataFrame; none for an array."""
    return [label for label in getattr(points, "columns", ()) if isinstance(label, str)]


class _Numbers(NamedTuple):
    """A number for each point, float64 [N], by which it is coloured, and what it is called."""

    name: str
    values: NDArray[np.float64]


def _numbers_of_colour(points: Any, colour: str, colors: ArrayLike | None) -> _Numbers | None:
    """Return the column of a DataFrame that `colour` names, or `colors` with one number a point.

    None for other colours. Raises BadInput for a column that is not there, or no real numbers.
    """
    if not column_of(colour):
        if colour in ("grey", HEIGHT) or colors is None:
            return None
        if np.ma.is_masked(colors):
            raise BadInput("colors: some are masked; give a colour for each point")
        numbers = numbers_in(colors)
        if numbers.ndim != 1 or numbers.dtype.kind not in "fiu":
            return None
        return _Numbers("colors", numbers.astype(np.float64))
    labels = _labels(points)
    try:
        label = labels[column_index(labels, colour)]
    except NoColumn as error:
        raise BadInput(f"points: {no_column(colour, error.names)}") from None
    numbers = numbers_in(points[[label]])[:, 0]
    if numbers.dtype.kind not in "fiu":
        raise BadInput(f"points: column {shown(label)} holds no real numbers; give another one")
    return _Numbers(colour, numbers.astype(np.float64))


def _colours_of_array(points: Any, colors: ArrayLike | None) -> PointColors | None:
    """Return the colours uint8 [N, 3] of points: those given, else columns of a DataFrame.

    Raises BadInput for values that are no colours.
    """
    source: Any = points if colors is None else colors
    labels = _labels(source)
    named = color_columns([label.lower() for label in labels])
    if colors is None and not named:
        return None
    values = numbers_in(source[[labels[i] for i in named]] if named else source)
    if values.dtype.kind not in "fiu" or values.ndim != 2 or values.shape[1] != 3:
        raise BadInput(
            f"colors: {values.dtype} of shape {list(values.shape)}; give real numbers [N, 3], of "
            "0 to 255 or of 0 to 1"
        )
    try:
        return colors_of(values, whole=values.dtype.kind in "iu")
    except NotACloud as problem:
        raise BadInput(f"colors: {str(problem).removeprefix('its colours ')}") from None


def _maps_of(drawing: Drawing, drawn: DrawnViews) -> SurfaceMaps:
    """Return maps of the method's surface in the first view.

    Raises BadInput for a method that makes no surface.
    """
    mesh = getattr(drawn.state, "mesh", None)
    if not isinstance(mesh, Mesh):
        raise BadInput(
            f"method '{drawing.method}' makes no surface, so that there are no maps of it; give "
            f"method= one of {surface_methods()}, or leave out return_maps"
        )
    maps = partial(surface_maps, mesh, drawing.views[:1], drawing.size, limited=False)
    ((mask, nearness, *normal),) = on_drawing_thread(maps)
    depth = np.where(mask > 0, farthest_depth(drawing.views[0]) - 2 * nearness, np.float32(np.inf))
    return SurfaceMaps(depth, mask, np.stack(normal, axis=-1))


def _in_python(text: str) -> str:
    for option, spelt in _SPELT.items():
        text = text.replace(option, spelt)
    return text


def _three_columns(points: Any, columns: Sequence[int | str] | None) -> tuple[ArrayLike, Notes]:
    """Return the columns of x, y and z, with a note where others are left out by default."""
    labels = _labels(points)
    is_array = hasattr(points, "shape") and (labels or not hasattr(points, "columns"))
    given = points if is_array else cast("Any", np.asarray(points))
    if columns is not None:
        try:
            some = list(columns)
            chosen = points[some] if labels else given[:, some]
        except (LookupError, TypeError, ValueError) as error:
            raise BadInput(
                f"columns {columns!r}: not in points of shape {list(given.shape)}; give the "
                "numbers of three columns, counted from 0, or three names of a DataFrame"
            ) from error
        return chosen, ()
    if axes := axis_columns(labels):
        return points[[labels[i] for i in axes]], ()
    if not all(map(str.isdigit, labels)):
        raise BadInput(
            f"points: columns {shown(', '.join(labels))}; name three of them x, y and z, or "
            "choose three with columns="
        )
    if not labels and len(given.shape) == 2 and given.shape[1] == 6:
        return given[:, :3], (
            "points: columns 3 to 5 of [N, 6] are not used; give colours as colors=points[:, 3:]",
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
    camera: str | Path | Mapping[str, Any] | None = None,
    **options: Any,
) -> Any:
    """Return an image of points in any units, as `bench render` draws it.

    The method runs in this process, where a native library may crash or hang; the default is a
    network. Its weights are read once a process. Any thread may call this; draws are done one after
    the other, in a thread of their own.

    A UserWarning tells of each of these: what the method did to the points (used fewer of them,
    smoothed them, made no mesh), a method that was trained on chairs alone, images that are
    resampled, columns that are not used, points far from the others, and coordinates that lie in
    coarse steps.

    Parameters
    ----------
    points : array_like or path
        Real numbers [N, 3], or [N, 6] of which the first three columns are used; rows with masked
        values are left out, with a warning. Or a DataFrame with columns named x, y and z. Or the
        path of a file of points or of a mesh, as `bench render` reads it.
    azimuth_deg : float
        0 is the front, 90 the side of +X (see `data_prep.scene`).
    elevation_deg : float
        -90..90; the networks were trained within -40..40.
    return_maps : bool
        Whether to return the depth, mask and normals of the method's surface as well.
    camera : path or dict
        One pinhole camera in the coordinates of the points, in place of the angles and the size: a
        file that Open3D or a converter of COLMAP has written, or a dict of the same contents. The
        image has its width and height. `docs/rendering.md` has the formats.
    up, front : str
        Axes of the points that point up and to the front, such as "z" or "-x". The default is "y",
        with the front "-z", or "-y" where z is up.
    method : str
        Id of a method, see `bench list`. By default the best one within the budget, or without a
        budget one that knows objects of 13 classes; a mesh in a file is drawn itself.
    colour : str
        "auto": in the colours of the points where they have any, the default; "file": in these, or
        an error; "grey"; "invented", in colours that a network makes up; "height", along `up`; or
        the name of a column of a DataFrame or a file. Methods that draw in grey get the colours of
        the points.
    colors : array_like
        Colours of an array of points, [N, 3]: 0 to 255, or fractions to 1; or a number for each,
        [N], which a map of colours shows. Of a DataFrame by default the columns named red, green
        and blue; of a file its own.
    budget_ms : float
        The most milliseconds that one image of a new cloud of so many points may take, by costs
        measured on one machine.
    drop_far : bool
        Whether to leave out points far from all others, which make the object small; else a
        warning tells of them, the default.
    device : str
        "auto", "cpu" or "cuda", for networks.
    size : int
        Side of the images in pixels, 16 to 2048; the default is 128. Surfaces and discs are drawn
        at that size, and details by fused-net; images of other networks are resampled to it, and a
        warning says so.
    background : str
        "white", or "transparent", with the opacity as a fourth channel.
    drop_invalid : bool
        Whether to leave out points that are not finite, with a warning; else they are refused, the
        default.
    columns : sequence
        The columns of x, y and z: their numbers in an array, counted from 0, or their names in a
        DataFrame. By default the only three columns, the first three of six, or those named x, y
        and z.

    Returns
    -------
    ndarray, or ndarray and SurfaceMaps
        uint8 [size, size, 3] on white, or [size, size, 4]; with `return_maps` also the maps. By a
        `camera` it is [height, width, 3] or [height, width, 4].

    Raises
    ------
    data_prep.failures.BadInput
        For a cloud without points, without extent or with points that are not finite, for a file
        that is no cloud, for an unknown axis, method, size, background or column, for unusable
        weights, for a budget below the cheapest method, for a method with a budget, for maps
        of a method that makes no surface, and for a camera that is no pinhole, sees no point, or is
        given beside angles, a size or maps. It is a ValueError.
    ValueError
        For `points` that are no array [N, 3] of real numbers, and for an angle out of its range.
    TypeError
        For an unknown option.
    data_prep.failures.StageFailure
        Where the method cannot draw this cloud.
    """
    _check_options("draw_cloud", "azimuth_deg", options)
    if camera is not None:
        beside = "size" if "size" in options else "return_maps" if return_maps else None
        if (azimuth_deg, elevation_deg) != (30.0, 20.0):
            beside = "angles"
        return _draw(points, [], _one_camera(camera, beside), **options)[1].images[0]
    drawing, drawn = _draw(points, [View(azimuth_deg, elevation_deg)], **options)
    if return_maps:
        return drawn.images[0], _maps_of(drawing, drawn)
    return drawn.images[0]


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
        Number of images, 1 to 3600; the first has azimuth 0. At larger sizes fewer: all together
        have at most 2^28 pixels.

    Returns
    -------
    ndarray
        uint8 [frames, size, size, 3] on white, or [frames, size, size, 4].

    Raises
    ------
    ValueError, data_prep.failures.StageFailure
        As in `draw_cloud`, and for other numbers of frames, or too many for their size.
    """
    whole = isinstance(frames, Integral) and not isinstance(frames, bool)
    if not whole or not 1 <= frames <= _MOST_FRAMES:
        raise ValueError(f"frames must be a whole number from 1 to {_MOST_FRAMES}, got {frames!r}")
    views = [View(360 * i / frames, elevation_deg) for i in range(frames)]
    _check_options("turntable", "frames", options)
    _, drawn = _draw(points, views, **options)
    return drawn.images


def _one_camera(camera: str | Path | Mapping[str, Any], beside: str | None) -> Pinholes:
    """Return the camera of a file or dict. Raises BadInput where it is none, or not a single one.

    beside  what else is given, which a camera replaces; None for nothing
    """
    if beside is not None:
        raise BadInput(f"{beside}: a camera has its own; leave out {beside}, or the camera")
    if isinstance(camera, Mapping):
        pinholes = pinholes_of(camera, "the dict", ANY_SIZE)
    else:
        pinholes = read_pinholes(Path(camera), ANY_SIZE)
    if len(pinholes.names) > 1:
        raise BadInput(
            f"{pinholes.source}: {len(pinholes.names)} cameras; give a dict with one of them, or "
            "draw all with 'bench render --camera'"
        )
    return pinholes


def _check_options(caller: str, first: str, options: Mapping[str, Any]) -> None:
    """Raise TypeError for an option that the function `caller` does not have.

    first  the name of its first parameter after the points, for the message
    """
    if unknown := ", ".join(options.keys() - {*OPTIONS}):
        raise TypeError(
            f"{caller}: no option {unknown}; there are {first}, elevation_deg, {', '.join(OPTIONS)}"
        )
