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
from bench.draw.choice import COLOUR_METHOD, Notes, find_drawer
from bench.draw.colours import in_colours
from bench.draw.finish import enlarged, guessed_coverage, resized, without_background
from bench.draw.orientation_hints import looks_like_a_line, looks_lying
from bench.draw.thread import on_drawing_thread, one_pool
from bench.running.pool import WorkerFailure, run_tasks
from bench.running.work import draw, load_renderer, reason_of
from data_prep.clouds.coarse_steps import note_on_steps
from data_prep.clouds.far_points import far_points, note_on_far
from data_prep.clouds.normalise import normalise_points
from data_prep.clouds.orientations import upright
from data_prep.clouds.sampling import random_rows, sample_faces
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.cloud_contents import CloudContents
from data_prep.files.cloud_text import GUESSED
from data_prep.files.clouds import read_cloud
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import (
    CLOUD_SIZE,
    IMAGE_SIZE,
    Images,
    PointCloud,
    Renderer,
    UInt8Images,
    View,
)

_Z_UP = (".las", ".laz", ".e57")  # suffixes of the formats of surveys, in which z is the height
# Where each kind of file has its colours, for the message on a file without them.
_WHERE_COLOURS = (
    "a PLY has red, green and blue, a text six columns or r, g and b in its first line, an array "
    "[N, 6]; or draw without --colour file"
)
_MOST_PIXELS = 2**24  # the most pixels that a method draws in one call: 200 MB as float32
# The limits for one cloud by one method. A user is waiting, and the slowest method takes half a
# minute for 100,000 points.
LIMITS = Limits(time_s=120.0, memory_gib=4.0)
Background = Literal["white", "transparent"]
FileColours = Literal["auto", "file", "grey"]


def _check_count(name: str, count: int | None) -> None:
    """Raise BadInput for a number of things that is no whole number from 1, and not None."""
    whole = isinstance(count, int | np.integer) and not isinstance(count, bool)
    if count is not None and not (whole and count >= 1):
        raise BadInput(f"{name} {count!r}: must be a whole number from 1, or None")


