"""Projected points filled to an image by pull and push: what images alone can do.

No surface is reconstructed and nothing is trained. Grossman and Dally (Point sample rendering,
1998) and Marroquim, Kraus and Cavalcanti (Efficient point-based rendering using image
reconstruction, 2007) fill the gaps between projected points from coarser images:

Samples  The nearest point of each pixel, as bright as its normal says: the light of the scene
         shines along the view. Normals are those of the points' neighbourhoods. A sample weighs the
         more the more it faces the camera.
Hidden   A point is hidden where the nearer ones close in on it: where the image of nearness,
         dilated and eroded by some spacings of the points, is nearer than it.
Pull     Coarser and coarser images, each pixel the mean of its samples, until none is empty.
Push     From the coarsest to the finest, a pixel whose samples weigh less than 1 takes the rest
         from the coarser one.
Outline  The pixels that a disc beside the points cannot reach, likewise (an alpha shape in the
         image), eroded by somewhat less, for the last points lie within the outline. Its edge is a
         pixel wide.

Noisy points, by the estimate of `baselines.reconstruction.denoised`, are first moved onto planes of
their neighbourhoods, and the sparsest left out. How the constants were chosen:
docs/reconstruction-constants.md at commit d75c6426.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from baselines.neighbourhoods import fit_planes
from baselines.reconstruction.denoised import (
    DENSITY_NEIGHBOURS,
    LEFT_OUT,
    MOST_LEFT_OUT,
    NOISY,
    dense_part,
    noise_scale,
    searched,
)
from baselines.reconstruction.stages import check_points, fewer, spacing
from baselines.splat import MAX_RADIUS_PX
from data_prep.arrays import Floats
from data_prep.clouds.sampling import random_rows
from data_prep.rendering.camera import CAMERA_DISTANCE, FOCAL_PX, camera_to_world, project
from data_prep.scene import IMAGE_SIZE, NEUTRAL_GREY, Images, PointCloud, View

GAMMA = 2.2  # of the scene's shading: data_prep/rendering/mesh.frag
MOST_POINTS = 8192  # that are drawn; of more, a random subset
HOPS = 4  # of the neighbourhoods that normals are those of
_ROUNDS = 2  # of smoothing
SMOOTHING, FEWEST_HOPS, MOST_HOPS = 4.0, 2, 12  # hops for a noise of one spacing
_CLOSING = 1.5  # radius of the disc that closes the outline, in spacings of the points
MARGIN = 0.25  # of the outline about the outermost points, in spacings
_COVERING = 1.5  # reach of what hides, in spacings
BEHIND = 0.5  # depth from which on a point is hidden, in spacings
LEAST_SHARE = 1e-3
SHARE = 0.25  # of a pixel that a sample facing the camera fills: four neighbours fill one


@dataclass(frozen=True, eq=False)
class _OrientedPoints:
    """Points [N, 3] with unit normals [N, 3] of either sign, their spacing, and notes."""

    points: Floats
    normals: Floats
    spacing: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class SplatFill:
    """A renderer by projected points and pull-push, in neutral grey."""

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> _OrientedPoints:
        """Smooth noisy points and find the normals; no randomness, and no order of the points.

        Raises StageFailure("input", ...) for an empty cloud or a non-finite point.
        """
        del rng
        check_points(cloud.points, 1, "images")
        different = np.unique(cloud.points, axis=0)
        points = different[random_rows(len(different), MOST_POINTS)]
        near, sample = searched(points)
        noise, between = noise_scale(sample), spacing(near)
        notes = fewer(points, different)
        exact = near.points
        if noise > NOISY * spacing(sample):
            exact = _smoothed(exact, noise, between)
            done = f"smoothed: {_ROUNDS} times, {len(exact)} of {len(points)} kept"
            notes = (f"noise: {noise:.3f}", *notes, done)
        (planes,) = fit_planes(exact, (HOPS,))
        return _OrientedPoints(exact, planes.normals, between, notes)

    def draw(
        self,
        state: _OrientedPoints,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
        size: int = IMAGE_SIZE,
    ) -> Images:
        """Project and fill the points, in images [V, size, size, 3]; no randomness."""
        del rng
        images = np.empty((len(views), size, size, 3), np.float32)
        for i, view in enumerate(views):
            covered, filled = _paint(state, view, size)
            images[i] = (1 - covered + covered * filled)[..., None]
        return images

    def coverage(
        self, state: _OrientedPoints, views: Sequence[View], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return the share of each pixel within the outline, 0..1, [V, size, size]."""
        shares = [_paint(state, view, size)[0] for view in views]
        return np.array(shares, np.float32).reshape(-1, size, size)


