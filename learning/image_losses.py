"""Losses between drawn images and true ones: SSIM, and a weighted absolute error plus SSIM.

SSIM is also a score of the benchmark. The cards of weights that were trained with it say so.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor

_WINDOW, _SIGMA = 11, 1.5  # pixels: side and standard deviation of the Gaussian window, as usual
# Pixels between the windows that are taken, across and down. With 2 this takes a quarter of the
# time, and neighbouring windows overlap so much that the mean hardly changes.
_EVERY = 2
_C1, _C2 = 0.01**2, 0.03**2  # the usual constants of SSIM, for values in 0..1
# Weight of the error of a pixel of the object, where that of a pixel of the background is 1: thin
# parts have few pixels.
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

    Window and constants are those of the benchmark's metric: 11x11 pixels, a Gaussian with a sigma
    of 1.5, and of the windows that lie wholly within the image one in two, across and down.
    """
    moments = torch.broadcast_tensors(a, b, a * a, b * b, a * b)
    means = _window_means(torch.stack(moments))
    mean_a, mean_b, square_a, square_b, product = means
    covariance = product - mean_a * mean_b
    variance = square_a - mean_a.square() + square_b - mean_b.square()
    top = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    return (top / ((mean_a.square() + mean_b.square() + _C1) * (variance + _C2))).mean()


def _window_means(x: Tensor) -> Tensor:
    """Return the Gaussian means of the windows of planes [..., H, W], as [..., h, w].

    They are two matrix products. PyTorch's convolution of single planes takes forty times as long
    on a CPU, most of it backwards.
    """
    height, width = (_window_matrix(size).to(x) for size in x.shape[-2:])
    return height @ (x @ width.mT)


@functools.cache
def _window_matrix(size: int) -> Tensor:
    """Return the weights of n windows, [n, size]: those of row i are centred at _EVERY * i + 5."""
    weights = torch.exp(-(torch.arange(_WINDOW) - _WINDOW // 2).square() / (2 * _SIGMA**2))
    weights = weights / weights.sum()
    starts = range(0, size - _WINDOW + 1, _EVERY)
    matrix = torch.zeros(len(starts), size)
    for row, start in enumerate(starts):
        matrix[row, start : start + _WINDOW] = weights
    return matrix
