"""Images of the points of a cloud as dots, to show what a method was given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import random_rows
from data_prep.rendering.camera import CAMERA_DISTANCE, project
from data_prep.scene import IMAGE_SIZE, Points, View

MOST_DOTS = 4096  # the most dots in an image: more would cover all pixels of an object
# The grey levels, 0..255, of dots at the nearest and at the farthest point of the unit sphere.
NEAR_GREY, FAR_GREY = 20.0, 190.0


def draw_dots(points: Points, views: Sequence[View]) -> NDArray[np.uint8]:
    """Draw each of the points [N, 3] as one pixel, nearer points darker.

    Return uint8 [V, IMAGE_SIZE, IMAGE_SIZE, 3]. Of a larger cloud MOST_DOTS points are chosen at
    random, the same ones each time. Points that are not finite, outside of the image or behind the
    camera are left out.
    """
    finite = points[np.isfinite(points).all(axis=1)]
    finite = finite[random_rows(len(finite), MOST_DOTS)]
    images = np.full((len(views), IMAGE_SIZE, IMAGE_SIZE, 3), 255, np.uint8)
    for image, view in zip(images, views, strict=True):
        pixels, depth = project(finite, view)
        inside = (depth > 0) & ((pixels >= 0) & (pixels < IMAGE_SIZE)).all(axis=1)
        pixels, depth = pixels[inside], depth[inside]
        order = np.argsort(
            -depth, kind="stable"
        )  # from far to near, so that nearer dots cover farther ones
        column, row = np.floor(pixels[order]).astype(np.int64).T
        share = np.clip((depth[order] - (CAMERA_DISTANCE - 1)) / 2, 0.0, 1.0)
        grey = np.rint(NEAR_GREY + (FAR_GREY - NEAR_GREY) * share).astype(np.uint8)
        image[row, column] = grey[:, None]
    return images
