"""Projected points filled to an image by pull and push: what images alone can do.

No surface is reconstructed and nothing is trained. Grossman and Dally (Point sample rendering,
1998) and Marroquim, Kraus and Cavalcanti (Efficient point-based rendering using image
reconstruction, 2007) fill the gaps between projected points from coarser images:

Samples  Each pixel shows the nearest point that falls into it, shaded by the point's normal, which
         is that of the plane of its neighbourhood; the light shines along the view. The more a
         sample faces the camera, the more it weighs.
Hidden   Points nearer to the camera hide those behind them, also between the pixels that they fall
         into: the depth image is dilated and then eroded by some spacings of the points, and a
         point that lies behind the result is hidden.
Pull     Images of half, a quarter, ... of the size are made, in which a pixel is the weighted mean
         of the samples below it, until no pixel is empty.
Push     From the coarsest image to the finest, a pixel whose samples weigh less than 1 takes the
         rest from the next coarser image.
Outline  The object covers all pixels that a disc outside cannot reach without covering a point (an
         alpha shape in the image). The outline is moved outwards by a margin, because the outermost
         points lie inside the object. Its edge is a pixel wide.

Points that are noisy by the estimate of `baselines.reconstruction.denoised` are first moved onto
the planes of their neighbourhoods, and those in the sparsest places are left out. How the constants
were chosen: docs/reconstruction-constants.md at commit d75c6426.
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
from baselines.reconstruction.stages import check_points, spacing
from baselines.splat import MAX_RADIUS_PX
from data_prep.arrays import Floats
from data_prep.clouds.sampling import at_most
from data_prep.clouds.sorting import different_points
from data_prep.rendering.camera import NEAR, camera_to_world, lens_of, origin_depth, project
from data_prep.scene import IMAGE_SIZE, NEUTRAL_GREY, AnyView, Images, PointCloud

# A spacing is the median distance between neighbouring points (`stages.spacing`).
GAMMA = 2.2  # exponent between brightness and cosine, as in data_prep/rendering/mesh.frag
MOST_POINTS = 8192  # points that are drawn; of a larger cloud a random subset
HOPS = 4  # size of the neighbourhoods whose planes give the normals (`baselines.neighbourhoods`)
_ROUNDS = 2  # times that noisy points are moved onto planes
# Planes that noisy points are moved onto have SMOOTHING hops where the standard deviation of the
# noise is one spacing. Their number grows with its square, within these bounds.
SMOOTHING, FEWEST_HOPS, MOST_HOPS = 4.0, 2, 12
_CLOSING = 1.5  # spacings: radius of the disc that outlines the points
MARGIN = 0.25  # spacings: how far the outline lies outside of the outermost points
_COVERING = 1.5  # spacings: how far around itself, in the image, a point hides others
BEHIND = 0.5  # spacings: a point farther than this behind the points that hide it is not drawn
LEAST_SHARE = 1e-3  # smallest weight of a sample that is not hidden, however oblique it is
SHARE = 0.25  # weight of a sample that faces the camera: four such samples fill a pixel


@dataclass(frozen=True, eq=False)
class _OrientedPoints:
    """The points of a cloud that are drawn, with their normals.

    points   [N, 3], smoothed where the cloud is noisy
    normals  [N, 3], unit vectors of either sign
    spacing  the median distance between neighbours, before smoothing
    notes    what was done to the cloud, for the user
    """

    points: Floats
    normals: Floats
    spacing: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class SplatFill:
    """A renderer that fills the gaps between projected points by pull and push, in neutral grey."""

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> _OrientedPoints:
        """Return the points, smoothed where they are noisy, with their normals.

        `rng` is not used, and the order of the points does not matter.

        Raises StageFailure("input", ...) for an empty cloud or a non-finite point.
        """
        del rng
        check_points(cloud.points, 1, "images")
        different = different_points(cloud.points)
        points, notes = at_most(MOST_POINTS, different)
        near, sample = searched(points)
        noise, between = noise_scale(sample), spacing(near)
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
        views: Sequence[AnyView],
        rng: np.random.Generator | None = None,
        size: int = IMAGE_SIZE,
    ) -> Images:
        """Return filled images of the points, float32 [V, size, size, 3] in 0..1.

        `rng` is not used.
        """
        del rng
        images = np.empty((len(views), size, size, 3), np.float32)
        for i, view in enumerate(views):
            covered, filled = _paint(state, view, size)
            images[i] = (1 - covered + covered * filled)[..., None]
        return images

    def coverage(
        self, state: _OrientedPoints, views: Sequence[AnyView], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return the share of each pixel within the outline, 0..1, [V, size, size]."""
        shares = [_paint(state, view, size)[0] for view in views]
        return np.array(shares, np.float32).reshape(-1, size, size)


