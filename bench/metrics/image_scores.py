"""All scores of images against the true ones, named as the columns of a record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.silhouette import object_boxes, silhouette_iou
from bench.metrics.structural_similarity import ssim_per_image_and_box
from bench.metrics.thin_parts import thin_scores


def scores(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
    """Scores [V] of images uint8 [V, H, W, 3]; NaN where an image has no such score.

    One SSIM map gives the first five.
    """
    whole, in_box = ssim_per_image_and_box(truth, images, object_boxes(truth))
    thin = thin_scores(truth, images)
    return whole._asdict() | {
        "ssim_object": in_box,
        "silhouette_iou": silhouette_iou(truth, images),
        "thin_recall": thin.recall,
        "thin_precision": thin.precision,
    }
