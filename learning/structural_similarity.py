"""SSIM as part of a loss: the benchmark's own score, differentiable. Weights that saw it say so."""

from __future__ import annotations

import functools

import torch
from torch import Tensor

_WINDOW, _SIGMA = 11, 1.5
_C1, _C2 = 0.01**2, 0.03**2


def structural_similarity(a: Tensor, b: Tensor) -> Tensor:
    """Mean SSIM of pictures [B, C, H, W] in [0, 1], differentiable, without clipping; a scalar.

    Window and constants are those of the metric (11x11 Gaussian, sigma 1.5, valid windows only),
    but of the windows every second one, across and down, is taken: neighbours tell the same, and
    it costs a quarter.
    """
    means = _window_means(torch.stack([a, b, a * a, b * b, a * b]))
    mean_a, mean_b, square_a, square_b, product = means
    covariance = product - mean_a * mean_b
    variance = square_a - mean_a.square() + square_b - mean_b.square()
    top = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    return (top / ((mean_a.square() + mean_b.square() + _C1) * (variance + _C2))).mean()


def _window_means(x: Tensor) -> Tensor:
    """Gaussian means [..., h, w] of [..., H, W], by matrix products.

    PyTorch's convolution of single planes is forty times as slow on a CPU, backwards above all.
    """
    height, width = (_window_matrix(size).to(x) for size in x.shape[-2:])
    return height @ (x @ width.mT)


@functools.cache
def _window_matrix(size: int) -> Tensor:
    """[n, size]: row i holds the window's weights around pixel 2 i + 5."""
    weights = torch.exp(-(torch.arange(_WINDOW) - _WINDOW // 2).square() / (2 * _SIGMA**2))
    weights = weights / weights.sum()
    starts = range(0, size - _WINDOW + 1, 2)
    matrix = torch.zeros(len(starts), size)
    for row, start in enumerate(starts):
        matrix[row, start : start + _WINDOW] = weights
    return matrix
