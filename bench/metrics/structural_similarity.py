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
variance and covariance are exactly 0. Moreover every tile of an image is centred on its own middle
pixel (moments about any point give the same variance): what rounding is left goes with the contrast
nearby, not with the brightness.

Speed. The images are cut into tiles of at most 24 x 24 windows, whose fields stay in the cache. The
separable blur of a tile is products with a banded matrix, 8 windows at a time: the band of all 24
would be zeros for two thirds, that of 8 is for less than half. Tiles where both images agree score
exactly 1 and are not computed: with a white background, a third of them. A tile is computed by the
same operations wherever it stands in a batch, so an image's value does not depend on its company,
bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from data_prep.arrays import Floats

WINDOW = 11
_SIGMA = 1.5
C1 = (0.01 * 255) ** 2
C2 = (0.03 * 255) ** 2
C3 = C2 / 2
_FACTORS = np.array([4.0, 2.0, 2.0, 1.0])  # of ssim, luminance, contrast, structure

_TILE = 24  # windows along a side of a tile, at most; 20-30 are equally fast
_STEP = 8  # windows that one band blurs; a divisor of _TILE
_CHUNK = 5  # tiles in one go: their five fields (0.7 MB) stay in a second-level cache


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
    per_image, _ = _score(a, b, None)
    return per_image


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


def _score(
    a: NDArray[np.uint8], b: NDArray[np.uint8], masks: NDArray[np.bool_] | None
) -> tuple[_SsimPerImage, Floats]:
    n, height, width, channels = a.shape
    size = min(height, width, WINDOW)
    weights = window_weights(size)
    corner = float(weights[0]) ** 2
    rows = _Cut(height - size + 1, size)
    columns = _Cut(width - size + 1, size)
    blur = _TileBlur(weights, rows, columns, channels, flat_below=corner * (1 - corner) / 2)

    n_tiles = len(rows.starts) * len(columns.starts)
    # [tile, window row, window column]: 1, or 0 where a tile repeats windows of its neighbour
    counted = np.einsum("ir,jc->ijrc", rows.counted, columns.counted)
    counted = counted.reshape(n_tiles, rows.length, columns.length)
    windows_per_tile = counted.sum(axis=(1, 2)) * channels

    tiles = np.empty((2, n_tiles, rows.extent, channels, columns.extent), dtype=np.uint8)
    # [tile, window row * channel * window column], as the fields lie in memory
    weights_of = np.repeat(counted[:, :, None], channels, axis=2).reshape(n_tiles, -1)
    means = np.empty((n, 4))
    over_masks = np.full(n, np.nan)
    over = None if masks is None else _windows_over(masks, size)
    inside = np.zeros_like(counted)
    for i in range(n):
        _cut_tiles(a[i], rows, columns, out=tiles[0])
        _cut_tiles(b[i], rows, columns, out=tiles[1])
        differs = (tiles[0] != tiles[1]).reshape(n_tiles, -1).any(axis=1)
        sums = np.repeat(windows_per_tile[:, None], 4, axis=1)  # identical: every component is 1
        if over is not None:
            for tile, (y, x) in zip(inside, _corners(rows, columns), strict=True):
                tile[...] = over[i, y : y + rows.length, x : x + columns.length]
            inside *= counted
        mask_sums = inside.sum(axis=(1, 2)) * channels
        n_inside = mask_sums.sum()
        different = np.flatnonzero(differs)
        for start in range(0, len(different), _CHUNK):
            chunk = different[start : start + _CHUNK]
            sums[chunk] = blur.component_sums(tiles[:, chunk], weights_of[chunk])
            if mask_sums[chunk].any():
                mask_sums[chunk] = blur.sums_of_last(inside[chunk])
        means[i] = sums.sum(axis=0) / windows_per_tile.sum()
        if n_inside:
            over_masks[i] = mask_sums.sum() / n_inside
    return _SsimPerImage(*np.ascontiguousarray(means.T)), over_masks


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


