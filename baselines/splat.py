"""Splats: points drawn as discs, as a point-cloud viewer draws them, without reconstruction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.neighbourhoods import nearest_distance
from baselines.reconstruction.stages import check_finite
from data_prep.failures import StageFailure
from data_prep.rendering.camera import NEAR, lens_of, origin_depth, project
from data_prep.rendering.images import to_float
from data_prep.scene import IMAGE_SIZE, AnyView, Images, PointCloud, Points

# Brightness of a disc, 0..1, at the point of the unit sphere nearest to the camera and at the
# farthest. In between it falls linearly with the depth, so that depth can be seen.
NEAR_GREY, FAR_GREY = 0.75, 0.35
# Largest radius of a disc, in pixels of an image of IMAGE_SIZE. In sparse clouds discs grow, and a
# single one must not fill the image.
MAX_RADIUS_PX = 16.0
_MOST_PIXELS = 2**22  # pixels of all discs that are painted together, in 100 MB of memory


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

    spread  the radius of the discs over the median distance of a point to the nearest other one
            (`baselines.neighbourhoods.nearest_distance`), so that sparser clouds get larger discs
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
        return Discs(points, self.spread * nearest_distance(points), cloud.colors)

    def draw(
        self,
        state: Discs,
        views: Sequence[AnyView],
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
        self, state: Discs, views: Sequence[AnyView], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return 1 in the pixels [V, size, size] that a disc paints, and 0 in the others."""
        black = replace(state, colors=np.zeros(state.centres.shape, np.uint8))
        return 1 - self.draw(black, views, size=size)[..., 0]


def _paint(discs: Discs, view: AnyView, size: int) -> NDArray[np.float32]:
    """Return an image [size, size, 3 or 1] of the discs on white, painted from far to near."""
    zoom = size / IMAGE_SIZE
    pixels, depth = project(discs.centres, view)
    pixels, largest_radius = zoom * pixels, zoom * MAX_RADIUS_PX
    reaches = ((pixels > -largest_radius) & (pixels < size + largest_radius)).all(axis=1)
    visible = np.flatnonzero((depth > NEAR) & reaches)
    order = visible[np.argsort(-depth[visible], kind="stable")]
    pixels, depth = pixels[order], depth[order]
    # At least half a pixel's diagonal, so that every disc covers the centre of a pixel.
    radius_px = zoom * discs.radius * lens_of(view).mean_focal / depth
    radius = np.clip(radius_px, np.sqrt(0.5), largest_radius)
    if discs.colors is None:
        ink = _greys(depth, origin_depth(view))
    else:
        ink = to_float(discs.colors[order])
    white = np.ones((1, ink.shape[1]), np.float32)
    shown = _nearest_discs(pixels, radius, size)
    return np.concatenate([white, ink]).take(shown, axis=0)


def _nearest_discs(
    centres: NDArray[np.float64], radius: NDArray[np.float64], size: int
) -> NDArray[np.int32]:
    """Return the disc that each pixel of an image [size, size] shows, from 1; 0 for none.

    A pixel shows the last of the discs whose radius [N] reaches its middle, all in pixels.

    centres  [N, 2], column and row, from the farthest disc to the nearest
    """
    shown = np.zeros(size * size, np.int32)
    reach = int(np.ceil(radius.max(initial=0.0)))
    step = max(1, _MOST_PIXELS // (2 * reach + 1) ** 2)
    for first in range(0, len(centres), step):
        some = slice(first, first + step)
        disc, pixel = _covered(centres[some], radius[some], size)
        # Where a pixel occurs more than once NumPy keeps the last value, that of the nearest disc.
        shown[pixel] = disc + np.int32(first + 1)
    return shown.reshape(size, size)


def _covered(
    centres: NDArray[np.float64], radius: NDArray[np.float64], size: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the pixels whose middles discs cover, and the disc of each, both [P], disc by disc.

    In each of its rows a disc covers pixels that lie side by side, so that only the ends of these
    are computed, and no pixel is tested.
    """
    column, row = centres.T - 0.5  # the middle of pixel i has the coordinate i
    top, rows = _whole_numbers(row - radius, row + radius, size)
    disc, line = np.repeat(np.arange(len(rows), dtype=np.int32), rows), _counted(top, rows)
    half = np.sqrt(np.maximum(radius[disc] ** 2 - (line - row[disc]) ** 2, 0.0))
    left, columns = _whole_numbers(column[disc] - half, column[disc] + half, size)
    return np.repeat(disc, columns), _counted(line * np.int32(size) + left, columns)


def _whole_numbers(
    low: NDArray[np.float64], high: NDArray[np.float64], size: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the first whole number of 0 to size - 1 in each range [R], and how many there are."""
    first = np.ceil(low).clip(0, size).astype(np.int32)
    last = np.floor(high).clip(-1, size - 1).astype(np.int32)
    return first, (last - first + 1).clip(0)


def _counted(first: NDArray[np.int32], count: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return `count` [R] numbers from `first` [R] on, for one after the other, [sum of counts]."""
    before = np.cumsum(count, dtype=np.int32) - count
    return np.arange(count.sum(), dtype=np.int32) + np.repeat(first - before, count)


def _greys(depth: NDArray[np.floating], origin: float) -> NDArray[np.float32]:
    """Return the brightness [N, 1] of discs at depths [N]: the nearer, the lighter."""
    share = np.clip((depth - (origin - 1)) / 2, 0.0, 1.0)
    return (NEAR_GREY + (FAR_GREY - NEAR_GREY) * share).astype(np.float32)[:, None]
