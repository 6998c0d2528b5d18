"""The network for inference: normalisation folded into convolutions, kernels prepared once.

What it draws is what `SplatNet` draws in evaluation mode, up to the rounding of the precision.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor, nn

from baselines.splat_net.network import Block, SplatNet, composite
from learning.convolution import Convolution, Precision, dtype_of, normalisation

GROUP = 20  # images that pass together: fewer leave the processor waiting between operations


class FoldedSplatNet:
    """See the module. `network` is kept, for `for_one`: it must not change any more. Raises
    ValueError for another precision."""

    def __init__(self, network: SplatNet, precision: Precision = "float32", size: int = 128):
        self.network = network
        self.dtype = dtype_of(precision)
        self.size = size
        self.for_many = _Layers(network, self.dtype, size, GROUP)

    @functools.cached_property
    def for_one(self) -> _Layers:
        """Kernels laid out for a group are slow with a single image."""
        return _Layers(self.network, self.dtype, self.size, 1)

    def __call__(self, channels: Tensor) -> Tensor:
        """Images float32 [P, S, S, 3] in 0..1 by the first head, of channels [P, C, S, S] of
        `dtype`."""
        layers = self.for_one if len(channels) == 1 else self.for_many
        output = layers(channels)
        _, (image, *_) = composite(output, self.network.config.heads)
        return image.expand(-1, 3, -1, -1).permute(0, 2, 3, 1)


class _Layers:
    """All convolutions, for groups of `group` images of a size."""

    def __init__(self, network: SplatNet, dtype: torch.dtype, size: int, group: int) -> None:
        self.dtype = dtype
        widths = network.config.widths
        like = [group, network.config.inputs.channels, size, size]
        with torch.no_grad():
            self.first = _folded(network.first, like, dtype)
            self.down: list[tuple[Convolution, Convolution]] = []
            self.up: list[tuple[Convolution, list[Convolution]]] = []
            for place, level in enumerate(network.down):
                halving, block = level  # type: ignore[misc]
                like = [group, widths[place], size, size]
                size //= 2
                inner = [group, widths[place + 1], size, size]
                self.down.append((_folded(halving, like, dtype), _folded(block, inner, dtype)))
            wide = network.middle.conv.in_channels
            self.middle = _folded(network.middle, [group, wide, size, size], dtype)
            for place, (lift, level) in enumerate(zip(network.lift, network.up, strict=True)):
                width = widths[len(widths) - 1 - place]
                below = _plain(lift, [group, width, size, size], dtype)
                size *= 2
                inner = [group, widths[len(widths) - 2 - place], size, size]
                blocks = [_folded(block, inner, dtype) for block in level]  # type: ignore[attr-defined]
                self.up.append((below, blocks))
            self.last = _plain(network.last, [group, widths[0], size, size], dtype, padding=1)

    def __call__(self, channels: Tensor) -> Tensor:
        x = self.first(channels)
        passed = []
        for halving, block in self.down:
            passed.append(x)
            x = block(halving(x))
        x = self.middle(x)
        for lift, blocks in self.up:
            y = passed.pop()
            _add_doubled(y, lift(x))
            for block in blocks:
                y = block(y)
            x = y
        return self.last(x)


def _add_doubled(y: Tensor, x: Tensor) -> None:
    """Add x [B, c, H, W], nearest up-sampled, to y [B, c, 2H, 2W] in place; both channels last."""
    b, c, h, w = x.shape
    wide = y.permute(0, 2, 3, 1).view(b, h, 2, w, 2, c)
    wide += x.permute(0, 2, 3, 1)[:, :, None, :, None]


def _folded(block: nn.Module, like: list[int], dtype: torch.dtype) -> Convolution:
    assert isinstance(block, Block)
    scale, shift = normalisation(block.norm)
    kernel = block.conv.weight.double() * scale[:, None, None, None]
    stride = block.conv.stride[0]
    return Convolution(kernel, shift, like, dtype, stride=stride, padding=1, relu=True)


def _plain(conv: nn.Module, like: list[int], dtype: torch.dtype, padding: int = 0) -> Convolution:
    assert isinstance(conv, nn.Conv2d)
    assert conv.bias is not None
    return Convolution(conv.weight.double(), conv.bias.double(), like, dtype, padding=padding)
