"""Images of a cloud in a file, by any method.

The file is read and the method runs in a worker process: neither is trusted.
"""

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
Notes = tuple[str, ...]  # a line each on what a file holds that is left out


@dataclass(frozen=True)
class CloudFile:
    """A file with points, and how they become a cloud.

    as_is         keep their units (in float32), else they are brought to the unit sphere
    up, front     of the file's axes, see `data_prep.clouds.orientations.upright`
    most          of more points so many are chosen at random, the same each time; None: all are
                  kept
    drop_invalid  leave out points that are not finite; else they are refused, unless as_is
    """

    path: Path
    as_is: bool
    up: str = "y"
    front: str | None = None
    most: int | None = None
    drop_invalid: bool = False

    def load(self) -> PointCloud:
        """Return the cloud.

        Raises BadInput for what is no cloud, or cannot be brought to the unit sphere.
        """
        return self.load_with_notes()[0]

    def load_with_notes(self) -> tuple[PointCloud, Notes]:
        """Return the cloud as `load` does, and a note on each thing that is left out."""
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
    """What is wanted of a cloud: views by a method, `batch` of them a call (None: all).

    `rng` is None for the random numbers of `bench render`, the same each time.
    """

    method: str
    views: tuple[View, ...]
    device: str = "auto"
    batch: int | None = None
    rng: np.random.Generator | None = None


@dataclass(frozen=True, eq=False)
class Dots:
    """What is wanted of a cloud: its points themselves, seen from there."""

    views: tuple[View, ...]


Wanted = Drawing | Dots


@dataclass(frozen=True)
class Failed:
    """Why there are no images, in the words of a record."""

    reason: str


def make_view(azimuth_deg: float, elevation_deg: float) -> View:
    """Return the view of these angles. Raises BadInput where there is none."""
    try:
        return View(azimuth_deg, elevation_deg)
    except ValueError as error:
        raise BadInput(f"no such view: {error}; see 'bench render --help'") from error


def find_drawer(method_id: str) -> Method:
    """Return the method. Raises BadInput as `find_method`, and where it draws meshes alone."""
    method = find_method(method_id)
    if method.sees_mesh:
        raise BadInput(
            f"method '{method_id}' draws the mesh behind a cloud, and bare points have none; "
            "take another"
        )
    return method


def draw_file(file: CloudFile, drawing: Drawing) -> UInt8Images | Failed:
    """Return the images, made in a worker; or what became of the method, or of its worker.

    Raises BadInput for a file that cannot be used, and a method that cannot be had.
    """
    ((_, drawn, _),) = draw_each(file, [drawing], 1)
    return drawn


def draw_each(
    file: CloudFile, wanted: Sequence[Wanted], workers: int
) -> Iterator[tuple[Wanted, UInt8Images | Failed, Notes]]:
    """Yield all that is wanted of a file, as it comes; each reads the file for itself.

    Raises BadInput as `draw_file`, for a method before anything is drawn.
    """
    for one in wanted:
        if isinstance(one, Drawing):
            find_drawer(one.method)
    tasks = [(file, one) for one in wanted]
    for (_, one), result in run_tasks(tasks, _load_and_draw, workers, LIMITS):
        drawn, notes = (Failed(result.reason), ()) if isinstance(result, WorkerFailure) else result
        yield one, drawn, notes


def draw_cloud(cloud: PointCloud, drawing: Drawing) -> UInt8Images | Failed:
    """Return the images, made in this process. Raises BadInput for a method that cannot be had."""
    renderer: Renderer | None = None
    rng = drawing.rng or generator("render")
    try:
        renderer = load_renderer(drawing.method, drawing.device)
        method = find_method(drawing.method)
        drawn = draw(method, renderer, cloud, drawing.views, rng, drawing.batch)
    except MissingDependency:
        raise
    except (Exception, SystemExit) as error:
        if renderer is None and isinstance(error, BadInput):  # unusable weights, say
            raise
        return Failed(reason_of(error))
    return drawn.images


def _load_and_draw(task: tuple[CloudFile, Wanted]) -> tuple[UInt8Images | Failed, Notes]:
    file, wanted = task
    cloud, notes = file.load_with_notes()
    if isinstance(wanted, Dots):
        return draw_dots(cloud.points, wanted.views), notes
    return draw_cloud(cloud, wanted), notes
