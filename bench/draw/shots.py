"""The images of a user's cameras: what each sees of a cloud, and in which part of its image.

A method draws the square of the image that holds the cloud, as if that square were the image of a
camera of its own. There the unit sphere just fits, as in every image that networks were trained on
and that sizes of discs were chosen for. All else in the image is white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import ANY_SIZE
from data_prep.clouds.normalise import Placement
from data_prep.failures import BadInput
from data_prep.files.pinholes import Pinholes
from data_prep.rendering.camera import CAMERA_DISTANCE, FIELD_OF_VIEW_RAD, NEAR, project
from data_prep.scene import IMAGE_SIZE, Camera, PointCloud

# The side of an image over that of the unit sphere in it, in the views of the project.
_ROOM = math.tan(FIELD_OF_VIEW_RAD / 2) / math.tan(math.asin(1 / CAMERA_DISTANCE))
# The farthest camera, in radii of the cloud. From there float32 still places points to a tenth of a
# pixel; beyond it, units of camera and cloud mostly differ.
_FARTHEST = 1000.0
_EVERYWHERE = 1e6  # pixels: the end of a box that has none


@dataclass(frozen=True, eq=False)
class Shots:
    """The parts of images that are drawn.

    cameras  of the parts, in unit-sphere coordinates
    size     side of the parts in pixels
    corners  int [V, 2]: column and row of the upper left corner of each part in its image
    width    of the images in pixels
    height   of the images in pixels
    """

    cameras: tuple[Camera, ...]
    size: int
    corners: NDArray[np.intp]
    width: int
    height: int

    def whole(self, parts: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return images [V, height, width, C] of parts [V, size, size, C], on white or clear."""
        count, *_, channels = parts.shape
        images = np.full((count, self.height, self.width, channels), 255, np.uint8)
        images[..., 3:] = 0
        for image, part, (left, top) in zip(images, parts, self.corners, strict=True):
            rows = slice(max(top, 0), min(top + self.size, self.height))
            columns = slice(max(left, 0), min(left + self.size, self.width))
            image[rows, columns] = part[
                rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
            ]
        return images


def shots_of(pinholes: Pinholes, cloud: PointCloud, place: Placement) -> Shots:
    """Return the parts of the images of cameras that show a cloud, all of one size.

    pinholes  turned as the points of the cloud
    place     where the cloud stood before it was brought to the unit sphere

    Raises BadInput for a camera that sees no point, is far away, or stands among the points.
    """
    poses = pinholes.poses.copy()
    poses[:, :3, 3] = (poses[:, :3, 3] - place.centre) / place.radius
    boxes = []
    for number, pose in enumerate(poses):
        _check(pinholes, number, pose, cloud, place)
        boxes.append(_box(pose, pinholes.focal_px[number], pinholes.centres_px[number]))
    low, high = np.array(boxes).transpose(1, 0, 2)  # each [V, (column, row)]
    frame = np.array([pinholes.width, pinholes.height])
    size = int(min(frame.max(), max(ANY_SIZE[0], np.ceil((high - low).max()))))
    # Around the cloud; where the image does not hold all of it, so that the part covers the image.
    first, last = np.clip(low, 0, frame), np.clip(high, 0, frame)
    middle = (low + high) / 2
    corners = np.floor(np.clip(middle - size / 2, last - size, first)).astype(np.intp)
    zoom = IMAGE_SIZE / size
    cameras = []
    for pose, focal, centre in zip(
        poses, zoom * pinholes.focal_px, zoom * (pinholes.centres_px - corners), strict=True
    ):
        cameras.append(_camera(pose, focal, centre))
    return Shots(tuple(cameras), size, corners, pinholes.width, pinholes.height)


def _check(
    pinholes: Pinholes, number: int, pose: NDArray[np.float64], cloud: PointCloud, place: Placement
) -> None:
    """Raise BadInput for a camera that sees no point, is far away, or stands among the points."""
    which = f"camera {number + 1}" if len(pinholes.names) > 1 else "the camera"
    named = f"{which} of {pinholes.source}"
    distance = float(np.linalg.norm(pose[:3, 3]))
    if distance > _FARTHEST:
        raise BadInput(
            f"{named} stands {distance:.3g} radii of the cloud away, and at most {_FARTHEST:g} can "
            "be drawn; give camera and cloud in the same units"
        )
    # In the pixels of the file: `project` takes those of a camera as they are.
    seen_by = _camera(pose, pinholes.focal_px[number], pinholes.centres_px[number])
    pixels, depth = project(cloud.points, seen_by)
    ahead = depth > 0
    inside = ahead & (pixels >= 0).all(axis=1)
    inside &= (pixels < [pinholes.width, pinholes.height]).all(axis=1)
    if not inside.any():
        why = "shows none of the points" if ahead.any() else "looks away from the cloud"
        raise BadInput(f"{named} {why}; give it in the coordinates of the cloud's file")
    if depth[inside].min() <= NEAR:
        raise BadInput(
            f"{named} stands inside of the cloud, {depth[inside].min() * place.radius:.3g} from a "
            f"point that it sees; move it {NEAR * place.radius:.3g} away"
        )


def _camera(
    pose: NDArray[np.float64], focal: NDArray[np.float64], centre: NDArray[np.float64]
) -> Camera:
    return Camera(pose, (float(focal[0]), float(focal[1])), (float(centre[0]), float(centre[1])))


def _box(
    pose: NDArray[np.float64], focal: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the box of the unit sphere in an image, with room around it, as corners [2, 2].

    The box is larger than any image where the sphere reaches behind the camera.
    """
    across, up, behind = -pose[:3, 3] @ pose[:3, :3]  # the origin in the camera's frame
    depth = -behind
    if depth <= 1:
        return np.array([[-_EVERYWHERE] * 2, [_EVERYWHERE] * 2])
    corners = []
    for axis, middle in enumerate((across, -up)):
        # Slopes of the two planes through the camera and this axis that touch the sphere.
        reach = math.sqrt(middle**2 + depth**2 - 1)
        slopes = np.array([middle * depth - reach, middle * depth + reach]) / (depth**2 - 1)
        low, high = centre[axis] + focal[axis] * slopes
        room = (_ROOM - 1) * (high - low) / 2
        corners.append((low - room, high + room))
    return np.array(corners).T
