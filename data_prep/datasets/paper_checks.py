"""Checks of the paper's data: unusable files, and clouds that do not fit their images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import AZIMUTH_RANGE_DEG, ELEVATION_RANGE_DEG
from data_prep.datasets.paper import IMAGES, VIEWS, PaperObject, read_views
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.rendering.camera import project
from data_prep.rendering.images import read_image
from data_prep.scene import IMAGE_SIZE, PointCloud, View

WHITE = 250  # of 255: a channel below it belongs to the object
# How the angles of view.txt might be meant: turned by quarters, and in either sense. The first is
# the reading that `datasets.paper` takes.
READINGS = tuple((sense, turn) for sense in (1, -1) for turn in (0, 90, 180, 270))


def find_problems(obj: PaperObject) -> Iterator[tuple[str, str]]:
    """Yield each problem and its place: ("an image of mode RGB, not RGBA", "render_3_128.png")."""
    try:
        obj.cloud(generator("examine"))
    except BadInput as error:
        yield "the cloud cannot be used", _without_path(error, str(obj.cloud_file))
    view_file = obj.renders / VIEWS
    try:
        views = read_views(view_file)
    except BadInput as error:
        yield "the cameras cannot be read", _without_path(error, str(view_file))
    else:
        if len(views) != IMAGES:
            yield f"{VIEWS} has not {IMAGES} lines", f"{len(views)} lines"
        low, high = AZIMUTH_RANGE_DEG
        least, most = ELEVATION_RANGE_DEG
        beyond = [
            view
            for view in views
            if not (low <= view.azimuth_deg <= high and least <= view.elevation_deg <= most)
        ]
        if beyond:
            yield "angles beyond 180 and 40 degrees", f"{len(beyond)} views"
    for path in obj.image_files():
        try:
            _, mode = read_image(path)
        except BadInput as error:
            yield "an image cannot be used", _without_path(error, str(path.parent) + "/")
        else:
            if mode != "RGBA":
                yield f"an image of mode {mode}, not RGBA", path.name


def agreement(obj: PaperObject) -> NDArray[np.float64]:
    """Return the share of points that fall on the object in its images, for each reading.

    The result has a value for each of READINGS, the mean over all views.

    Raises BadInput where the object cannot be used.
    """
    cloud, views = obj.cloud(generator("examine")), obj.cameras(IMAGES)
    on_object = np.asarray((obj.truth(views) < WHITE).any(axis=3))
    return np.array([_share(cloud, views, on_object, *reading) for reading in READINGS])


def _share(
    cloud: PointCloud, views: Sequence[View], on_object: NDArray[np.bool_], sense: int, turn: int
) -> float:
    hits = []
    for view, mask in zip(views, on_object, strict=True):
        read = View(sense * view.azimuth_deg + turn, view.elevation_deg)
        pixels, _ = project(cloud.points, read)
        column, row = np.floor(np.clip(pixels, -1, IMAGE_SIZE)).astype(int).T
        inside = (column >= 0) & (column < IMAGE_SIZE) & (row >= 0) & (row < IMAGE_SIZE)
        hit = np.zeros(len(cloud), bool)
        hit[inside] = mask[row[inside], column[inside]]
        hits.append(hit.mean())
    return float(np.mean(hits))


def _without_path(error: BadInput, path: str) -> str:
    return str(error).removeprefix(path).removeprefix(": ")
