"""DISTS (Ding et al. 2020, https://arxiv.org/abs/2004.07728): structure and texture of features.

The stages are the three channels of both images and the activations of VGG16, trained on
photographs (ImageNet), at relu1_2, relu2_2, relu3_3, relu4_3 and relu5_3; between them L2 pooling
with a 3 x 3 Hanning window takes the place of the maximum. For each of the 1,475 channels the
means over the pixels are compared (texture) and the covariance (structure), as SSIM does within a
window; alpha and beta, fitted to human judgements, weight both terms.

Variant: the authors' PyTorch version 0.1, at the images' own size (they resize only where the
shorter side exceeds 256 px and the caller asks for it). Instead of a term 2 a b / (a^2 + b^2) its
difference to 1 is computed, (a - b)^2 / (a^2 + b^2): the same number, but exactly 0 for identical
images, where the original is off by rounding.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bench.metrics.image_arrays import require_bytes, require_rgb, require_same_shape, require_some
from bench.metrics.lpips_network import TRUNKS, halved
from bench.metrics.packaged_weights import (
    DISTS,
    find_dists_weights,
    find_lpips_weights,
    read_lpips_weights,
    read_tensors,
)
from learning.exact import exact_inference

BATCH = 10  # images in one call of the network: another number may move a value by 1e-7
_MOST_KEPT = 40  # images whose activations are kept for the next call, 8 MB each
# Of the photographs of ImageNet, 0..1: red, green, blue.
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
C1 = C2 = 1e-6  # added to the denominators of both terms, which are 0 for a channel without values
TINY = 1e-12  # added to the mean square before its root is taken, as in the original
_TRUNK = TRUNKS["vgg"]


class _Dists:
    """The network VGG16 with L2 pooling, and the weights of both terms.

    Convolutions keep all digits of the precision on a GPU, too (`learning.exact`).
    """

    def __init__(
        self, path: Path, trunk: Path, dtype: torch.dtype = torch.float32, device: str = "cpu"
    ) -> None:
        """Read the weights of the terms from `path`, those of VGG16 from `trunk`.

        dtype   precision of the network
        device  PyTorch's name of it

        Raises BadInput where a file is not the published one.
        """
        self.dtype, self.device = dtype, device
        weights = {
            name: w.to(device, torch.float64).flatten()
            for name, w in read_tensors(path, DISTS).items()
        }
        total = weights["alpha"].sum() + weights["beta"].sum()
        checkpoint = read_lpips_weights(trunk, "vgg")[_TRUNK.name]
        # Of each convolution the kernel [cout, cin, K, K], channels last, and the bias [cout].
        self._kernels: list[tuple[Tensor, Tensor]] = []
        channels = [3]
        for i, conv in enumerate(_TRUNK.layers):
            kernel, bias = (
                torch.from_numpy(checkpoint[f"Conv_{i}"][part]).to(device, torch.float64)
                for part in ("kernel", "bias")
            )
            kernel = kernel.permute(3, 2, 0, 1).to(dtype, memory_format=torch.channels_last)
            self._kernels.append((kernel, bias.to(dtype)))
            channels += [len(bias)] if conv.seen else []
        self._alpha, self._beta = (
            torch.split(weights[name] / total, channels) for name in ("alpha", "beta")
        )
        self._last: tuple[NDArray[np.uint8], list[list[Tensor]]] | None = None

    @exact_inference()
    def distance(self, a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return DISTS [N] of N pairs of images uint8 [N, H, W, 3], >= 0.

        The activations of up to _MOST_KEPT images `a` are kept: `bench score` compares the true
        images of an object with those of one method after the other.
        """
        starts = range(0, len(a), BATCH)
        known = self._last is not None and np.array_equal(self._last[0], a)
        if not known and len(a) <= _MOST_KEPT:
            self._last = a.copy(), [self._encode(a[i : i + BATCH]) for i in starts]
            known = True
        parts = []
        for number, i in enumerate(starts):
            kept = self._last[1][number] if known and self._last else self._encode(a[i : i + BATCH])
            parts.append(self._compare(kept, self._encode(b[i : i + BATCH])))
        return np.concatenate([np.empty(0), *parts])

    def _encode(self, images: NDArray[np.uint8]) -> list[Tensor]:
        # A copy by NumPy: torch refuses negative strides, those of mirrored images.
        x = torch.from_numpy(images.copy()).to(self.device).permute(0, 3, 1, 2).to(self.dtype) / 255
        mean, deviation = (
            torch.tensor(v, dtype=self.dtype, device=self.device).reshape(3, 1, 1)
            for v in (MEAN, DEVIATION)
        )
        stages = [x]
        x = (x - mean) / deviation
        for conv, kernel in zip(_TRUNK.layers, self._kernels, strict=True):
            x = conv.applied(pooled(x) if conv.pooled else x, *kernel).relu_()
            if conv.seen:
                stages.append(x)
        return stages

    def _compare(self, a: Sequence[Tensor], b: Sequence[Tensor]) -> NDArray[np.float64]:
        total = torch.zeros(len(a[0]), dtype=torch.float64, device=self.device)
        for x, y, alpha, beta in zip(a, b, self._alpha, self._beta, strict=True):
            x, y = (stage.flatten(2).double() for stage in (x, y))
            mean_x, mean_y = (stage.mean(dim=2, keepdim=True) for stage in (x, y))
            x, y = x - mean_x, y - mean_y
            shift, power = mean_x - mean_y, mean_x.square() + mean_y.square()
            texture = (shift.square() / (power + C1))[..., 0]
            variances = (x.square() + y.square()).mean(dim=2)
            structure = (x - y).square_().mean(dim=2) / (variances + C2)
            total += texture @ alpha + structure @ beta
        return total.cpu().numpy()


def pooled(x: Tensor) -> Tensor:
    """Return L2 pooling: the root of the Hanning-weighted mean square about every second pixel."""
    return halved(x.square(), padding=1).add_(TINY).sqrt_()


def dists(
    a: NDArray[np.uint8], b: NDArray[np.uint8], *, single: bool = False, device: str = "cpu"
) -> NDArray[np.float64]:
    """Return DISTS [N] of pairs of images uint8 [N, H, W, 3] with sides of 16 px or more.

    It is 0 for identical images and above 0 for others; lower is better, and it is symmetric.
    `single` computes the activations in float32, as `bench score` does: twice as fast, and equal to
    1e-5. `device` is PyTorch's name of it. Raises as `bench.metrics.lpips`.
    """
    require_bytes(a, b)
    require_same_shape(a, b)
    require_rgb(a, _TRUNK.least)
    require_some(a)
    return _load_dists(torch.float32 if single else torch.float64, device).distance(a, b)


@functools.lru_cache(maxsize=2)
def _load_dists(dtype: torch.dtype, device: str = "cpu") -> _Dists:
    """Return a `_Dists` of the installed weights; the last two are kept. Raises as `dists`."""
    return _Dists(find_dists_weights(), find_lpips_weights("vgg"), dtype, device)
