"""Points drawn as discs, as a point-cloud viewer draws them, without reconstruction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from baselines.reconstruction.stages import check_finite
from data_prep.failures import StageFailure
from data_prep.rendering.camera import CAMERA_DISTANCE, FOCAL_PX, project
from data_prep.rendering.images import to_float
from data_prep.scene import CLOUD_SIZE, IMAGE_SIZE, Images, PointCloud, Points, View

NEAR_GREY, FAR_GREY = 0.75, 0.35  # depth cue: at the nearest and farthest point of the unit sphere
MAX_RADIUS_PX = 16.0  # of an image of IMAGE_SIZE: a lone point must not paint it
_MOST_CELLS = 2**22  # looked at together: a bound on memory


@dataclass(frozen=True)
class Discs:
    """The centres [N, 3] of discs and their radius, both in unit-sphere units.

    Their colours, uint8 [N, 3], are optional.
    """

    centres: Points
    radius: float
    colors: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Splat:
    """A renderer by depth-buffered discs, grey by depth: nearer is lighter.

    `spread` scales the radius, which is the median distance to the nearest other point: sparser
    clouds get larger discs. With `colors`, uint8 [N, 3], the discs have these, the same at every
    depth; such a renderer draws one cloud, whose points they belong to.
    """

    spread: float = 1.0
    colors: NDArray[np.uint8] | None = field(default=None, compare=False)

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Discs:
        """Choose the radius; no randomness.

        Raises StageFailure("input", ...) for an empty cloud or a non-finite point. A single point,
        or points that all coincide, get the smallest disc.
        """
        del rng
        points = cloud.points
        if len(points) == 0:
            raise StageFailure("input", "no points")
        check_finite(points)
        if len(points) == 1:
            return Discs(points, 0.0, self.colors)
        return Discs(points, self.spread * float(np.median(_nearest(points))), self.colors)

    def draw(
        self,
        state: Discs,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
        size: int = IMAGE_SIZE,
    ) -> Images:
        """Paint the discs from far to near, in images [V, size, size, 3]; no randomness."""
        del rng
        images = np.empty((len(views), size, size, 3), np.float32)
        for i, view in enumerate(views):
            images[i] = _paint(state, view, size)
        return images

    def coverage(
        self, state: Discs, views: Sequence[View], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return 1 in pixels [V, size, size] that a disc paints, else 0."""
        black = replace(state, colors=np.zeros(state.centres.shape, np.uint8))
        return 1 - self.draw(black, views, size=size)[..., 0]


def _nearest(points: Points) -> NDArray[np.float64]:
    """Return the distances [N] to the nearest other point, in any order; N is at least 2."""
    repeated = 0
    if len(points) > CLOUD_SIZE:
        # A leaf of the tree cannot divide equal points: a query takes time in proportion to them.
        distinct, counts = np.unique(points, axis=0, return_counts=True)
        repeated = int(counts[counts > 1].sum())
        if len(distinct) == 1:
            return np.zeros(len(points))
        alone = distinct[counts == 1]
        distances, _ = cKDTree(distinct).query(alone, k=[2])
    else:
        distances, _ = cKDTree(points).query(points, k=[2])  # the first is the point itself
    return np.append(np.zeros(repeated), distances)


def _paint(discs: Discs, view: View, size: int) -> NDArray[np.float32]:
    zoom = size / IMAGE_SIZE
    pixels, depth = project(discs.centres, view)
    pixels, most = zoom * pixels, zoom * MAX_RADIUS_PX
    image = np.ones((size, size, 3), np.float32)
    reaches = ((pixels > -most) & (pixels < size + most)).all(axis=1)
    visible = np.flatnonzero((depth > 0.05 * CAMERA_DISTANCE) & reaches)
    order = visible[np.argsort(-depth[visible], kind="stable")]
    pixels, depth = pixels[order], depth[order]
    # At least half a pixel's diagonal, so that every disc covers a pixel centre.
    radius = np.clip(zoom * discs.radius * FOCAL_PX / depth, np.sqrt(0.5), most)
    if discs.colors is None:
        share = np.clip((depth - (CAMERA_DISTANCE - 1)) / 2, 0.0, 1.0)
        ink = (NEAR_GREY + (FAR_GREY - NEAR_GREY) * share).astype(np.float32)[:, None]
    else:
        ink = to_float(discs.colors[order])

    reach = int(np.ceil(radius.max(initial=0.0)))
    offsets = np.arange(-reach, reach + 1)
    square = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = pixels[:, ::-1]  # row, column
    step = max(1, _MOST_CELLS // len(square))
    for some in (slice(first, first + step) for first in range(0, len(centres), step)):
        cells = np.floor(centres[some]).astype(np.int64)[:, None, :] + square[None]  # [N, S, 2]
        distance = np.hypot(*np.moveaxis(cells + 0.5 - centres[some, None], -1, 0))
        within = ((cells >= 0) & (cells < size)).all(axis=-1)
        inside = (distance <= radius[some, None]) & within
        point, _ = np.nonzero(inside)  # sorted by point, that is from far to near
        rows, columns = cells[inside].T
        # Of repeated indices NumPy keeps the last: the nearest.
        image[rows, columns] = ink[some][point]
    return image
