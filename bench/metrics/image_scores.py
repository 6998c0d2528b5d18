"""All scores of images against the true ones, named as the columns of a record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.silhouette import Pairs, overlap
from bench.metrics.structural_similarity import ssim_per_image_and_mask
from bench.metrics.thin_parts import thin_scores_of


def scores(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
    """Return scores [V] of images uint8 [V, H, W, 3]; NaN where an image has no such score.

    `ssim_object` is the mean of the SSIM map over the windows that contain a pixel of the true
    silhouette or of the drawn one. One map gives it and the four before it, and one pair of
    silhouettes it and those after it. Raises ValueError where an array is not uint8 or not
    [V, H, W, 3], where the shapes differ, and where there is nothing to compare.
    """
    pairs = Pairs(truth, images)
    drawn = pairs.drawn(pairs.shown)
    whole, of_object = ssim_per_image_and_mask(truth, images, pairs.shown | drawn)
    thin = thin_scores_of(pairs)
    return whole._asdict() | {
        "psnr": psnr(truth, images),
        "ssim_object": of_object,
        "silhouette_iou": overlap(pairs.shown, drawn),
        "thin_recall": thin.recall,
        "thin_precision": thin.precision,
    }