def _paint(state: _OrientedPoints, view: AnyView, size: int) -> tuple[Floats, Floats]:
    """Return how much of each pixel is covered, and the grey of what covers it, both [S, S]."""
    depth, cosine = _nearest(state, view, size)
    if not np.isfinite(depth).any():
        return np.zeros(depth.shape), np.ones(depth.shape)
    zoom = size / IMAGE_SIZE
    spacing_px = zoom * state.spacing * lens_of(view).mean_focal / origin_depth(view)
    largest_px = zoom * MAX_RADIUS_PX
    closing_px = min(_CLOSING * spacing_px, largest_px)
    covered = _outline(np.isfinite(depth), closing_px, MARGIN * spacing_px)
    covering_px = min(_COVERING * spacing_px, largest_px)
    shown = _visible(depth, covering_px, BEHIND * state.spacing)
    # Oblique samples weigh little: seen obliquely a patch of the surface covers few pixels, and
    # most oblique normals are wrong ones, at edges. But they weigh something, because an image of
    # nothing but oblique samples has to be filled, too.
    weight = np.where(shown, np.maximum(SHARE * cosine, LEAST_SHARE), 0.0)
    grey = NEUTRAL_GREY[0] / 255 * cosine ** (1 / GAMMA)
    return covered, pull_push(grey, weight)


def _smoothed(points: Floats, noise: float, between: float) -> Floats:
    """Return points [N, 3] moved onto planes, without those in the sparsest places, [M, 3].

    `noise` is its standard deviation, `between` the spacing of the points.
    """
    wanted = round(SMOOTHING * (noise / between) ** 2)
    hops = min(max(wanted, FEWEST_HOPS), MOST_HOPS)
    for _ in range(_ROUNDS):
        (planes,) = fit_planes(points, (hops,))
        points = planes.flattened
    return dense_part(points, 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT), DENSITY_NEIGHBOURS)


def _nearest(state: _OrientedPoints, view: AnyView, size: int) -> tuple[Floats, Floats]:
    """Return depth and cosine [size, size] of the nearest point in each pixel.

    The cosine is that of the angle between the point's normal and the axis of view. A pixel without
    a point has an infinite depth and the cosine 1.
    """
    pixels, depth = project(state.points, view)
    pixels *= size / IMAGE_SIZE
    within = ((pixels >= 0) & (pixels < size)).all(axis=1)
    seen = np.flatnonzero((depth > NEAR) & within)
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

    The pixels within are those that a disc cannot reach without covering an occupied pixel; the
    outline lies a margin outside of them.

    radius, margin  in pixels
    """
    radius = max(radius, 1.0)
    margin = min(max(margin, 0.5), radius)  # so that a point far from all others covers a pixel
    border = int(np.ceil(radius)) + 1
    empty = np.pad(~occupied, border, constant_values=True)
    near = ndimage.distance_transform_edt(empty) <= radius
    depth = ndimage.distance_transform_edt(near)[border:-border, border:-border]
    return np.clip(depth - (radius - margin), 0.0, 1.0)


def _visible(depth: Floats, reach: float, tolerance: float) -> NDArray[np.bool_]:
    """Return in which pixels of a depth image [S, S] there is a point that nearer ones do not hide.

    A depth of inf says that a pixel has no point. What lies more than `tolerance` behind the closed
    depths is hidden.
    """
    return np.isfinite(depth) & (depth <= closed_depths(depth, reach) + tolerance)


def closed_depths(depth: Floats, reach: float) -> Floats:
    """Return a depth image [S, S] whose gaps are closed by nearer depths around.

    The image is dilated and eroded by `reach` pixels, at least 1. A depth of inf says that a pixel
    has no point; where nothing closes it, the result is the largest float.
    """
    border = int(np.ceil(max(reach, 1.0)))
    side, far = 2 * border + 1, np.finfo(np.float64).max
    padded = np.pad(np.minimum(depth, far), border, constant_values=far)
    closed = ndimage.maximum_filter(ndimage.minimum_filter(padded, side), side)
    return closed[border:-border, border:-border]


def pull_push(values: Floats, weights: Floats) -> Floats:
    """Return an image [S, S] whose pixels of weight below 1 are filled up from coarser images.

    values   [S, S]
    weights  [S, S], 0..1: the share of a value in its pixel; the rest comes from the coarser image.
             At least one is above 0
    """
    size = len(values)
    power_of_two = 1 << (size - 1).bit_length()
    beyond = power_of_two - size  # empty pixels, so that every size can be halved
    levels = [(np.pad(values * weights, (0, beyond)), np.pad(weights, (0, beyond)))]
    while len(levels[-1][0]) > 1:
        finer_total, finer_weight = levels[-1]
        total, weight = _sums_of_four(finer_total), _sums_of_four(finer_weight)
        scale = 1 / np.maximum(weight, 1.0)  # weights end at 1, where a pixel is full
        levels.append((total * scale, weight * scale))
    total, weight = levels.pop()
    image = total / weight
    for total, weight in reversed(levels):
        image = total + (1 - weight) * _doubled(image)
    return image[:size, :size]


def _sums_of_four(image: Floats) -> Floats:
    """Return an image of half the side whose pixels are the sums of 2 x 2 pixels."""
    half = len(image) // 2
    return image.reshape(half, 2, half, 2).sum(axis=(1, 3))


def _doubled(image: Floats) -> Floats:
    """Return an image of twice the side, interpolated linearly between pixel centres."""
    for _ in range(2):  # rows, then columns
        padded = np.pad(image, ((1, 1), (0, 0)), mode="edge")
        between = np.stack([padded[:-2] + 3 * image, padded[2:] + 3 * image], axis=1) / 4
        image = between.reshape(-1, image.shape[1]).T
    return image
