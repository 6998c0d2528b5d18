"""Images of an array of points, in one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.catalogue.methods import RECOMMENDED
from bench.rendering.cloud import find_drawer
from bench.running.work import draw, load_renderer
from data_prep.clouds.normalise import cloud_of_points
from data_prep.randomness import generator
from data_prep.scene import View


def draw_cloud(
    points: ArrayLike,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    *,
    up: str = "y",
    front: str | None = None,
    method: str = RECOMMENDED,
    device: str = "auto",
) -> NDArray[np.uint8]:
    """Return an image of points in any units and anywhere, as `bench render` draws it.

    The method runs in this process, where a native library may crash or hang; the default is a
    network. Its weights are read once a process.

    Parameters
    ----------
    points : array_like
        Real numbers [N, 3].
    azimuth_deg : float
        0 is the front, 90 the side of +X (see `data_prep.scene`).
    elevation_deg : float
        -90..90; the networks were trained within -40..40.
    up, front : str
        Axes of the points that point up and to the front, such as "z" or "-x". The default of
        `front` is "-z", or "-y" where z is up.
    method : str
        Id of a method, see `bench list`. The default knows 13 classes and draws in grey.
    device : str
        "auto", "cpu" or "cuda", for networks.

    Returns
    -------
    ndarray
        uint8 [128, 128, 3] on white.

    Raises
    ------
    data_prep.failures.BadInput
        For a cloud without points, without extent or with points that are not finite, for an
        unknown axis or method, and for unusable weights. It is a ValueError.
    ValueError
        For `points` that are no array [N, 3] of real numbers, and for an angle out of its range.
    data_prep.failures.StageFailure
        Where the method cannot draw this cloud.
    """
    return _draw(points, [View(azimuth_deg, elevation_deg)], up, front, method, device)[0]


def turntable(
    points: ArrayLike,
    frames: int = 36,
    elevation_deg: float = 20.0,
    *,
    up: str = "y",
    front: str | None = None,
    method: str = RECOMMENDED,
    device: str = "auto",
) -> NDArray[np.uint8]:
    """Return images of points from all around, in equal steps; the cloud is prepared once.

    Parameters
    ----------
    points, elevation_deg, up, front, method, device
        As in `draw_cloud`.
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
    return _draw(points, views, up, front, method, device)


def _draw(
    points: ArrayLike,
    views: Sequence[View],
    up: str,
    front: str | None,
    method_id: str,
    device: str,
) -> NDArray[np.uint8]:
    method = find_drawer(method_id)
    cloud = cloud_of_points(points, up, front)
    renderer = load_renderer(method_id, device)
    return draw(method, renderer, cloud, views, generator("render")).images
