"""Losses between drawn images and true ones: SSIM, and a weighted absolute error plus SSIM.

SSIM is also a score of the benchmark. The cards of weights that were trained with it say so.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor

# Side and standard deviation of SSIM's Gaussian window in pixels, as Wang et al. 2004 have them.
_WINDOW, _SIGMA = 11, 1.5
# The step from window to window in pixels, across and down. With 2 instead of 1, SSIM takes a
# quarter of the time, and as neighbouring windows overlap, the mean hardly changes.
_EVERY = 2
_C1, _C2 = 0.01**2, 0.03**2  # the constants of SSIM by the same authors, for values in 0..1
# The weight of the error of an object's pixel, where the background's has weight 1. It is larger,
# as thin parts have so few pixels that they would hardly count.
FOREGROUND_WEIGHT = 3.0


def weighted_error(
    drawn: Tensor, real: Tensor, is_object: Tensor, structure_weight: float
) -> Tensor:
    """Return a weighted mean absolute error plus `structure_weight` times 1 - SSIM, a scalar.

    drawn, real  images [B, C, H, W] in [0, 1], H and W at least 11
    is_object    bool [B, 1, H, W]: the pixels whose absolute errors count FOREGROUND_WEIGHT times

    Zhao et al. 2017 mix the absolute error with MS-SSIM likewise.
    """
    weight = torch.where(is_object, FOREGROUND_WEIGHT, 1.0)
    absolute = (weight * (drawn - real).abs()).mean()
    return absolute + structure_weight * (1 - structural_similarity(drawn, real))


def structural_similarity(a: Tensor, b: Tensor) -> Tensor:
    """Return the mean SSIM of images, a differentiable scalar, which is not clipped.

    a, b   images [B, C, H, W] in [0, 1], H and W at least 11; either B may be 1

    Window and constants are those of the benchmark's metric: a Gaussian window of 11 x 11 pixels
    with a standard deviation of 1.5. Of the windows that lie wholly within the image every second
    one is taken, across and down.
    """
    moments = torch.broadcast_tensors(a, b, a * a, b * b, a * b)
    means = _window_means(torch.stack(moments))
    mean_a, mean_b, square_a, square_b, product = means
    covariance = product - mean_a * mean_b
    variance = square_a - mean_a.square() + square_b - mean_b.square()
    top = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    return (top / ((mean_a.square() + mean_b.square() + _C1) * (variance + _C2))).mean()


def _window_means(x: Tensor) -> Tensor:
    """Return the Gaussian-weighted means over windows of planes [..., H, W], as [..., h, w].

    They are computed by two matrix products. PyTorch's convolution of single planes takes forty
    times as long on a CPU, most of it in the backward pass.
    """
    height, width = (_window_matrix(size).to(x) for size in x.shape[-2:])
    return height @ (x @ width.mT)


@functools.cache
def _window_matrix(size: int) -> Tensor:
    """Return the weights of n windows along an axis of `size` pixels, [n, size].

    Row i holds the weights of the window that is centred at pixel _EVERY * i + _WINDOW // 2.
    """
    weights = torch.exp(-(torch.arange(_WINDOW) - _WINDOW // 2).square() / (2 * _SIGMA**2))
    weights = weights / weights.sum()
    starts = range(0, size - _WINDOW + 1, _EVERY)
    matrix = torch.zeros(len(starts), size)
    for row, start in enumerate(starts):
        matrix[row, start : start + _WINDOW] = weights
    return matrix
