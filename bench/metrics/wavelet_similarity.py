"""Complex-wavelet structural similarity, which hardly notices small shifts and turns.

Source: Sampat, Wang, Gupta, Bovik and Markey, "Complex wavelet structural similarity: a new image
similarity index", IEEE TIP 18(11), 2009. A shift of an object turns the phases of the coefficients
of a complex wavelet, all by the same angle, and leaves their magnitudes. So the coefficients x and
y of two images are compared by (2 |sum x y*| + K) / (sum |x|^2 + sum |y|^2 + K) over a window.

Variant, with the defaults of the authors' code (`cwssim_index.m`) but for K and colour:

* Complex steerable pyramid (Portilla and Simoncelli 2000) of 4 levels and 8 orientations, of which
  the coarsest level is compared: of 128 x 128 pixels, 16 x 16 coefficients for structures of 16 to
  64 pixels. Windows of 7 x 7 coefficients; their mean is weighted by a Gaussian about the centre of
  the image, whose sigma is a quarter of its height; the mean over orientations is a plain one.
* K = 1, the square of one grey level, and sums are means over the window. With 0, as there, images
  of one colour have no value, and far from an object the last digits would be compared. The
  coefficients of that code grow fourfold from level to level: in its units K is 4^6.
* Every channel by itself, as in `bench.metrics.structural_similarity`; there the luma is compared.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bench.metrics.structural_similarity import require_images
from data_prep.arrays import Floats

LEVELS, ORIENTATIONS = 4, 8
WINDOW = 7  # coefficients
K = 1.0
_LEAST_SIDE = 64  # pixels: below, the window is larger than the coarsest level


def cw_ssim(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> Floats:
    """Return the similarity [N], 0..1, of pairs of images uint8 [N, H, W, C]; symmetric.

    1 for identical images, and for any two of one colour each, whose bands are empty. A value does
    not depend on the other images. Raises as `bench.metrics.structural_similarity.ssim`, and
    ValueError for sides that are not multiples of 8 or below 64.
    """
    require_images(a, b)
    height, width = a.shape[1:3]
    if min(height, width) < _LEAST_SIDE or height % 8 or width % 8:
        raise ValueError(f"sides must be multiples of 8, at least {_LEAST_SIDE}, got {a.shape}")
    filters = _filters(height, width)
    weights = _window_weights(*filters.shape[1:])
    values = np.empty(len(a))
    for i, pair in enumerate(zip(a, b, strict=True)):
        x, y = (_bands(image, filters) for image in pair)
        product = x * y.conj()
        energy = x.real**2 + x.imag**2 + y.real**2 + y.imag**2
        similarity = (2 * np.abs(_box_mean(product)) + K) / (_box_mean(energy) + K)
        values[i] = (similarity * weights).sum(axis=(2, 3)).mean()
    return values


def _bands(image: NDArray[np.uint8], filters: Floats) -> NDArray[np.complex128]:
    """Return the coarsest coefficients [C, orientation, row, column] of an image [H, W, C]."""
    height, width = filters.shape[1:]
    spectrum = np.fft.fft2(image.transpose(2, 0, 1))
    # Of the low frequencies alone the inverse transform is the filtered image at fewer places.
    low = spectrum[:, _frequencies(height)[:, None], _frequencies(width)]
    low *= height * width / spectrum[0].size
    return np.fft.ifft2(low[:, None] * filters)


def _box_mean(fields: NDArray[np.inexact]) -> NDArray[np.inexact]:
    """Return the means over whole windows of the last two axes."""
    along = sliding_window_view(fields, WINDOW, axis=-2).mean(axis=-1)
    return sliding_window_view(along, WINDOW, axis=-1).mean(axis=-1)


@lru_cache(4)
def _window_weights(height: int, width: int) -> Floats:
    """Return the weights of the windows of a level of this size; sum 1."""
    sigma = height / 4
    rows, columns = (np.arange(n) - (n - 1) / 2 for n in (height - WINDOW + 1, width - WINDOW + 1))
    weights = np.exp(-(rows[:, None] ** 2 + columns**2) / (2 * sigma**2))
    return weights / weights.sum()


@lru_cache(4)
def _filters(height: int, width: int) -> Floats:
    """Return the filters of the coarsest level, [orientation, row, column], in the order of FFTs.

    Frequencies are counted in octaves below that of two pixels; a transition is a quarter of a
    cosine's period over one octave. The coarsest level is between the transitions at -LEVELS and
    at 1 - LEVELS; the one before cuts the corners.
    """
    shrink = 2 ** (LEVELS - 1)
    rows, columns = (_frequencies(n // shrink) / (n / 2) for n in (height, width))  # 1: two pixels
    radius = np.hypot(rows[:, None], columns)
    radius[0, 0] = 2 / width  # no logarithm of 0: the mean of an image is stopped anyway
    octave = np.log2(radius)
    radial = _rise(octave + LEVELS) * np.prod(
        [_rise(-octave - 1 - fewer) for fewer in range(LEVELS)], axis=0
    )
    angle = np.arctan2(rows[:, None], columns)
    order = ORIENTATIONS - 1
    scale = 2 * 2**order * factorial(order) / np.sqrt(ORIENTATIONS * factorial(2 * order))
    turned = angle - np.pi * np.arange(ORIENTATIONS)[:, None, None] / ORIENTATIONS
    return scale * np.maximum(np.cos(turned), 0.0) ** order * radial


def _frequencies(count: int) -> NDArray[np.intp]:
    """Return the whole frequencies of a transform of so many values, in its order."""
    return (np.arange(count) + count // 2) % count - count // 2


def _rise(octave: Floats) -> Floats:
    """Return a transition from 0 at -1 to 1 at 0, whose square and its mirror's add up to 1."""
    return np.sin(np.clip(octave + 1, 0.0, 1.0) * np.pi / 2)