def _paint(state: _OrientedPoints, view: View, size: int) -> tuple[Floats, Floats]:
    """Return how much of each pixel is covered, and the grey of what covers it, both [S, S]."""
    depth, cosine = _nearest(state, view, size)
    if not np.isfinite(depth).any():
        return np.zeros(depth.shape), np.ones(depth.shape)
    zoom = size / IMAGE_SIZE
    between, most = zoom * state.spacing * FOCAL_PX / CAMERA_DISTANCE, zoom * MAX_RADIUS_PX
    covered = _outline(np.isfinite(depth), min(_CLOSING * between, most), MARGIN * between)
    shown = _visible(depth, min(_COVERING * between, most), BEHIND * state.spacing)
    # Obliquely a patch covers few pixels, and most oblique normals are wrong ones, of edges. Never
    # nothing: an image of oblique points alone has to be filled too.
    weight = np.where(shown, np.maximum(SHARE * cosine, LEAST_SHARE), 0.0)
    return covered, _pull_push(NEUTRAL_GREY[0] / 255 * cosine ** (1 / GAMMA), weight)


def _smoothed(points: Floats, noise: float, between: float) -> Floats:
    hops = int(np.clip(round(SMOOTHING * (noise / between) ** 2), FEWEST_HOPS, MOST_HOPS))
    for _ in range(_ROUNDS):
        (planes,) = fit_planes(points, (hops,))
        points = planes.flattened
    return dense_part(points, 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT), DENSITY_NEIGHBOURS)


def _nearest(state: _OrientedPoints, view: View, size: int) -> tuple[Floats, Floats]:
    """Return depth and cosine of the nearest point of each pixel; depth is inf without one.

    The cosine is that of the angle between normal and line of sight.
    """
    pixels, depth = project(state.points, view)
    pixels *= size / IMAGE_SIZE
    within = ((pixels >= 0) & (pixels < size)).all(axis=1)
    seen = np.flatnonzero((depth > 0.05 * CAMERA_DISTANCE) & within)
    order = seen[np.argsort(-depth[seen], kind="stable")]  # the nearest is written last
    column, row = pixels[order].astype(np.intp).T
    cosine = np.abs(state.normals[order] @ camera_to_world(view)[:3, 2]).clip(0, 1)
    depths = np.full((size, size), np.inf)
    cosines = np.ones((size, size))
    depths[row, column] = depth[order]
    cosines[row, column] = cosine
    return depths, cosines


def _outline(occupied: NDArray[np.bool_], radius: float, margin: float) -> Floats:
    """Return how much of each pixel [S, S] lies within the outline of the occupied ones, 0..1.

    The outline is `margin` beyond what a disc of `radius`, both in pixels, cannot reach.
    """
    radius = max(radius, 1.0)
    margin = min(max(margin, 0.5), radius)  # a lone point is a pixel
    border = int(np.ceil(radius)) + 1
    empty = np.pad(~occupied, border, constant_values=True)
    near = ndimage.distance_transform_edt(empty) <= radius
    depth = ndimage.distance_transform_edt(near)[border:-border, border:-border]
    return np.clip(depth - (radius - margin), 0.0, 1.0)


def _visible(depth: Floats, reach: float, tolerance: float) -> NDArray[np.bool_]:
    """Return where the points of a depth image [S, S] (inf: none) are not hidden by nearer ones.

    Hidden is a point that lies `tolerance` behind what nearer points close when they are dilated
    and eroded by `reach` pixels.
    """
    border = int(np.ceil(max(reach, 1.0)))
    side, far = 2 * border + 1, np.finfo(np.float64).max
    padded = np.pad(np.minimum(depth, far), border, constant_values=far)
    closed = ndimage.maximum_filter(ndimage.minimum_filter(padded, side), side)
    return np.isfinite(depth) & (depth <= closed[border:-border, border:-border] + tolerance)


def _pull_push(values: Floats, weights: Floats) -> Floats:
    """Return an image [S, S] that keeps values of weight 1 and fills the others from coarser ones.

    Weights are in 0..1, and one of them at least is above 0. What a weight lacks to 1 comes from
    the coarser image.
    """
    size = len(values)
    beyond = (1 << (size - 1).bit_length()) - size  # to a power of two, with nothing there
    levels = [(np.pad(values * weights, (0, beyond)), np.pad(weights, (0, beyond)))]
    while len(levels[-1][0]) > 1:
        total, weight = (_sums_of_four(part) for part in levels[-1])
        scale = 1 / np.maximum(weight, 1.0)  # no pixel is more than full
        levels.append((total * scale, weight * scale))
    total, weight = levels.pop()
    image = total / weight
    for total, weight in reversed(levels):
        image = total + (1 - weight) * _doubled(image)
    return image[:size, :size]


def _sums_of_four(image: Floats) -> Floats:
    half = len(image) // 2
    return image.reshape(half, 2, half, 2).sum(axis=(1, 3))


def _doubled(image: Floats) -> Floats:
    """Return an image of twice the side, interpolated linearly between pixel centres."""
    for _ in range(2):  # rows, then columns
        padded = np.pad(image, ((1, 1), (0, 0)), mode="edge")
        between = np.stack([padded[:-2] + 3 * image, padded[2:] + 3 * image], axis=1) / 4
        image = between.reshape(-1, image.shape[1]).T
    return image
