"""Losses between drawn images and true ones: SSIM, and L1 weighted by what is object, plus SSIM.

SSIM is the benchmark's own score, differentiable. Weights that were trained with it say so.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor

_WINDOW, _SIGMA = 11, 1.5
_EVERY = 2  # windows, across and down: neighbours say the same, and it costs a quarter
_C1, _C2 = 0.01**2, 0.03**2
FOREGROUND_WEIGHT = 3.0  # thin parts are few pixels


def weighted_error(
    drawn: Tensor, real: Tensor, is_object: Tensor, structure_weight: float
) -> Tensor:
    """Return the mean absolute error plus `structure_weight` times 1 - SSIM; a scalar.

    After Zhao et al. 2017, who mix L1 with MS-SSIM. Images [B, C, H, W] in [0, 1], H and W at least
    11; pixels of the object, bool [B, 1, H, W], count FOREGROUND_WEIGHT times.
    """
    weight = torch.where(is_object, FOREGROUND_WEIGHT, 1.0)
    absolute = (weight * (drawn - real).abs()).mean()
    return absolute + structure_weight * (1 - structural_similarity(drawn, real))


def structural_similarity(a: Tensor, b: Tensor) -> Tensor:
    """Return the mean SSIM of images [B, C, H, W] in [0, 1], differentiable; a scalar.

    It is not clipped.

    Window and constants are those of the metric (11x11 Gaussian, sigma 1.5, valid windows only),
    but of the windows only every second one (`_EVERY`), across and down, is taken.
    Either B may be 1.
    """
    moments = torch.broadcast_tensors(a, b, a * a, b * b, a * b)
    means = _window_means(torch.stack(moments))
    mean_a, mean_b, square_a, square_b, product = means
    covariance = product - mean_a * mean_b
    variance = square_a - mean_a.square() + square_b - mean_b.square()
    top = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    return (top / ((mean_a.square() + mean_b.square() + _C1) * (variance + _C2))).mean()


def _window_means(x: Tensor) -> Tensor:
    """Return Gaussian means [..., h, w] of [..., H, W], by matrix products.

    PyTorch's convolution of single planes is forty times as slow on a CPU, backwards above all.
    """
    height, width = (_window_matrix(size).to(x) for size in x.shape[-2:])
    return height @ (x @ width.mT)


@functools.cache
def _window_matrix(size: int) -> Tensor:
    """Return the matrix [n, size] of window weights: row i is around pixel _EVERY * i + 5."""
    weights = torch.exp(-(torch.arange(_WINDOW) - _WINDOW // 2).square() / (2 * _SIGMA**2))
    weights = weights / weights.sum()
    starts = range(0, size - _WINDOW + 1, _EVERY)
    matrix = torch.zeros(len(starts), size)
    for row, start in enumerate(starts):
        matrix[row, start : start + _WINDOW] = weights
    return matrix
