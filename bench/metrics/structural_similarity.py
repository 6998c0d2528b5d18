"""Structural similarity and its three components, after the protocol of the original.

Protocol (roatienza/pc2pix@23b7b46d:evaluation/msssim.py; Wang et al., "Image quality assessment:
from error visibility to structural similarity", IEEE TIP 13(4), 2004):

* window: 11 x 11 Gaussian, sigma 1.5, normalised; only whole windows count ('valid', 118 x 118 of
  128 x 128). Where a side is shorter than 11 the window shrinks to size = min(height, width) and
  sigma to size * 1.5 / 11; an even window is centred between pixels.
* uint8 images, range 255, K1 = 0.01, K2 = 0.03, C3 = C2 / 2, population (biased) moments, negative
  variances taken as 0; every channel by itself.
* `luminance`, `contrast`, `structure` and `ssim` are each the plain mean over images, windows and
  channels. `ssim` is the mean of the product, not the product of the means.

Precision. E[x^2] - E[x]^2 in float64 errs by up to 1e-11 on the scale 0..255. That is nothing to
`ssim`, but `structure` divides by sqrt(v1 * v2) + C3: against a busy window (v2 about 1e4), a flat
window whose variance comes out as 1e-11 instead of 0 moves it by 1e-5. The least variance of a
window that is not flat is that of one corner pixel one level off: w (1 - w) with w the smallest
weight, 1e-6, five orders above the rounding. So what lies below half of that *is* flat, and its
variance and covariance are exactly 0. Moreover the
pixels are taken from the one in the middle (moments about any point give the same variance).

Speed. Windows in which both images agree score exactly 1, so a pair is cut to the box in which it
differs, and a window's reach around it. The separable blur of the box is two products with banded
matrices. An image's value does not depend on its company, bit for bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from data_prep.arrays import Floats

WINDOW = 11
_SIGMA = 1.5
C1 = (0.01 * 255) ** 2
C2 = (0.03 * 255) ** 2
C3 = C2 / 2


class Ssim(NamedTuple):
    """The means over all images, windows and channels, at most 1; 1 for identical images.

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
    """The fields of `Ssim`, float64 [N] each: means over the windows and channels of one image."""

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
        Images and their counterparts.

    Returns
    -------
    Ssim
        Means over images, windows and channels: at most 1, and 1 for identical images.

    Raises
    ------
    ValueError
        Where an array is not uint8 or of another shape, where the shapes differ, and where there is
        nothing to compare (a dimension of 0).
    """
    if are_two_images(a, b):
        return ssim(a[None], b[None])
    per_image = ssim_per_image(a, b)
    return Ssim(*(float(values.mean()) for values in per_image))


def ssim_per_image(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> _SsimPerImage:
    """Return `ssim` of every pair of images, which does not depend on the others."""
    require_images(a, b)
    return _score(a, b, None)[0]


def ssim_per_image_and_mask(
    a: NDArray[np.uint8], b: NDArray[np.uint8], masks: NDArray[np.bool_]
) -> tuple[_SsimPerImage, Floats]:
    """Return `ssim_per_image`, and the mean `ssim` [N] of the windows over a mask, from one map.

    masks  bool [N, H, W], one per pair, in pixels

    A window counts if it contains a pixel of the mask. NaN where the mask is empty. Raises as
    `ssim`, and ValueError where the masks are not bool or not [N, H, W] of the images.
    """
    require_images(a, b)
    if masks.dtype != np.bool_ or masks.shape != a.shape[:3]:
        raise ValueError(
            f"{list(a.shape)} images need bool masks {list(a.shape[:3])}, "
            f"got {masks.dtype} {list(masks.shape)}"
        )
    return _score(a, b, masks)


# Products that threads share have other last digits.
@threadpool_limits.wrap(limits=1, user_api="blas")
def _score(
    a: NDArray[np.uint8], b: NDArray[np.uint8], masks: NDArray[np.bool_] | None
) -> tuple[_SsimPerImage, Floats]:
    n, height, width, channels = a.shape
    size = min(height, width, WINDOW)
    weights = _window_weights(size)
    n_windows = (height - size + 1) * (width - size + 1)
    means = np.ones((n, 4))
    over_masks = np.full(n, np.nan)
    over = None if masks is None else _windows_over(masks, size)
    for i in range(n):
        counted = 0 if over is None else np.count_nonzero(over[i])
        if counted:
            over_masks[i] = 1.0
        box = _box_of_differences(a[i], b[i], size)
        if box is None:
            continue
        components = _components(a[i][box], b[i][box], weights)  # [4, channel, row, column]
        rows, columns = components.shape[2:]
        sums = components.sum(axis=(1, 2, 3)) / channels
        means[i] = (sums + (n_windows - rows * columns)) / n_windows
        if over is not None and counted:
            top, left = (side.start for side in box)
            chosen = over[i, top : top + rows, left : left + columns]
            over_masks[i] -= (1.0 - components[0].mean(axis=0))[chosen].sum() / counted
    return _SsimPerImage(*np.ascontiguousarray(means.T)), over_masks


def _box_of_differences(
    a: NDArray[np.uint8], b: NDArray[np.uint8], size: int
) -> tuple[slice, slice] | None:
    """Return rows and columns of the pixels of all windows in which two images differ.

    None where they are equal.
    """
    differs = (a != b).any(axis=-1)
    if not differs.any():
        return None
    sides = []
    for axis, length in enumerate(differs.shape):
        lines = np.flatnonzero(differs.any(axis=1 - axis))
        first, last = int(lines[0]), int(lines[-1])
        # A window that has the first such pixel at its end begins size - 1 before it.
        start = max(0, min(first - (size - 1), length - size))
        sides.append(slice(start, min(length, max(last + size, size))))
    return sides[0], sides[1]


def _components(a: NDArray[np.uint8], b: NDArray[np.uint8], weights: Floats) -> Floats:
    """Return ssim, luminance, contrast and structure of all windows, [4, C, rows, columns].

    a, b  parts of two images, [H, W, C], of whole windows
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
    """Return the windows of side `size` that contain a pixel of masks [N, H, W].

    They are indexed by their corner.
    """
    for _ in range(2):  # along rows, then along columns
        reach = 1  # pixels that an entry stands for
        while reach < size:
            step = min(reach, size - reach)
            masks = masks[:, step:] | masks[:, :-step]
            reach += step
        masks = masks.swapaxes(1, 2)
    return masks


