"""Images of a cloud in a file, by any method, in a worker process: neither is trusted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.catalogue.methods import Method, find_method
from bench.catalogue.suites import Limits
from bench.running.isolation import WorkerFailure, run_tasks
from bench.running.work import draw, load_renderer, reason_of
from data_prep.clouds.normalise import normalise_points
from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.clouds import read_cloud
from data_prep.randomness import generator
from data_prep.rendering.dots import draw_dots
from data_prep.scene import PointCloud, Renderer, UInt8Images, View

LIMITS = Limits(time_s=120.0, memory_gib=4.0)
Notes = tuple[str, ...]  # a line for each part of a file that is left out


@dataclass(frozen=True)
class CloudFile:
    """A file with points, and the way in which they become a cloud.

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
    """

    path: Path
    as_is: bool
    up: str = "y"
    front: str | None = None
    most: int | None = None
    drop_invalid: bool = False

    def load(self) -> PointCloud:
        """Return the cloud.

        Raises
        ------
        data_prep.failures.BadInput
            For a file without a cloud, and for a cloud that cannot be brought to the unit sphere.
        """
        return self.load_with_notes()[0]

    def load_with_notes(self) -> tuple[PointCloud, Notes]:
        """Return the cloud as `load` does, and a note on each part of the file that is left out."""
        contents = read_cloud(self.path)
        notes = [
            f"{self.path}: {what} are not used; only the coordinates of its points are"
            for what in contents.unused
        ]
        points = upright(contents.points, self.up, self.front)
        invalid = ~np.isfinite(points).all(axis=1)
        count = f"{np.count_nonzero(invalid)} of {len(points)} points"
        if invalid.any() and self.drop_invalid:
            points = points[~invalid]
            notes.append(f"{self.path}: {count} are left out, they are not finite")
        elif invalid.any() and not self.as_is:
            first, lines = int(np.flatnonzero(invalid)[0]), contents.lines
            where = f"is point {first + 1}" if lines is None else f"in line {lines[first]}"
            raise BadInput(
                f"{self.path}: {count} are not finite (the first {where}); remove them, or leave "
                "them out with --drop-invalid"
            )
        if self.most is not None and len(points) > self.most:
            chosen = generator("render", "points").choice(len(points), self.most, replace=False)
            points = points[np.sort(chosen)]
        if self.as_is:
            with np.errstate(over="ignore"):  # beyond float32 is infinite
                return PointCloud(points.astype(np.float32)), tuple(notes)
        try:
            return normalise_points(points), tuple(notes)
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from error


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
        Views a call; None draws all in one.
    rng : Generator or None
        Random numbers for the method; None takes those of `bench render`, the same each time.
    """

    method: str
    views: tuple[View, ...]
    device: str = "auto"
    batch: int | None = None
    rng: np.random.Generator | None = None


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
        As in a record: the stage or the exception, and the problem.
    """

    reason: str


def make_view(azimuth_deg: float, elevation_deg: float) -> View:
    """Return the view of these angles. Raises BadInput for angles out of their range."""
    try:
        return View(azimuth_deg, elevation_deg)
    except ValueError as error:
        raise BadInput(f"no such view: {error}; see 'bench render --help'") from error


def find_drawer(method_id: str) -> Method:
    """Return the method. Raises BadInput as `find_method`, and for one that draws meshes alone."""
    method = find_method(method_id)
    if method.sees_mesh:
        raise BadInput(
            f"method '{method_id}' draws the mesh behind a cloud, and bare points have none; "
            "take another"
        )
    return method


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
        uint8 [views, 128, 128, 3]; or the failure of the method, or of its worker.

    Raises
    ------
    data_prep.failures.BadInput
        For a file that cannot be used, and for an unknown or unusable method.
    """
    ((_, drawn, _),) = draw_each(file, [drawing], 1, limits)
    return drawn


def draw_each(
    file: CloudFile, requests: Sequence[Wanted], workers: int, limits: Limits = LIMITS
) -> Iterator[tuple[Wanted, UInt8Images | Failed, Notes]]:
    """Yield each request with its images and notes, as they come.

    Each task reads the file by itself. Raises BadInput as `draw_file`, for a method before anything
    is drawn.
    """
    for wanted in requests:
        if isinstance(wanted, Drawing):
            find_drawer(wanted.method)
    tasks = [(file, wanted) for wanted in requests]
    for (_, wanted), result in run_tasks(tasks, _load_and_draw, workers, limits):
        drawn, notes = (Failed(result.reason), ()) if isinstance(result, WorkerFailure) else result
        yield wanted, drawn, notes


def draw_cloud(cloud: PointCloud, drawing: Drawing) -> UInt8Images | Failed:
    """Return images of a cloud, drawn in this process.

    Parameters
    ----------
    cloud : PointCloud
        Points float32 [N, 3], in unit-sphere coordinates.
    drawing : Drawing
        The method and the views.

    Returns
    -------
    ndarray or Failed
        uint8 [views, 128, 128, 3], or the failure of the method.

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown method, and for one that cannot be loaded.
    """
    renderer: Renderer | None = None
    rng = drawing.rng or generator("render")
    try:
        renderer = load_renderer(drawing.method, drawing.device)
        method = find_method(drawing.method)
        drawn = draw(method, renderer, cloud, drawing.views, rng, drawing.batch)
    except MissingDependency:
        raise
    except (Exception, SystemExit) as error:
        if renderer is None and isinstance(error, BadInput):  # unusable weights, for example
            raise
        return Failed(reason_of(error))
    return drawn.images


def _load_and_draw(task: tuple[CloudFile, Wanted]) -> tuple[UInt8Images | Failed, Notes]:
    file, wanted = task
    cloud, notes = file.load_with_notes()
    if isinstance(wanted, Dots):
        return draw_dots(cloud.points, wanted.views), notes
    return draw_cloud(cloud, wanted), notes
