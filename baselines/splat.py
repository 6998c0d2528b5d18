"""Splats: points drawn as discs, as a point-cloud viewer draws them, without reconstruction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from baselines.reconstruction.stages import check_finite
from data_prep.failures import StageFailure
from data_prep.rendering.camera import CAMERA_DISTANCE, FOCAL_PX, project
from data_prep.rendering.images import to_float
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, Images, PointCloud, Points, View

# Brightness of a disc, 0..1, at the point of the unit sphere nearest to the camera and at the
# farthest. In between it falls linearly with the depth, so that depth can be seen.
NEAR_GREY, FAR_GREY = 0.75, 0.35
# Largest radius of a disc, in pixels of an image of IMAGE_SIZE. In sparse clouds discs grow, and a
# single one must not fill the image.
MAX_RADIUS_PX = 16.0
_NEAREST_DEPTH = 0.05 * CAMERA_DISTANCE  # points nearer to the camera than this are not drawn
_MOST_PIXELS = 2**22  # pixels of all discs that are painted together: it bounds the memory


@dataclass(frozen=True)
class Discs:
    """Discs that face the camera, all of one radius.

    centres  [N, 3], in unit-sphere coordinates
    radius   in the same unit
    colors   uint8 [N, 3]; None for greys by depth
    """

    centres: Points
    radius: float
    colors: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Splat:
    """A renderer that draws each point as a disc, where nearer discs hide farther ones.

    spread  the radius of the discs over the median distance of a point to the nearest other one, so
            that sparser clouds get larger discs
    """

    spread: float = 1.0

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Discs:
        """Return discs around the points; `rng` is not used.

        Discs have the colours of the cloud; without these they are grey, the farther the darker. A
        single point, and points that all coincide, get a radius of 0, which `draw` raises to the
        smallest disc.

        Raises StageFailure("input", ...) for an empty cloud or a non-finite point.
        """
        del rng
        points = cloud.points
        if len(points) == 0:
            raise StageFailure("input", "no points")
        check_finite(points)
        if len(points) == 1:
            return Discs(points, 0.0, cloud.colors)
        return Discs(points, self.spread * float(np.median(_nearest(points))), cloud.colors)

    def draw(
        self,
        state: Discs,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
        size: int = IMAGE_SIZE,
    ) -> Images:
        """Return images of the discs, float32 [V, size, size, 3] in 0..1; `rng` is not used."""
        del rng
        images = np.empty((len(views), size, size, 3), np.float32)
        for i, view in enumerate(views):
            images[i] = _paint(state, view, size)
        return images

    def coverage(
        self, state: Discs, views: Sequence[View], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return 1 in the pixels [V, size, size] that a disc paints, and 0 in the others."""
        black = replace(state, colors=np.zeros(state.centres.shape, np.uint8))
        return 1 - self.draw(black, views, size=size)[..., 0]


def _nearest(points: Points) -> NDArray[np.float64]:
    """Return the distance of each point to the nearest other one, [N], in no particular order.

    N is at least 2.
    """
    if len(points) <= CLOUD_SIZE:
        # Asked for as a list, the second neighbour alone: the first is the point itself.
        distances = np.asarray(cKDTree(points).query(points, k=[2])[0])
        return distances[:, 0]
    # The search takes time in proportion to the points that coincide, because the tree cannot
    # divide them. Their distance is known to be 0, so only the others are searched for.
    distinct, counts = np.unique(points, axis=0, return_counts=True)
    if len(distinct) == 1:
        return np.zeros(len(points))
    repeated = int(counts[counts > 1].sum())
    distances, _ = cKDTree(distinct).query(distinct[counts == 1], k=[2])
    return np.append(np.zeros(repeated), distances)


def _paint(discs: Discs, view: View, size: int) -> NDArray[np.float32]:
    """Return an image [size, size, 3] of the discs on white, painted from far to near."""
    zoom = size / IMAGE_SIZE
    pixels, depth = project(discs.centres, view)
    pixels, largest_radius = zoom * pixels, zoom * MAX_RADIUS_PX
    image = np.ones((size, size, 3), np.float32)
    reaches = ((pixels > -largest_radius) & (pixels < size + largest_radius)).all(axis=1)
    visible = np.flatnonzero((depth > _NEAREST_DEPTH) & reaches)
    order = visible[np.argsort(-depth[visible], kind="stable")]
    pixels, depth = pixels[order], depth[order]
    # At least half a pixel's diagonal, so that every disc covers the centre of a pixel.
    radius = np.clip(zoom * discs.radius * FOCAL_PX / depth, np.sqrt(0.5), largest_radius)
    ink = _greys(depth) if discs.colors is None else to_float(discs.colors[order])

    # All pixels of the square around a disc are tested, for many discs at a time.
    reach = int(np.ceil(radius.max(initial=0.0)))
    offsets = np.arange(-reach, reach + 1)
    square = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = pixels[:, ::-1]  # row, column
    step = max(1, _MOST_PIXELS // len(square))
    for first in range(0, len(centres), step):
        some = slice(first, first + step)
        cells = np.floor(centres[some]).astype(np.int64)[:, None, :] + square[None]  # [N, S, 2]
        away = cells + 0.5 - centres[some, None]  # of the pixels' middles from the disc's centre
        distance = np.hypot(away[..., 0], away[..., 1])
        within = ((cells >= 0) & (cells < size)).all(axis=-1)
        inside = (distance <= radius[some, None]) & within
        point, _ = np.nonzero(inside)  # sorted by point, that is from far to near
        rows, columns = cells[inside].T
        # Where an index occurs more than once NumPy keeps the last value, that of the nearest disc.
        image[rows, columns] = ink[some][point]
    return image


def _greys(depth: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the brightness [N, 1] of discs at depths [N]: the nearer, the lighter."""
    share = np.clip((depth - (CAMERA_DISTANCE - 1)) / 2, 0.0, 1.0)
    return (NEAR_GREY + (FAR_GREY - NEAR_GREY) * share).astype(np.float32)[:, None]
