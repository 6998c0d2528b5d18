"""The peak signal-to-noise ratio of images, in decibels.

10 log10(255^2 / MSE), the mean squared error over all pixels and channels (Huynh-Thu and Ghanbari,
"Scope of validity of PSNR in image/video quality assessment", Electronics Letters 44(13), 2008).

Identical images have no error and would be infinite, and so would every mean with one of them. They
count as if one channel of one pixel were one level off: 20 log10(255) + 10 log10(H * W * C), which
is 95.05 dB for 128 x 128 x 3, the most that any pair has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrics.structural_similarity import are_two_images, require_images

_PEAK = 255.0


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the peak signal-to-noise ratio of two images, or of pairs; symmetric.

    The sum of squares is exact, hence a value does not depend on the other images.

    Parameters
    ----------
    a, b : uint8 array, [N, H, W, C] or [H, W, C]
        Images and their counterparts.

    Returns
    -------
    float64 array [N], or a number
        Ratio in dB, higher is better, from 0 (black against white) to 20 log10(255) +
        10 log10(H * W * C), which identical images have.

    Raises
    ------
    ValueError
        Where an array is not uint8 or of another shape, where the shapes differ, and where there is
        nothing to compare (a dimension of 0).
    """
    if are_two_images(a, b):
        return psnr(a[None], b[None])[0]
    require_images(a, b)
    squares = np.empty(len(a))
    apart = np.empty(a.shape[1:])
    for i in range(len(a)):
        np.subtract(a[i], b[i], out=apart, dtype=np.float64)
        # Sums of whole numbers: exact. A product of BLAS would start threads for it.
        squares[i] = np.einsum("hwc,hwc->", apart, apart)
    return 10 * np.log10(_PEAK**2 * a[0].size / np.maximum(squares, 1.0))
