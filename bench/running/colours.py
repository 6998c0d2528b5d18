"""The colours of points on images that a method has drawn in grey, for users and for suites.

A grey image has the shading of a surface in neutral grey, and its coverage says how much of each
pixel the surface covers. The colours of the points that a camera sees are projected into the image,
and the gaps between them are filled from coarser images (`baselines.splat_fill`). A pixel is then
its shading times that colour, on white as far as it is not covered. The coverage is the method's
own, or guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.neighbourhoods import nearest_distance
from baselines.splat_fill import closed_depths, pull_push
from bench.catalogue.methods import Method
from data_prep.rendering.camera import NEAR, lens_of, origin_depth, project
from data_prep.rendering.images import to_float, to_uint8
from data_prep.scene import (
    IMAGE_SIZE,
    NEUTRAL_GREY,
    AnyView,
    Images,
    PointCloud,
    Renderer,
    UInt8Images,
    View,
)

# Chosen on 13 objects of procedural:validation (2,048 points clean and with noise of 5 %, 512, and
# 8,192 points), by LPIPS against images in the true colours; distances are in spacings, the median
# distance between a point and its nearest neighbour.
_COVERING = 2.5  # how far around itself, in the image, a point hides others
_BEHIND = 0.5  # a point farther than this behind the points that hide it gives no colour
_SHARE = 0.5  # weight of a point in its pixel: two points fill it, the rest comes from around
_MOST_COVERING_PX = 16.0  # in an image of IMAGE_SIZE: the most pixels that a point hides others in

COLOUR_FAMILY = "splat"  # methods of this family draw the colours of points themselves, as discs
# The darkness, 0 to 1, below which a pixel counts as background, which networks draw a little off
# white.
_BACKGROUND = 8 / 255
_EDGE_PX = 2  # the width in pixels of edges that networks draw; edges of meshes have one pixel


class Keeper:
    """A renderer that remembers what it made of the last cloud before it drew."""

    state: Any = None

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> Any:
        """Return the state that the renderer makes, and keep it."""
        self.state = self.renderer.prepare(cloud, rng)
        return self.state

    def draw(
        self, state: Any, views: Sequence[View], rng: np.random.Generator, **size: int
    ) -> Images:
        """Return the images that the renderer draws."""
        return self.renderer.draw(state, views, rng, **size)


def is_painted(method: Method, cloud: PointCloud) -> bool:
    """Return whether images that a method draws of a cloud get the colours of its points.

    They do where the cloud has colours and the method draws clouds in grey.
    """
    in_grey = method.sees_cloud and method.color == "none" and method.family != COLOUR_FAMILY
    return in_grey and cloud.colors is not None


def coverage_of(
    keeper: Keeper, method: Method, images: UInt8Images, views: Sequence[AnyView], batch: int
) -> tuple[NDArray[np.float32], tuple[str, ...]]:
    """Return how much of each pixel the surface covers, and a note where that is a guess.

    keeper  the renderer after it has drawn `images`, uint8 [V, S, S, 3]
    batch   how many views are asked for in one call

    The coverage is float32 [V, S, S], 0..1.
    """
    coverage: Any = getattr(keeper.renderer, "coverage", None)
    if coverage is None:
        note = f"{method.id}: tells no opacity; it is guessed from how dark a pixel is"
        return guessed_coverage(images), (note,)
    parts = []
    for first in range(0, len(views), batch):
        parts.append(coverage(keeper.state, views[first : first + batch], images.shape[1]))
    return np.concatenate(parts), ()


def in_colours(
    images: UInt8Images,
    coverage: NDArray[np.float32],
    cloud: PointCloud,
    views: Sequence[AnyView],
) -> UInt8Images:
    """Return images of a cloud that were drawn in grey, in the colours of its points.

    images    uint8 [V, S, S, 3], neutral grey on white
    coverage  float32 [V, S, S], 0..1: how much of each pixel the surface covers
    cloud     finite points [N, 3] with colours
    """
    spacing = nearest_distance(cloud.points)
    out = np.empty_like(images)
    for i, view in enumerate(views):
        uncovered = 1.0 - coverage[i, ..., None]
        shaded = np.clip(to_float(images[i]) - uncovered, 0.0, None) / (NEUTRAL_GREY[0] / 255)
        colours = colours_seen(cloud, spacing, view, len(images[i]))
        painted = np.clip(uncovered + colours * shaded, 0.0, 1.0)
        out[i] = to_uint8(painted.astype(np.float32))
    return out


def colours_seen(
    cloud: PointCloud, spacing: float, view: AnyView, size: int
) -> NDArray[np.float64]:
    """Return the colours of a cloud from a view, float64 [size, size, 3] in 0..1, without gaps.

    cloud    finite points [N, 3] with colours
    spacing  the distance between neighbouring points, as `nearest_distance` returns it

    A pixel whose points are seen has their mean colour, mixed with that of its surroundings; any
    other pixel has that of its surroundings. A view that shows no point is neutral grey.
    """
    if cloud.colors is None:
        raise ValueError("the cloud has no colours")
    zoom = size / IMAGE_SIZE
    pixels, depth = project(cloud.points, view)
    pixels = pixels * zoom
    inside = ((pixels >= 0) & (pixels < size)).all(axis=1) & (depth > NEAR)
    if not inside.any():
        return np.full((size, size, 3), NEUTRAL_GREY[0] / 255)
    column, row = pixels[inside].astype(np.intp).T
    pixel, depth, inks = row * size + column, depth[inside], to_float(cloud.colors[inside])
    nearest = np.full(size * size, np.inf)
    np.minimum.at(nearest, pixel, depth)
    spacing_px = zoom * spacing * lens_of(view).mean_focal / origin_depth(view)
    covering_px = min(_COVERING * spacing_px, zoom * _MOST_COVERING_PX)
    closed = closed_depths(nearest.reshape(size, size), covering_px).ravel()
    seen = depth <= closed[pixel] + _BEHIND * spacing
    counts = np.bincount(pixel[seen], minlength=size * size).reshape(size, size)
    weights = np.minimum(_SHARE * counts, 1.0)
    planes = []
    for channel in range(3):
        total = np.bincount(pixel[seen], inks[seen, channel], size * size).reshape(size, size)
        planes.append(pull_push(total / np.maximum(counts, 1), weights))
    return np.stack(planes, axis=-1)


def guessed_coverage(images: UInt8Images) -> NDArray[np.float32]:
    """Return the coverage, 0 to 1, that the pixels of images on white seem to have.

    images   [F, S, S, 3]
    returns  [F, S, S]

    White counts as background. Within _EDGE_PX of the background, a pixel counts as covered to the
    share that its darkness has of the darkness of the object beside it. Parts of an object that are
    thin and bright therefore come out half transparent.
    """
    return np.array([_guessed(image) for image in images], np.float32).reshape(images.shape[:3])


def _guessed(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    darkness, around = 1 - image.min(axis=-1) / 255, 2 * _EDGE_PX + 1
    within = minimum_filter(darkness, around) >= _BACKGROUND
    # The darkness of the object beside an edge is the mean over its inside near by. A thin part has
    # no inside; there the darkest pixel near by is taken.
    share = uniform_filter(within.astype(float), 2 * around - 1)
    inside = uniform_filter(darkness * within, 2 * around - 1) / np.maximum(share, 1e-9)
    beside = np.where(share > 1e-9, inside, maximum_filter(darkness, around))
    edge = np.minimum(darkness / np.maximum(beside, _BACKGROUND), 1.0)
    return np.where(within, 1.0, np.where(darkness < _BACKGROUND, darkness, edge))
