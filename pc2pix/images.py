"""Images of bare points by pc2pix, in one call; `pc2pix.load` does more than that.

The network is that of 13 classes. `bench.draw_cloud` draws with better ones for an unknown object.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.clouds.normalise import cloud_of_points
from data_prep.rendering.images import to_uint8
from data_prep.scene import View

if TYPE_CHECKING:
    from pc2pix.renderer import Pc2pixRenderer

DEFAULT = "all"  # for a cloud of an unknown object


def draw_cloud(
    points: ArrayLike,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    *,
    up: str = "y",
    front: str | None = None,
    renderer: Pc2pixRenderer | None = None,
) -> NDArray[np.uint8]:
    """Return an image of points in any units and anywhere.

    The same points give the same image.

    Parameters
    ----------
    points : array_like of real numbers, [N, 3]
        Any number of points will do; of many, the network gets several random thousands.
    azimuth_deg : float
        Azimuth in degrees; 0 is the front, 90 is from +X (see `data_prep.scene`).
    elevation_deg : float
        Elevation in degrees, -90..90; the networks were trained within -40..40.
    up, front : str
        Axes of the points that point up and to the front, "z" or "-x" say. The front is "-z" where
        it is not given, or "-y" where z is up.
    renderer : Pc2pixRenderer, optional
        A renderer of `pc2pix.load`; without one the bundled weights of 13 classes, read once a
        process. The weights of chairs draw a chair whatever the cloud is.

    Returns
    -------
    uint8 array, [128, 128, 3]
        Image in sRGB on white.

    Raises
    ------
    ValueError
        Where `points` is no array of that shape and where an angle is out of range or not finite.
    data_prep.failures.BadInput
        A ValueError, for a cloud without points, without extent or with non-finite points, and for
        axes that are none.
    data_prep.failures.StageFailure
        For a cloud that the network cannot make sense of.
    """
    views = [View(azimuth_deg, elevation_deg)]
    return _draw(points, views, up, front, renderer)[0]


def turntable(
    points: ArrayLike,
    frames: int = 36,
    elevation_deg: float = 20.0,
    *,
    up: str = "y",
    front: str | None = None,
    renderer: Pc2pixRenderer | None = None,
) -> NDArray[np.uint8]:
    """Return images from all around, from azimuth 0 on, in equal steps.

    The cloud is encoded once.

    Parameters
    ----------
    points, elevation_deg, up, front, renderer
        Arguments as of `draw_cloud`.
    frames : int
        Number of images; 0 gives an empty array.

    Returns
    -------
    uint8 array, [frames, 128, 128, 3]
        Images in sRGB on white.

    Raises
    ------
    ValueError, data_prep.failures.BadInput, data_prep.failures.StageFailure
        As `draw_cloud`.
    """
    views = [View(360 * i / frames, elevation_deg) for i in range(frames)]
    return _draw(points, views, up, front, renderer)


def _draw(
    points: ArrayLike,
    views: list[View],
    up: str,
    front: str | None,
    renderer: Pc2pixRenderer | None,
) -> NDArray[np.uint8]:
    cloud = cloud_of_points(points, up, front)
    renderer = renderer or bundled()
    return to_uint8(renderer.draw(renderer.prepare(cloud), views))


@functools.cache
def bundled() -> Pc2pixRenderer:
    """Return the renderer with the bundled weights of 13 classes, the same one at each call."""
    import pc2pix

    return pc2pix.load(DEFAULT)
