"""Images of the points of a cloud as dots: the input of a method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import random_rows
from data_prep.rendering.camera import CAMERA_DISTANCE, project
from data_prep.scene import IMAGE_SIZE, Points, View

MOST_DOTS = 4096  # more cover the pixels of an image, and then it shows a silhouette
NEAR_GREY, FAR_GREY = 20.0, 190.0  # at the nearest and farthest point of the unit sphere


def draw_dots(points: Points, views: Sequence[View]) -> NDArray[np.uint8]:
    """Draw points [N, 3] as a pixel each, nearer ones darker: [V, IMAGE_SIZE, IMAGE_SIZE, 3].

    Of a larger cloud MOST_DOTS points are chosen at random, the same each time. Points that are not
    finite, out of the image or not before the camera are left out.
    """
    finite = points[np.isfinite(points).all(axis=1)]
    finite = finite[random_rows(len(finite), MOST_DOTS)]
    images = np.full((len(views), IMAGE_SIZE, IMAGE_SIZE, 3), 255, np.uint8)
    for image, view in zip(images, views, strict=True):
        pixels, depth = project(finite, view)
        inside = (depth > 0) & ((pixels >= 0) & (pixels < IMAGE_SIZE)).all(axis=1)
        pixels, depth = pixels[inside], depth[inside]
        order = np.argsort(-depth, kind="stable")  # far to near: the nearer dot stays
        column, row = np.floor(pixels[order]).astype(np.int64).T
        share = np.clip((depth[order] - (CAMERA_DISTANCE - 1)) / 2, 0.0, 1.0)
        grey = np.rint(NEAR_GREY + (FAR_GREY - NEAR_GREY) * share).astype(np.uint8)
        image[row, column] = grey[:, None]
    return images