def window_weights(size: int) -> Floats:
    """Return the 1-d factor of the Gaussian window, sum 1, smallest value first and last."""
    sigma = size * _SIGMA / WINDOW
    x = np.arange(size) - (size - 1) / 2
    weights = np.exp(-(x**2) / (2 * sigma**2))
    return weights / weights.sum()


class _Cut:
    """The cut of one side of an image into tiles of equal length.

    starts   first window (and first pixel) of each tile
    length   windows of a tile
    step     windows that one band blurs; a divisor of `length`
    extent   pixels of a tile
    counted  float64 [tiles, length], 0 where the last tile repeats windows of the one before
    """

    def __init__(self, n_windows: int, size: int) -> None:
        n_tiles = -(-n_windows // _TILE)
        self.length = -(-n_windows // n_tiles)
        whole_steps = -(-self.length // _STEP) * _STEP
        if whole_steps <= n_windows:
            self.length, self.step = whole_steps, _STEP
        else:
            self.step = self.length
        self.extent = self.length + size - 1
        self.starts = [min(i * self.length, n_windows - self.length) for i in range(n_tiles)]
        self.counted = np.ones((n_tiles, self.length))
        self.counted[-1, : n_tiles * self.length - n_windows] = 0.0


def _corners(rows: _Cut, columns: _Cut) -> Iterator[tuple[int, int]]:
    """Return the first pixel, and the first window, of each tile."""
    return ((y, x) for y in rows.starts for x in columns.starts)


def _cut_tiles(image: NDArray[np.uint8], rows: _Cut, columns: _Cut, out: NDArray[np.uint8]) -> None:
    """Cut an image [H, W, C] into tiles [tile, row, C, column]: the blur runs along rows."""
    planes = np.ascontiguousarray(image.transpose(0, 2, 1))
    for tile, (y, x) in zip(out, _corners(rows, columns), strict=True):
        tile[...] = planes[y : y + rows.extent, :, x : x + columns.extent]


def band_matrix(weights: Floats, length: int) -> Floats:
    """Return the matrix [length, length + size - 1] that blurs a column of pixels."""
    matrix = np.zeros((length, length + len(weights) - 1))
    for i in range(length):
        matrix[i, i : i + len(weights)] = weights
    return matrix


class _TileBlur:
    """The arithmetic of up to `_CHUNK` tiles, with its memory.

    The buffers are allocated once: fresh ones of this size go back to the system after every use,
    and faulting them in again costs twice the arithmetic.
    """

    def __init__(
        self, weights: Floats, rows: _Cut, columns: _Cut, channels: int, flat_below: float
    ) -> None:
        self._down = band_matrix(weights, rows.step)
        self._across = np.ascontiguousarray(band_matrix(weights, columns.step).T)
        self._flat_below = flat_below
        # a, b, a * a, b * b, a * b as pixels, blurred down, blurred down and across
        self._pixels = np.empty((5, _CHUNK, rows.extent, channels, columns.extent))
        self._half = np.empty((5, _CHUNK, rows.length, channels, columns.extent))
        self._blurred = np.empty((5, _CHUNK, rows.length, channels, columns.length))
        self._components = np.empty((4, _CHUNK, rows.length, channels, columns.length))
        # The same memory as the bands see it: overlapping steps, one product each.
        n_pixels = channels * columns.extent
        self._steps_of_pixels = _steps(
            self._pixels.reshape(5, _CHUNK, rows.extent, n_pixels), axis=2, cut=rows
        )
        self._half_by_steps = self._half.reshape(5, _CHUNK, -1, rows.step, n_pixels)
        lines = rows.length * channels
        self._steps_of_half = _steps(
            self._half.reshape(5, _CHUNK, lines, columns.extent), axis=3, cut=columns
        )
        self._blurred_by_steps = self._blurred.reshape(5, _CHUNK, lines, -1, columns.step).swapaxes(
            2, 3
        )

    def component_sums(self, tiles: NDArray[np.uint8], weights: Floats) -> Floats:
        """Return weighted sums over windows, [tile, (ssim, luminance, contrast, structure)].

        tiles    uint8 [2, tile, row, channel, column]: the tiles of both images
        weights  float64 [tile, window row * channel * window column]
        """
        n = tiles.shape[1]
        mean_a, mean_b, var_a, var_b, cov = self._moments(tiles)
        for field in (var_a, var_b):
            flat = field <= self._flat_below
            if flat.any():
                np.putmask(field, flat, 0.0)
                np.putmask(cov, flat, 0.0)

        total, luminance, contrast, structure = self._components[:, :n]
        # In place, because a fresh array for every intermediate result would cost more than the
        # operation itself; and of each numerator 2 (...) the factor is left to the sums, which is
        # exact.
        np.multiply(mean_a, mean_b, out=luminance)
        luminance += C1 / 2
        mean_a *= mean_a
        mean_b *= mean_b
        mean_a += mean_b
        mean_a += C1
        luminance /= mean_a  # (2 m_a m_b + C1) / (m_a^2 + m_b^2 + C1) / 2

        np.multiply(var_a, var_b, out=structure)  # a buffer that is free as yet, as is mean_b
        deviations = np.sqrt(structure, out=mean_b)
        deviations += C3
        var_a += var_b
        var_a += C2
        np.divide(deviations, var_a, out=contrast)  # (2 s_a s_b + C2) / (v_a + v_b + C2) / 2

        np.add(cov, C3, out=structure)
        structure /= deviations  # (cov + C3) / (s_a s_b + C3)

        np.multiply(luminance, contrast, out=total)
        total *= structure
        sums = np.vecdot(self._components[:, :n].reshape(4, n, -1), weights)
        return (sums * _FACTORS[:, None]).T

    def sums_of_last(self, counted: Floats) -> Floats:
        """Return sums of ssim [tile] over other windows of the last tiles of `component_sums`.

        counted  float64 [tile, window row, window column]
        """
        sums = np.einsum("trcx,trx->t", self._components[0, : len(counted)], counted)
        return sums * _FACTORS[0]

    def _moments(self, tiles: NDArray[np.uint8]) -> Floats:
        """Return means, variances and covariance [5, tile, window row, channel, window column]."""
        n, extent, across = (tiles.shape[axis] for axis in (1, 2, 4))
        pixels = self._pixels[:, :n]
        middle = tiles[:, :, extent // 2, None, :, across // 2, None].astype(np.float64)
        pixels[:2] = tiles
        pixels[:2] -= middle.repeat(across, axis=-1)  # in full: NumPy is slow along short axes
        np.multiply(pixels[0], pixels[0], out=pixels[2])
        np.multiply(pixels[1], pixels[1], out=pixels[3])
        np.multiply(pixels[0], pixels[1], out=pixels[4])
        np.matmul(self._down, self._steps_of_pixels[:, :n], out=self._half_by_steps[:, :n])
        np.matmul(self._steps_of_half[:, :n], self._across, out=self._blurred_by_steps[:, :n])
        blurred = self._blurred[:, :n]
        mean_a, mean_b, var_a, var_b, cov = blurred
        product = self._components[0, :n]  # free as yet
        for moment, left, right in (
            (var_a, mean_a, mean_a),
            (var_b, mean_b, mean_b),
            (cov, mean_a, mean_b),
        ):
            np.multiply(left, right, out=product)
            moment -= product
        blurred[:2] += middle.repeat(blurred.shape[-1], axis=-1)
        return blurred


def _steps(field: Floats, axis: int, cut: _Cut) -> Floats:
    """Return the pixels that each band of a tile takes, [5, tile, band, ...].

    Those of neighbouring bands overlap along `axis`.

    field  [5, tile, pixel row, pixel column]
    """
    reach = cut.extent - cut.length + cut.step
    windows = sliding_window_view(field, reach, axis=axis)  # a new last axis
    if axis == 2:
        return windows[:, :, :: cut.step].swapaxes(3, 4)
    return windows[:, :, :, :: cut.step].swapaxes(2, 3)
