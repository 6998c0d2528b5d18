"""The peak signal-to-noise ratio of images, in decibels.

It is 10 log10(255^2 / MSE), where MSE is the mean squared error over all pixels and channels
(Huynh-Thu and Ghanbari, "Scope of validity of PSNR in image/video quality assessment", Electronics
Letters 44(13), 2008).

For identical images the ratio would be infinite, and so would every mean that includes it. They are
given the ratio of images that differ by one level in one channel of one pixel, which is the highest
of any images that differ: 20 log10(255) + 10 log10(H * W * C), or 95.05 dB for 128 x 128 x 3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.image_arrays import are_two_images, require_pairs, require_some

_PEAK = 255.0  # the largest value of a pixel


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the peak signal-to-noise ratio of two images, or of each pair of images; symmetric.

    The sum of squared differences is exact, so that a pair's ratio does not depend on how sums are
    ordered, nor on the other pairs.

    Parameters
    ----------
    a, b : uint8 array, [N, H, W, C] or [H, W, C]
        Images and their counterparts, with 1, 3 or 4 channels.

    Returns
    -------
    float64 array [N], or a number
        Ratio in dB, higher is better, from 0 (black against white) to 20 log10(255) +
        10 log10(H * W * C), which identical images have.

    Raises
    ------
    ValueError
        Where an array is not uint8 or of another shape (the channels come last), where the shapes
        differ, and where there is nothing to compare (a dimension of 0).
    """
    if are_two_images(a, b):
        return psnr(a[None], b[None])[0]
    require_pairs(a, b)
    require_some(a)
    squares = np.empty(len(a))
    apart = np.empty(a.shape[1:])
    for i in range(len(a)):
        np.subtract(a[i], b[i], out=apart, dtype=np.float64)
        # A sum of whole numbers, which is exact. `einsum` is used and no product of matrices, for
        # which the library would start threads.
        squares[i] = np.einsum("hwc,hwc->", apart, apart)
    return 10 * np.log10(_PEAK**2 * a[0].size / np.maximum(squares, 1.0))
