"""Structural similarity (SSIM) and its three components, by the protocol of the original.

Protocol (roatienza/pc2pix@23b7b46d:evaluation/msssim.py; Wang et al., "Image quality assessment:
from error visibility to structural similarity", IEEE TIP 13(4), 2004):

* The window is an 11 x 11 Gaussian with sigma 1.5, normalised. Only whole windows count ('valid',
  118 x 118 of 128 x 128). Where a side of the image is shorter than 11 pixels, the window shrinks
  to size = min(height, width) and sigma to size * 1.5 / 11; an even window is centred between
  pixels.
* Images are uint8 with range 255; K1 = 0.01, K2 = 0.03, C3 = C2 / 2. Moments are those of the
  population (biased), negative variances are taken as 0, and every channel is scored by itself.
* `luminance`, `contrast`, `structure` and `ssim` are each the plain mean over images, windows and
  channels. `ssim` is the mean of the product, not the product of the means.

Precision. E[x^2] - E[x]^2 in float64 has an error of up to 1e-11 for pixels of 0..255. To `ssim`
that is nothing. But `structure` divides by sqrt(v1 * v2) + C3, where v1 and v2 are the variances of
the two windows: if a flat window has the variance 1e-11 instead of 0 and the other one is busy (v2
about 1e4), the quotient moves by 1e-5. The least variance of a window that is not flat is that of
one corner pixel that is one level off: w (1 - w) with the smallest weight w, which is 1e-6 and so
five orders above the error. A window with less than half of this variance *is* flat, and its
variance and covariance are set to exactly 0. To keep the error small, the values of the pixels are
also taken relative to the one in the middle, which does not change the variance.

Speed. Windows in which both images are equal score exactly 1. So a pair is cut to the box in which
it differs, with a margin of one window around it. The box is blurred along columns and along rows
by a product with a banded matrix each. The score of an image does not depend on the other images,
bit for bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bench.metrics.image_arrays import are_two_images, require_pairs, require_some
from data_prep.arrays import Floats

WINDOW = 11  # the side of the window, in pixels
_SIGMA = 1.5  # the standard deviation of its Gaussian weights, in pixels
# The constants of the protocol that keep quotients finite in dark and in flat windows.
C1 = (0.01 * 255) ** 2
C2 = (0.03 * 255) ** 2
C3 = C2 / 2


class Ssim(NamedTuple):
    """The four scores, which are at most 1, and 1 for identical images.

    Each is a mean over all images, windows and channels.

    ssim       > -1; the mean of luminance * contrast * structure
    luminance  > 0
    contrast   > 0
    structure  > -1; negative where the images are inverse to each other
    """

    ssim: float
    luminance: float
    contrast: float
    structure: float


class _SsimPerImage(NamedTuple):
    """The four scores of each image, float64 [N]: means over its windows and channels."""

    ssim: Floats
    luminance: Floats
    contrast: Floats
    structure: Floats


def ssim(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> Ssim:
    """Return the structural similarity of two images, or of two stacks; symmetric.

    The module's docstring states the protocol. All images weigh the same.

    Parameters
    ----------
    a, b : uint8 array, [N, H, W, C] or [H, W, C]
        Images and their counterparts, with 1, 3 or 4 channels.

    Returns
    -------
    Ssim
        Means over images, windows and channels: at most 1, and 1 for identical images.

    Raises
    ------
    ValueError
        Where an array is not uint8 or of another shape (the channels come last), where the shapes
        differ, and where there is nothing to compare (a dimension of 0).
    """
    if are_two_images(a, b):
        return ssim(a[None], b[None])
    per_image = ssim_per_image(a, b)
    return Ssim(*(float(values.mean()) for values in per_image))


def ssim_per_image(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> _SsimPerImage:
    """Return the four scores of every pair of images, which do not depend on the other pairs.

    Raises as `ssim`.
    """
    require_pairs(a, b)
    require_some(a)
    return _score(a, b, None)[0]


def ssim_per_image_and_mask(
    a: NDArray[np.uint8], b: NDArray[np.uint8], masks: NDArray[np.bool_]
) -> tuple[_SsimPerImage, Floats]:
    """Return the four scores of every pair, and its mean `ssim` over the windows on a mask, [N].

    masks  bool [N, H, W], the mask of each pair

    A window is on the mask if it contains a pixel of it. The mean is NaN where the mask is empty.
    Raises as `ssim`, and ValueError where the masks are not bool or have another shape than the
    images.
    """
    require_pairs(a, b)
    require_some(a)
    if masks.dtype != np.bool_ or masks.shape != a.shape[:3]:
        raise ValueError(
            f"{list(a.shape)} images need bool masks {list(a.shape[:3])}, "
            f"got {masks.dtype} {list(masks.shape)}"
        )
    return _score(a, b, masks)


# By one thread, because products that threads share have other last digits.
@threadpool_limits.wrap(limits=1, user_api="blas")
def _score(
    a: NDArray[np.uint8], b: NDArray[np.uint8], masks: NDArray[np.bool_] | None
) -> tuple[_SsimPerImage, Floats]:
    """Return the four scores of every pair, and the mean `ssim` [N] over masks, NaN without."""
    n, height, width, channels = a.shape
    size = min(height, width, WINDOW)
    weights = _window_weights(size)
    n_windows = (height - size + 1) * (width - size + 1)
    means = np.ones((n, 4))  # the scores of equal images
    over_masks = np.full(n, np.nan)
    over = None if masks is None else _windows_over(masks, size)
    for i in range(n):
        counted = 0 if over is None else np.count_nonzero(over[i])  # windows on the mask
        if counted:
            over_masks[i] = 1.0
        box = _box_of_differences(a[i], b[i], size)
        if box is None:
            continue
        components = _components(a[i][box], b[i][box], weights)  # [4, channel, row, column]
        rows, columns = components.shape[2:]
        sums = components.sum(axis=(1, 2, 3)) / channels
        outside = n_windows - rows * columns  # windows outside the box, each of which scores 1
        means[i] = (sums + outside) / n_windows
        if over is not None and counted:
            top, left = (side.start for side in box)
            chosen = over[i, top : top + rows, left : left + columns]
            over_masks[i] -= (1.0 - components[0].mean(axis=0))[chosen].sum() / counted
    return _SsimPerImage(*np.ascontiguousarray(means.T)), over_masks


def _box_of_differences(
    a: NDArray[np.uint8], b: NDArray[np.uint8], size: int
) -> tuple[slice, slice] | None:
    """Return the box, as rows and columns, that all windows lie in where two images differ.

    size  the side of a window

    Returns None where the images are equal.
    """
    differs = (a != b).any(axis=-1)
    if not differs.any():
        return None
    sides = []
    for axis, length in enumerate(differs.shape):
        lines = np.flatnonzero(differs.any(axis=1 - axis))
        first, last = int(lines[0]), int(lines[-1])
        # A window whose last line is the first line that differs begins size - 1 lines before it.
        start = max(0, min(first - (size - 1), length - size))
        sides.append(slice(start, min(length, max(last + size, size))))
    return sides[0], sides[1]


def _components(a: NDArray[np.uint8], b: NDArray[np.uint8], weights: Floats) -> Floats:
    """Return ssim, luminance, contrast and structure of all windows, [4, C, rows, columns].

    a, b  the same part of two images, [H, W, C]
    """
    height, width = a.shape[:2]
    middle = height // 2, width // 2
    shifts = [image[middle].astype(np.float64)[:, None, None] for image in (a, b)]
    x, y = (
        image.transpose(2, 0, 1).astype(np.float64) - shift
        for image, shift in zip((a, b), shifts, strict=True)
    )
    down = _band_matrix(weights, height - len(weights) + 1)
    across = _band_matrix(weights, width - len(weights) + 1).T
    mean_x, mean_y, var_x, var_y, cov = down @ np.stack([x, y, x * x, y * y, x * y]) @ across
    var_x -= mean_x * mean_x
    var_y -= mean_y * mean_y
    cov -= mean_x * mean_y
    corner = float(weights[0]) ** 2
    for variance in (var_x, var_y):
        flat = variance <= corner * (1 - corner) / 2
        variance[flat] = 0.0
        cov[flat] = 0.0
    mean_x += shifts[0]
    mean_y += shifts[1]
    deviations = np.sqrt(var_x * var_y)
    luminance = (2 * mean_x * mean_y + C1) / (mean_x * mean_x + mean_y * mean_y + C1)
    contrast = (2 * deviations + C2) / (var_x + var_y + C2)
    structure = (cov + C3) / (deviations + C3)
    return np.stack([luminance * contrast * structure, luminance, contrast, structure])


def _windows_over(masks: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """Return which windows contain a pixel of masks [N, H, W].

    size  the side of a window

    A window has the index of its corner with the lowest row and column.
    """
    for _ in range(2):  # once along rows, and once along columns
        reach = 1  # an entry is true if one of so many pixels from it on is in the mask
        while reach < size:
            step = min(reach, size - reach)
            masks = masks[:, step:] | masks[:, :-step]
            reach += step
        masks = masks.swapaxes(1, 2)
    return masks


def _window_weights(size: int) -> Floats:
    """Return the one-dimensional factor of the Gaussian window, [size].

    Its sum is 1, and its first and last value are the smallest.
    """
    sigma = size * _SIGMA / WINDOW
    x = np.arange(size) - (size - 1) / 2
    weights = np.exp(-(x**2) / (2 * sigma**2))
    return weights / weights.sum()


def _band_matrix(weights: Floats, length: int) -> Floats:
    """Return the matrix [length, length + size - 1] that blurs a column of pixels.

    weights  [size], the factor of the window
    length   the number of windows in the column
    """
    matrix = np.zeros((length, length + len(weights) - 1))
    for i in range(length):
        matrix[i, i : i + len(weights)] = weights
    return matrix
