"""Images of bare points by pc2pix, in one call; `pc2pix.load` does more than that.

The bundled network knows chairs only. `bench.draw_cloud` draws any object.
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


def draw_cloud(
    points: ArrayLike,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 20.0,
    *,
    up: str = "y",
    front: str | None = None,
    renderer: Pc2pixRenderer | None = None,
) -> NDArray[np.uint8]:
    """Return an image [128, 128, 3] of the chair of points [N, 3], in any units and anywhere.

    azimuth_deg    0: the front; 90: from +X (see `data_prep.scene`)
    elevation_deg  -90..90; the networks were trained within -40..40
    up, front      axes of the points that point up and to the front, "z" or "-x" say; the front is
                   "-z" where it is not given, or "-y" where z is up
    renderer       of `pc2pix.load`; None: the bundled weights `chair`, read once a process, which
                   draw every cloud as a chair (`bench.draw_cloud` draws other objects)

    Any number of points will do; of many, the network gets several random thousands. The same
    points give the same image. Raises ValueError for what is no array of such a shape and for
    angles that there are not; BadInput (a ValueError) for a cloud without points, without extent or
    with non-finite points, and for axes that are none; StageFailure for a cloud that the network
    cannot make sense of (all of `data_prep.failures`).
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
    """Return images [frames, 128, 128, 3] from all around, from azimuth 0 on, in equal steps.

    Everything else as in `draw_cloud`; the cloud is encoded once. No frames give an empty array.
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
    renderer = renderer or _bundled()
    return to_uint8(renderer.draw(renderer.prepare(cloud), views))


@functools.cache
def _bundled() -> Pc2pixRenderer:
    import pc2pix

    return pc2pix.load()
