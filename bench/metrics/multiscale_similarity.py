"""Multi-scale structural similarity, in a variant for images of 128 x 128.

Source: Wang, Simoncelli and Bovik, "Multi-scale structural similarity for image quality
assessment", Asilomar 2003. At every scale the contrast and structure of SSIM are compared, at the
coarsest the luminance as well; the means of the scales are multiplied, each to the power of its
weight. From scale to scale an image is averaged over 2 x 2 pixels.

Variant:

* Four scales for 128 x 128: a fifth would be of 8 x 8 pixels, where no window of 11 is whole. In
  general as many as have a side of 11, at least one and at most five. The published weights of the
  scales that there are, divided by their sum (for four .8667), so that the powers add up to 1.
* Windows, constants and channels as `bench.metrics.structural_similarity`: 11 x 11, sigma 1.5,
  whole windows only, every channel by itself; the mean of a scale is over windows and channels.
* A scale whose mean is negative counts as 0: a negative number has no real power.
* An odd last row or column has no partner and is left out of the next scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.structural_similarity import (
    C1,
    C2,
    WINDOW,
    band_matrix,
    require_images,
    window_weights,
)
from data_prep.arrays import Floats

WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # from the finest scale to the coarsest


def ms_ssim(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> Floats:
    """Return the similarity [N], 0..1, of pairs of images uint8 [N, H, W, C]; symmetric.

    1 for identical images, and 0 where a scale of one is inverse to that of the other. Of images of
    one colour only the luminance counts. A value does not depend on the other images. Raises as
    `bench.metrics.structural_similarity.ssim`.
    """
    require_images(a, b)
    weights = scale_weights(min(a.shape[1:3]))
    values = np.ones(len(a))
    for i, pair in enumerate(zip(a, b, strict=True)):
        x, y = (image.transpose(2, 0, 1).astype(np.float64) for image in pair)
        for weight in weights:
            similarity, structure = _means(x, y)
            coarsest = weight == weights[-1]
            values[i] *= max(similarity if coarsest else structure, 0.0) ** weight
            x, y = _halved(x), _halved(y)
    return values


def scale_weights(side: int) -> tuple[float, ...]:
    """Return the weight of each scale of images whose shorter side has so many pixels; sum 1."""
    scales = 1
    while scales < len(WEIGHTS) and side >> scales >= WINDOW:
        scales += 1
    return tuple(weight / sum(WEIGHTS[:scales]) for weight in WEIGHTS[:scales])


def _means(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the means of SSIM, and of its contrast and structure, of planes [C, H, W]."""
    size = min(*x.shape[1:], WINDOW)
    weights = window_weights(size)
    down, across = (band_matrix(weights, side - size + 1) for side in x.shape[1:])
    fields = np.matmul(np.matmul(down, np.stack([x, y, x * x, y * y, x * y])), across.T)
    mean_x, mean_y, var_x, var_y, cov = fields
    var_x -= mean_x**2
    var_y -= mean_y**2
    cov -= mean_x * mean_y
    structure = (2 * cov + C2) / (var_x + var_y + C2)
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    return float((luminance * structure).mean()), float(structure.mean())


def _halved(planes: Floats) -> Floats:
    """Return planes [C, H, W] averaged over 2 x 2 pixels."""
    channels, height, width = planes.shape
    whole = planes[:, : height // 2 * 2, : width // 2 * 2]
    return whole.reshape(channels, height // 2, 2, width // 2, 2).mean(axis=(2, 4))
