"""Images of a cloud in a file, by any method.

Files and methods are not trusted, so that a worker process reads the file and draws.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import ANY_SIZE, find_method
from bench.catalogue.suites import Limits
from bench.draw.choice import Notes, check_source, notes_on_size, within_budget
from bench.draw.cloud_file import CloudFile, LoadedCloud, check_count
from bench.draw.finish import enlarged, resized, without_background
from bench.draw.kept_mesh import keep_mesh
from bench.draw.shots import Shots, shots_of
from bench.draw.thread import on_drawing_thread, one_pool
from bench.running.colours import COLOUR_FAMILY, Keeper, coverage_of, in_colours, is_painted
from bench.running.pool import WorkerFailure, run_tasks
from bench.running.work import draw, load_renderer, reason_of
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.pinholes import Pinholes
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import (
    IMAGE_SIZE,
    AnyView,
    PointCloud,
    Renderer,
    UInt8Images,
    View,
)

_MOST_PIXELS = 2**24  # the most pixels that a method draws in one call: 200 MB as float32
# The limits for one cloud by one method. A user is waiting, and the slowest method takes half a
# minute for 100,000 points.
LIMITS = Limits(time_s=120.0, memory_gib=4.0)
Background = Literal["white", "transparent"]


@dataclass(frozen=True, eq=False)
class Drawing:
    """A request for views of a cloud by a method.

    Attributes
    ----------
    method : str
        Id of a method, see `bench list`.
    views : tuple of View or Camera
        The views, in the order of the images.
    device : str
        "auto", "cpu" or "cuda", for networks.
    batch : int or None
        Number of views that are drawn in one call; None for all.
    rng : Generator or None
        Random numbers for the method; None for those of `bench render`, the same each time.
    size : int
        Side of the images in pixels, 16 to 2048. A method that cannot draw this size
        (`bench.catalogue.methods.Method.sizes`) draws another one, and its images are resampled.
    background : str
        "white"; or "transparent", for images uint8 [V, size, size, 4] whose last channel is their
        opacity.
    budget_ms : float or None
        For a file, milliseconds for an image that choose the method by the number of its points, in
        place of `method`.
    pinholes : Pinholes or None
        Cameras of a file in the place of views, turned as the points are. Their images have the
        width and height of the file, in the place of `size`.
    of_mesh : str or None
        Id of the method that draws instead where a file holds a mesh; None for `method`.
    keep_mesh : Path or None
        A PLY into which the surface is written that the method makes of a file; None for none.

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown device or background, for a size or batch out of range, and without views.
    """

    method: str
    views: tuple[AnyView, ...]
    device: str = "auto"
    batch: int | None = None
    rng: np.random.Generator | None = None
    size: int = IMAGE_SIZE
    background: Background = "white"
    budget_ms: float | None = None
    pinholes: Pinholes | None = None
    of_mesh: str | None = None
    keep_mesh: Path | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.size, int | np.integer) or self.size not in ANY_SIZE:
            raise BadInput(
                f"size {self.size!r}: must be a whole number, {ANY_SIZE[0]} to {ANY_SIZE[-1]}"
            )
        if not self.views and self.pinholes is None:
            raise BadInput("views: there are none; give at least one View")
        for view in self.views:
            if not isinstance(view, AnyView):
                raise BadInput(
                    f"views: {view!r} is no View; give a tuple of View(azimuth, elevation)"
                )
        check_count("batch", self.batch)
        if self.device not in ("auto", "cpu", "cuda"):
            raise BadInput(f"device {self.device!r}: must be auto, cpu or cuda")
        if self.background not in get_args(Background):
            raise BadInput(f"background {self.background!r}: must be white or transparent")


@dataclass(frozen=True, eq=False)
class Dots:
    """A request for images of the points themselves."""

    views: tuple[View, ...]


Wanted = Drawing | Dots


@dataclass(frozen=True)
class Failed:
    """A failure in place of images.

    Attributes
    ----------
    reason : str
        The stage of the method, or the exception, and the problem.
    """

    reason: str


Drawn = UInt8Images | Failed | BadInput


def draw_file(file: CloudFile, drawing: Drawing, limits: Limits = LIMITS) -> UInt8Images | Failed:
    """Return images of the cloud in a file, drawn in a worker process.

    Parameters
    ----------
    file : CloudFile
        The file, which the worker reads.
    drawing : Drawing
        The method and the views.
    limits : Limits
        Time and memory after which the worker is killed.

    Returns
    -------
    ndarray or Failed
        uint8 [views, size, size, 3 or 4]; or the failure of the method, or of its worker.

    Raises
    ------
    data_prep.failures.BadInput
        For a file that cannot be used, and for an unknown or unusable method.
    """
    with one_pool():
        ((_, _, drawn, notes),) = draw_each([file], [drawing], 1, limits)
    if isinstance(drawn, BadInput):
        raise drawn
    warn(notes, levels=2)
    return drawn


def draw_each(
    files: Iterable[CloudFile], requests: Sequence[Wanted], workers: int, limits: Limits = LIMITS
) -> Iterator[tuple[CloudFile, Wanted, Drawn, Notes]]:
    """Yield for each file and each request the images and the notes, in the order of completion.

    A request with a method for meshes is yielded with that as its method where it has drawn. For a
    file that cannot be used, a BadInput stands in place of images. Each pair of file and
    request is a task; each worker loads a method once. Of several requests the file is read once,
    by a task of its own, which hands the cloud on. Raises BadInput for an unusable method before
    anything is drawn.
    """
    for wanted in requests:
        if isinstance(wanted, Drawing):
            find_method(wanted.method)
    read: deque[LoadedCloud | None] = deque()  # the cloud of the last file; None for no cloud

    def tasks() -> Iterator[_Task | None]:
        for file in files:
            if len(requests) == 1:
                yield _Task(file, requests[0])
                continue
            yield _Task(file)
            while not read:
                yield None  # until the file has been read
            if loaded := read.pop():
                yield from (_Task(file, wanted, loaded) for wanted in requests)

    for task, result in run_tasks(tasks(), _read_or_draw, workers, limits):
        if task.wanted is None:
            read.append(result if isinstance(result, LoadedCloud) else None)
        if isinstance(result, LoadedCloud):
            continue
        if isinstance(result, WorkerFailure):
            result = _Done(Failed(result.reason))
        for wanted in requests if task.wanted is None else (task.wanted,):
            if result.method is not None:
                wanted = replace(wanted, method=result.method)
            yield task.file, wanted, result.drawn, result.notes


def draw_in_process(cloud: PointCloud, drawing: Drawing) -> UInt8Images | Failed:
    """Return images of a cloud, drawn in this process.

    Parameters
    ----------
    cloud : PointCloud
        Points float32 [N, 3], in unit-sphere coordinates, and their colours if they are to be
        drawn.
    drawing : Drawing
        The method and the views.

    Returns
    -------
    ndarray or Failed
        uint8 [views, size, size, 3 or 4], or the failure of the method.

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown method, and for one that cannot be loaded.
    """
    drawn = on_drawing_thread(partial(_draw, cloud, drawing))
    if isinstance(drawn, Failed):
        return drawn
    warn(drawn.notes, levels=2)
    return drawn.images


def warn(notes: Sequence[str], levels: int) -> None:
    """Warn of each note once.

    levels  the number of calls between this function and the line that warnings point to
    """
    for note in dict.fromkeys(notes):
        warnings.warn(note, stacklevel=levels + 1)


def _draw(cloud: PointCloud, drawing: Drawing, shots: Shots | None = None) -> DrawnViews | Failed:
    renderer: Renderer | None = None
    try:
        renderer = load_renderer(drawing.method, drawing.device)
        return draw_views(renderer, cloud, drawing, shots)
    except MissingDependency:
        raise
    except (Exception, SystemExit) as error:
        if renderer is None and isinstance(error, BadInput):  # for example, unusable weights
            raise
        return Failed(reason_of(error))


def suited(drawing: Drawing, loaded: LoadedCloud, where: str = "") -> tuple[Drawing, Notes]:
    """Return the request with the method that suits a cloud, and notes on the cloud.

    That is the method for meshes where there is a mesh, or the one that a budget chooses for so
    many points.

    where  begins the note on what a budget chose, as it does those of a file

    Raises BadInput for a method that draws a mesh where there is none, and for a budget that no
    method meets.
    """
    of_choice: Notes = ()
    if loaded.cloud.source is not None and drawing.of_mesh is not None:
        drawing = replace(drawing, method=drawing.of_mesh)
    elif drawing.budget_ms is not None:
        method_id, note = within_budget(drawing.budget_ms, len(loaded.cloud))
        drawing = replace(drawing, method=method_id)
        of_choice = (note,)
        if drawing.pinholes is None:
            of_choice += notes_on_size((method_id,), drawing.size)
    method = find_method(drawing.method)
    check_source(method, loaded.cloud)
    of_file = loaded.mesh_notes if method.sees_mesh else loaded.notes
    return drawing, (*of_file, *(f"{where}{note}" for note in of_choice))


@dataclass(frozen=True, eq=False)
class DrawnViews:
    """The images that a method has drawn of a cloud.

    images  uint8 [V, size, size, 3 or 4]
    state   what the method made of the cloud before it drew, such as a reconstructed surface
    notes   lines on what it did to the points
    """

    images: NDArray[np.uint8]
    state: Any
    notes: Notes


def draw_views(
    renderer: Renderer, cloud: PointCloud, drawing: Drawing, shots: Shots | None = None
) -> DrawnViews:
    """Draw a cloud with the method's renderer. Raises whatever the method raises.

    The images are in the colours of the cloud where it has some and the method draws in grey.

    shots  those of `drawing.pinholes`, in place of its views
    """
    if shots is not None:
        parts = replace(drawing, views=shots.cameras, size=shots.size, pinholes=None)
        drawn_parts = draw_views(renderer, cloud, parts)
        notes = (*notes_on_size((drawing.method,), shots.size), *drawn_parts.notes)
        return DrawnViews(shots.whole(drawn_parts.images), drawn_parts.state, notes)
    method, rng = find_method(drawing.method), drawing.rng or generator("render")
    side, keeper = method.drawn_at(drawing.size), Keeper(renderer)
    batch = drawing.batch or max(1, _MOST_PIXELS // side**2)
    # Methods that know views alone are refused where cameras are given (`check_camera`).
    views = cast("tuple[View, ...]", drawing.views)
    drawn = draw(method, keeper, cloud, views, rng, batch, side=side).images
    notes = tuple(f"{method.id}: {note}" for note in getattr(keeper.state, "notes", ()))
    painted = is_painted(method, cloud)
    of_points = painted or method.family == COLOUR_FAMILY or method.sees_mesh
    if cloud.colors is not None and not of_points:
        notes += (f"{method.id}: draws in colours of its own; those of the points are not used",)
    transparent = drawing.background == "transparent"
    if not painted and not transparent:
        return DrawnViews(resized(drawn, drawing.size), keeper.state, notes)
    shares, guessed = coverage_of(keeper, method, drawn, drawing.views, batch)
    notes += guessed
    if painted:  # at the size that is asked for, at which colours are sharper than the shading
        drawn = resized(drawn, drawing.size)
        shares = np.stack([enlarged(share, drawing.size).clip(0, 1) for share in shares])
        drawn = in_colours(drawn, shares, cloud, drawing.views)
    if transparent:
        return DrawnViews(without_background(drawn, shares, drawing.size), keeper.state, notes)
    return DrawnViews(resized(drawn, drawing.size), keeper.state, notes)


class _Task(NamedTuple):
    """A task of a worker: to read a file, to draw its cloud, or both.

    wanted  the images to draw; None to return the cloud
    loaded  the cloud, where it has been read; None to read it
    """

    file: CloudFile
    wanted: Wanted | None = None
    loaded: LoadedCloud | None = None


class _Done(NamedTuple):
    """The images that a worker has drawn, with notes.

    method  the method that drew in place of the one in the request; None for that one
    """

    drawn: Drawn
    notes: Notes = ()
    method: str | None = None


def _read_or_draw(task: _Task) -> LoadedCloud | _Done:
    file, wanted, loaded = task
    if loaded is None:
        try:
            loaded = file.load_all()
        except BadInput as error:
            return _Done(error)
    if wanted is None:
        return loaded
    if isinstance(wanted, Dots):
        return _Done(draw_dots(loaded.cloud.points, wanted.views), loaded.notes)
    shots = None
    try:
        drawing, of_file = suited(wanted, loaded, f"{file.path}: ")
        if drawing.pinholes is not None:
            shots = shots_of(drawing.pinholes, loaded.cloud, loaded.place_for(drawing.method))
    except BadInput as error:
        return _Done(BadInput(f"{file.path}: {error}"))
    other = None if drawing.method == wanted.method else drawing.method
    drawn = _draw(loaded.cloud, drawing, shots)
    if isinstance(drawn, Failed):
        return _Done(drawn, of_file, other)
    if drawing.keep_mesh is not None:
        try:
            keep_mesh(drawing.keep_mesh, file.path, loaded, drawing.method, drawn.state)
        except BadInput as error:
            return _Done(error)
    notes = (*of_file, *(f"{file.path}: {note}" for note in drawn.notes))
    return _Done(drawn.images, notes, other)
