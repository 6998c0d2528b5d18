"""A picture of a cloud in a file, by any method: `bench render`.

The file is read and the method runs in a worker process: neither is trusted.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.isolation import Limits, Lost, run_tasks
from bench.methods import Method, find_method
from bench.work import Pictures, draw, load_renderer, reason_of, write_whole
from data_prep.cloud_files import load_points
from data_prep.failures import BadInput, CannotWrite, MissingDependency
from data_prep.normalise import normalise_points
from data_prep.randomness import generator
from data_prep.scene import PointCloud, Renderer, View

LIMITS = Limits(time_s=120.0, memory_gib=4.0)


@dataclass(frozen=True)
class CloudFile:
    """A file with points: as they are (in float32), or brought to the unit sphere."""

    path: Path
    as_is: bool

    def load(self) -> PointCloud:
        """Raises BadInput for what is no cloud, or cannot be brought to the unit sphere."""
        points = load_points(self.path)
        if self.as_is:
            with np.errstate(over="ignore"):  # beyond float32 is infinite
                return PointCloud(points.astype(np.float32))
        try:
            return normalise_points(points)
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


@dataclass(frozen=True)
class Failed:
    """Why there are no pictures, in the words of a record."""

    reason: str


def make_view(azimuth_deg: float, elevation_deg: float) -> View:
    """The view of these angles. Raises BadInput where there is none."""
    try:
        return View(azimuth_deg, elevation_deg)
    except ValueError as error:
        raise BadInput(f"no such view: {error}; see 'bench render --help'") from error


def find_drawer(method_id: str) -> Method:
    """The method. Raises BadInput as `find_method`, and where it needs the mesh of a cloud."""
    method = find_method(method_id)
    if method.sees_mesh:
        raise BadInput(
            f"method '{method_id}' draws the mesh behind a cloud, and bare points have none; "
            "take another"
        )
    return method


def draw_file(file: CloudFile, drawing: Drawing) -> Pictures | Failed:
    """The pictures, made in a worker; or what became of the method, or of its worker.

    Raises BadInput for a file that cannot be used, and a method that cannot be had.
    """
    find_drawer(drawing.method)
    ((_, drawn),) = run_tasks([(file, drawing)], _load_and_draw, 1, LIMITS)
    return Failed(drawn.reason) if isinstance(drawn, Lost) else drawn


def draw_cloud(cloud: PointCloud, drawing: Drawing) -> Pictures | Failed:
    """The pictures, made in this process. Raises BadInput for a method that cannot be had."""
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
    return drawn.pictures


def check_name(path: Path) -> None:
    """Raises BadInput for a name that is not a PNG's."""
    if path.suffix.lower() != ".png":
        raise BadInput(f"{path}: pictures are written as PNG; give a name that ends in .png")


def write_png(picture: NDArray[np.uint8], path: Path) -> None:
    """Write [H, W, 3], whole or not at all. Raises CannotWrite."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    try:
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room, or give another -o"
        ) from error


def _load_and_draw(task: tuple[CloudFile, Drawing]) -> Pictures | Failed:
    file, drawing = task
    return draw_cloud(file.load(), drawing)
