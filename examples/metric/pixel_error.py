"""A metric for pc2pix-bench: the mean difference of pixels."""

import numpy as np

from bench.catalogue.plugins import ImageMetric


def pixel_error(truth, drawn):
    """Return the mean absolute difference in grey levels, [V], of images uint8 [V, 128, 128, 3]."""
    return np.abs(truth.astype(np.float64) - drawn).mean(axis=(1, 2, 3))


METRIC = ImageMetric(
    "pixel-error",
    score=pixel_error,
    version=1,  # raised when a change here alters its values
    higher_is_better=False,
    about="mean absolute difference of pixels in grey levels; 0 is identical",
)
