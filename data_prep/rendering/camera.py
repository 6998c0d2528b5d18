"""The camera of the project: from a view to a pose, from points to pixels.

Source: Blender set-up of roatienza/pc2pix@23b7b46d (58 mm lens, 32 mm sensor, constant distance);
see the conventions in `data_prep.scene`. Each function takes a camera of a user's, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.scene import IMAGE_SIZE, AnyView, Camera

CAMERA_DISTANCE = 4.0  # the distance of the camera from the origin, in radii of the unit sphere
# The depths between which something is drawn, in the same unit. Surfaces may leave the unit sphere.
NEAR, FAR = 0.05 * CAMERA_DISTANCE, 2.5 * CAMERA_DISTANCE
_BEHIND = 1.25  # how far behind the origin nearness is 0: the unit sphere, and room for noise
# The angle that a sensor of 32 mm sees behind a lens of 58 mm, in radians.
FIELD_OF_VIEW_RAD = 2.0 * math.atan(16.0 / 58.0)
# The focal length in pixels of an image of IMAGE_SIZE.
FOCAL_PX = IMAGE_SIZE / 2 / math.tan(FIELD_OF_VIEW_RAD / 2)


class Lens(NamedTuple):
    """The focal lengths and the centre of an image, in pixels of an image of IMAGE_SIZE.

    focal   along columns and along rows
    centre  the column and row at which the axis of the camera meets the image
    """

    focal: tuple[float, float]
    centre: tuple[float, float]

    @property
    def mean_focal(self) -> float:
        """Return the focal length that tells the size of a disc."""
        return (self.focal[0] + self.focal[1]) / 2


_LENS = Lens((FOCAL_PX, FOCAL_PX), (IMAGE_SIZE / 2, IMAGE_SIZE / 2))


def lens_of(view: AnyView) -> Lens:
    """Return the lens of the camera of a view."""
    return Lens(view.focal_px, view.centre_px) if isinstance(view, Camera) else _LENS


def origin_depth(view: AnyView) -> float:
    """Return the distance of the origin along the viewing axis, at least NEAR."""
    if not isinstance(view, Camera):
        return CAMERA_DISTANCE
    return max(NEAR, float(view.pose[:3, 2] @ view.pose[:3, 3]))


def farthest_depth(view: AnyView) -> float:
    """Return the depth that has nearness 0."""
    return origin_depth(view) + _BEHIND


def depth_range(view: AnyView) -> tuple[float, float]:
    """Return the depths between which something is drawn."""
    beyond = origin_depth(view) - CAMERA_DISTANCE
    return NEAR + max(0.0, beyond), FAR + beyond


def camera_to_world(view: AnyView) -> NDArray[np.float64]:
    """Return the pose of the camera of a view, float64 [4, 4], from camera to world coordinates.

    As in OpenGL, the camera looks along its -Z axis, and its +Y axis points up.
    """
    if isinstance(view, Camera):
        return view.pose
    azimuth = math.radians(math.remainder(view.azimuth_deg, 360.0))
    elevation = math.radians(view.elevation_deg)
    sin_a, cos_a = math.sin(azimuth), math.cos(azimuth)
    sin_e, cos_e = math.sin(elevation), math.cos(elevation)
    # The axes are written out. Cross products with an "up" vector would fail at the poles
    # (elevation +-90), where the image's up is now the direction of the azimuth.
    backward = (cos_e * sin_a, sin_e, -cos_e * cos_a)  # from the origin to the camera
    right = (-cos_a, 0.0, -sin_a)
    up = (-sin_e * sin_a, cos_e, sin_e * cos_a)
    pose = np.eye(4)
    pose[:3, 0] = right
    pose[:3, 1] = up
    pose[:3, 2] = backward
    pose[:3, 3] = np.multiply(CAMERA_DISTANCE, backward)
    return pose


def project(
    points: NDArray[np.floating], view: AnyView
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project points onto the image.

    Parameters
    ----------
    points : array [N, 3]
        Unit-sphere coordinates.
    view : View or Camera
        Camera position.

    Returns
    -------
    pixels : float64 array [N, 2]
        Column and row; pixel centres are at .5.
    depth : float64 array [N]
        Distance along the viewing axis in unit-sphere units. A point behind the camera has a
        negative depth and meaningless pixel coordinates.
    """
    pose, lens = camera_to_world(view), lens_of(view)
    local = (np.asarray(points, dtype=np.float64) - pose[:3, 3]) @ pose[:3, :3]
    depth = -local[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        column = lens.centre[0] + lens.focal[0] * local[:, 0] / depth
        row = lens.centre[1] - lens.focal[1] * local[:, 1] / depth
    return np.stack([column, row], axis=1), depth