def are_two_images(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> bool:
    """Return whether both are [H, W, C]; three axes that end in a width are a stack in grey."""
    return a.ndim == b.ndim == 3 and a.shape[-1] <= 4


def require_images(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> None:
    """Raise ValueError unless both are uint8 [N, H, W, C] of the same shape, with something in."""
    shapes = f"{a.dtype} {list(a.shape)} and {b.dtype} {list(b.shape)}"
    if a.dtype != np.uint8 or b.dtype != np.uint8:
        raise ValueError(f"images must be uint8 (range 0..255), got {shapes}")
    if a.ndim != 4 or b.ndim != 4:
        raise ValueError(f"images must be [N, H, W, C], got {shapes}")
    if a.shape != b.shape:
        raise ValueError(f"stacks of images must have the same shape, got {shapes}")
    if a.size == 0:
        raise ValueError(f"nothing to compare, got {shapes}")


def _window_weights(size: int) -> Floats:
    """Return the 1-d factor of the Gaussian window, sum 1, smallest value first and last."""
    sigma = size * _SIGMA / WINDOW
    x = np.arange(size) - (size - 1) / 2
    weights = np.exp(-(x**2) / (2 * sigma**2))
    return weights / weights.sum()


def _band_matrix(weights: Floats, length: int) -> Floats:
    """Return the matrix [length, length + size - 1] that blurs a column of pixels."""
    matrix = np.zeros((length, length + len(weights) - 1))
    for i in range(length):
        matrix[i, i : i + len(weights)] = weights
    return matrix