@dataclass(frozen=True)
class CloudFile:
    """A file with points, and how they become a cloud.

    Attributes
    ----------
    path : Path
        The file; its suffix names the format.
    as_is : bool
        Whether to keep the units of the file (in float32); else points are brought to the unit
        sphere.
    up, front : str
        Axes of the file, see `data_prep.clouds.orientations.upright`.
    most : int or None
        Largest number of points; of more points, as many are chosen at random, the same each time.
        None keeps all.
    drop_invalid : bool
        Whether to leave out points that are not finite; else they are refused, unless `as_is`.
    drop_far : bool
        Whether to leave out points far from all others; else a note tells of them, unless `as_is`.
    colours : str
        "auto": the cloud has the colours of its points where the file has any; "file": a file
        without them is refused; "grey": they are not read.
    up_unknown : bool
        Whether `up` is a guess: then a note tells where the cloud looks as if z were up.

    Raises
    ------
    data_prep.failures.BadInput
        For a `most` that is no whole number from 1.
    """

    path: Path
    as_is: bool
    up: str = "y"
    front: str | None = None
    most: int | None = None
    drop_invalid: bool = False
    drop_far: bool = False
    colours: FileColours = "auto"
    up_unknown: bool = False

    def __post_init__(self) -> None:
        _check_count("most", self.most)

    def load(self) -> PointCloud:
        """Return the cloud.

        Raises
        ------
        data_prep.failures.BadInput
            For a file without a cloud, and for a cloud that cannot be brought to the unit sphere.
        """
        return self.load_all().cloud

    def load_with_notes(self) -> tuple[PointCloud, Notes]:
        """Return the cloud as `load` does, and a note on each part of the file that is left out."""
        loaded = self.load_all()
        return loaded.cloud, loaded.notes

    def load_all(self) -> LoadedCloud:
        """Return the cloud as `load` does, and notes on the file."""
        contents, notes = self._contents()
        notes += self._notes_on_invalid(contents)
        if contents.is_mesh:
            contents = self._on_surface(contents, notes)
        if self.colours == "file" and contents.colors is None:
            raise BadInput(f"{self.path}: no colours of its points; {_WHERE_COLOURS}")
        notes = [*_unused(contents), *notes]
        points = upright(contents.points, self.up, self.front)
        kept = np.arange(len(points))
        if self.drop_invalid:
            kept = np.flatnonzero(np.isfinite(points).all(axis=1))
        far, of_far = far_with_notes(points[kept], self.drop_far, "--drop-far")
        if self.drop_far or not self.as_is:
            notes += of_far
        if self.drop_far:
            kept = kept[~far]
        if self.most is not None:
            kept = kept[random_rows(len(kept), self.most)]
        cloud = self._scaled(points[kept])
        notes += self._notes_on_shape(cloud, has_far=bool(far.any()) and not self.drop_far)
        if contents.colors is not None:
            cloud = replace(cloud, colors=contents.colors[kept])
        return LoadedCloud(cloud, tuple(f"{self.path}: {note}" for note in notes))

    def _contents(self) -> tuple[CloudContents, list[str]]:
        """Return the contents of the file, and notes on them.

        Raises BadInput for a file that cannot be used. Columns that are taken for colours and are
        none are left out with a note, unless colours have to be read.
        """
        if self.colours == "grey":
            contents = read_cloud(self.path)
            return contents, list(contents.notes)
        try:
            contents = read_cloud(self.path, with_colors=True)
            return contents, list(contents.notes)
        except BadInput as error:
            if self.colours == "file":
                raise
            contents = read_cloud(self.path)  # where it is not for its colours, this raises again
            reason = str(error).removeprefix(f"{self.path}: ")
            return contents, [*contents.notes, f"drawn without colours: {reason}"]

    def _notes_on_invalid(self, contents: CloudContents) -> Notes:
        """Return a note where points that are not finite are left out.

        Raises BadInput for such points unless they are left out (`drop_invalid`) or the cloud is
        kept as it is (`as_is`).
        """
        valid = np.asarray(np.isfinite(contents.points).all(axis=1))
        if valid.all():
            return ()
        count = f"{np.count_nonzero(~valid)} of {len(valid)} points"
        if self.drop_invalid:
            return (f"{count} are left out, they are not finite",)
        if self.as_is:
            return ()
        first, lines = int(np.flatnonzero(~valid)[0]), contents.lines
        where = f"is point {first + 1}" if lines is None else f"in line {lines[first]}"
        raise BadInput(
            f"{self.path}: {count} are not finite (the first {where}); remove them, or leave "
            "them out with --drop-invalid"
        )

    def _notes_on_shape(self, cloud: PointCloud, has_far: bool) -> Iterator[str]:
        """Yield a note where columns or axes of the file seem to be mistaken for others.

        has_far  whether some points are far from the rest; the rest is then so small in the cloud
                 that its shape tells nothing
        """
        if not has_far and looks_like_a_line(cloud):
            yield "its points lie on a line; check which columns are x, y and z"
        if self.up_unknown and (self.path.suffix.lower() in _Z_UP or looks_lying(cloud)):
            yield "its z axis seems to point up; give --up z, or --up y if it does not"

    def _on_surface(self, contents: CloudContents, notes: list[str]) -> CloudContents:
        """Return points sampled on the surface of a mesh in place of its vertices; add a note."""
        faces = cast("NDArray[np.int64]", contents.faces)
        whole = np.isfinite(contents.points[faces]).all(axis=(1, 2))
        count, rng = self.most or CLOUD_SIZE, generator("render", "surface")
        try:
            points, face, shares = sample_faces(contents.points[faces[whole]], rng, count)
        except BadInput:  # the faces have no area; the vertices are drawn
            return contents
        face = np.flatnonzero(whole)[face]
        colors = None if contents.face_colors is None else contents.face_colors[face]
        if contents.colors is not None:
            mixed = np.einsum("ij,ijk->ik", shares, contents.colors[faces[face]].astype(float))
            colors = np.rint(mixed).astype(np.uint8)
        notes.append(
            f"a mesh of {len(faces)} triangles: {count} points of its surface are drawn, not its "
            f"{len(contents.points)} vertices; --points takes another number"
        )
        notes += filter(None, [note_on_steps(contents.points)])
        unused = tuple(part for part in contents.unused if not part.endswith("faces"))
        return CloudContents(points, unused, None, contents.has_colors, colors)

    def _scaled(self, points: NDArray[np.float64]) -> PointCloud:
        if self.as_is:
            with np.errstate(over="ignore"):  # numbers too large for float32 become infinite
                return PointCloud(points.astype(np.float32))
        try:
            return normalise_points(points)
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from error


def far_with_notes(
    points: NDArray[np.float64], drop: bool, option: str
) -> tuple[NDArray[np.bool_], Notes]:
    """Return which points are far from the rest, bool [N], with notes on them.

    A further note tells of coordinates that lie in coarse steps.

    drop    whether the caller leaves the far points out, which the note then says
    option  the option that leaves them out, which the note names where `drop` is False
    """
    far = far_points(points)
    notes = [note_on_steps(points[~far])]
    if far.any() and drop:
        count = f"{np.count_nonzero(far)} of {len(far)} points"
        notes.insert(0, f"{count} are left out, they lie far from the rest")
    elif far.any():
        notes.insert(0, f"{note_on_far(points, far)}; {option} leaves them out")
    return far, tuple(filter(None, notes))


@dataclass(frozen=True, eq=False)
class LoadedCloud:
    """A cloud that was read from a file.

    cloud  the points, with their colours where these were asked for and the file has some
    notes  lines on what was left out or guessed
    """

    cloud: PointCloud
    notes: Notes


def _unused(contents: CloudContents) -> Iterator[str]:
    """Yield a note on each part of the contents that is not used."""
    for part in contents.unused:
        is_faces = part.endswith("faces")
        if contents.colors is not None and not is_faces:
            if part.endswith(GUESSED):  # colours that no line names are a guess, too
                yield f"{part}; its colours are a guess, too, which --colour grey leaves out"
            continue
        note = f"{part} are not used; only the coordinates of its points are"
        if is_faces:
            note += "; they make no surface of most of these"
        yield note


@dataclass(frozen=True, eq=False)
class Drawing:
    """A request for views of a cloud by a method.

    Attributes
    ----------
    method : str
        Id of a method, see `bench list`.
    views : tuple of View
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

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown device or background, for a size or batch out of range, and without views.
    """

    method: str
    views: tuple[View, ...]
    device: str = "auto"
    batch: int | None = None
    rng: np.random.Generator | None = None
    size: int = IMAGE_SIZE
    background: Background = "white"

    def __post_init__(self) -> None:
        if not isinstance(self.size, int | np.integer) or self.size not in ANY_SIZE:
            raise BadInput(
                f"size {self.size!r}: must be a whole number, {ANY_SIZE[0]} to {ANY_SIZE[-1]}"
            )
        if not self.views:
            raise BadInput("views: there are none; give at least one View")
        for view in self.views:
            if not isinstance(view, View):
                raise BadInput(
                    f"views: {view!r} is no View; give a tuple of View(azimuth, elevation)"
                )
        _check_count("batch", self.batch)
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

    For a file that cannot be used, a BadInput stands in place of images. Each pair of file and
    request is a task; each worker loads a method once. Of several requests the file is read once,
    by a task of its own, which hands the cloud on. Raises BadInput for an unusable method before
    anything is drawn.
    """
    for wanted in requests:
        if isinstance(wanted, Drawing):
            find_drawer(wanted.method)
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
        drawn, notes = (Failed(result.reason), ()) if isinstance(result, WorkerFailure) else result
        for wanted in requests if task.wanted is None else (task.wanted,):
            yield task.file, wanted, drawn, notes


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
    drawn, notes = on_drawing_thread(partial(_draw, cloud, drawing))
    warn(notes, levels=2)
    return drawn


def warn(notes: Sequence[str], levels: int) -> None:
    """Warn of each note once.

    levels  the number of calls between this function and the line that warnings point to
    """
    for note in dict.fromkeys(notes):
        warnings.warn(note, stacklevel=levels + 1)


def _draw(cloud: PointCloud, drawing: Drawing) -> tuple[UInt8Images | Failed, Notes]:
    renderer: Renderer | None = None
    try:
        renderer = load_renderer(drawing.method, drawing.device)
        drawn = draw_views(renderer, cloud, drawing)
        return drawn.images, drawn.notes
    except MissingDependency:
        raise
    except (Exception, SystemExit) as error:
        if renderer is None and isinstance(error, BadInput):  # for example, unusable weights
            raise
        return Failed(reason_of(error)), ()


class _Keeper:
    """A renderer that remembers what it made of the last cloud before it drew."""

    state: Any = None

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        self.state = self.renderer.prepare(cloud, rng)
        return self.state

    def draw(
        self, state: Any, views: Sequence[View], rng: np.random.Generator, **size: int
    ) -> Images:
        return self.renderer.draw(state, views, rng, **size)


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


def draw_views(renderer: Renderer, cloud: PointCloud, drawing: Drawing) -> DrawnViews:
    """Draw a cloud with the method's renderer. Raises whatever the method raises.

    The images are in the colours of the cloud where it has some and the method draws in grey.
    """
    method, rng = find_method(drawing.method), drawing.rng or generator("render")
    side, keeper = method.drawn_at(drawing.size), _Keeper(renderer)
    batch = drawing.batch or max(1, _MOST_PIXELS // side**2)
    drawn = draw(method, keeper, cloud, drawing.views, rng, batch, side=side).images
    notes = tuple(f"{method.id}: {note}" for note in getattr(keeper.state, "notes", ()))
    painted = cloud.colors is not None and method.id != COLOUR_METHOD
    if painted and method.color != "none":
        painted = False
        notes += (f"{method.id}: draws in colours of its own; those of the points are not used",)
    transparent = drawing.background == "transparent"
    if not painted and not transparent:
        return DrawnViews(resized(drawn, drawing.size), keeper.state, notes)
    coverage: Any = getattr(renderer, "coverage", None)
    if coverage is None:
        notes += (f"{method.id}: tells no opacity; it is guessed from how dark a pixel is",)
        shares = guessed_coverage(drawn)
    else:
        parts = []
        for first in range(0, len(drawing.views), batch):
            parts.append(coverage(keeper.state, drawing.views[first : first + batch], side))
        shares = np.concatenate(parts)
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


def _read_or_draw(task: _Task) -> LoadedCloud | tuple[Drawn, Notes]:
    file, wanted, loaded = task
    if loaded is None:
        try:
            loaded = file.load_all()
        except BadInput as error:
            return error, ()
    if wanted is None:
        return loaded
    if isinstance(wanted, Dots):
        return draw_dots(loaded.cloud.points, wanted.views), loaded.notes
    drawn, notes = _draw(loaded.cloud, wanted)
    return drawn, (*loaded.notes, *(f"{file.path}: {note}" for note in notes))
