"""The network for inference: normalisation folded into convolutions, kernels prepared once.

It draws what `SplatNet` draws in evaluation mode, up to the rounding of the precision.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor, nn

from baselines.splat_net.network import NEUTRAL, PLANES, Block, SplatNet, shading_of
from baselines.splat_net.sharpening import take_meshes
from learning.convolution import Convolution, Precision, dtype_of, normalisation

GROUP = 10  # images that pass together: in fewer, calls cost more


class FoldedSplatNet:
    """The folded network.

    `network` is kept, for `for_one`: it must not change any more. Raises ValueError for another
    precision.
    """

    def __init__(self, network: SplatNet, precision: Precision = "float32", size: int = 128):
        self.network = network
        self.dtype = dtype_of(precision)
        self.size = size
        self.for_many = _Layers(network, self.dtype, size, GROUP)

    @functools.cached_property
    def for_one(self) -> _Layers:
        """Return the layers for a single image, with which kernels for a group are slow."""
        return _Layers(self.network, self.dtype, self.size, 1)

    def __call__(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return images float32 [P, S, S, 3] in 0..1 by the albedo, or else by the first head.

        The channels [P, C, S, S] are of `dtype`. `points` are not used.
        """
        planes, albedo = self._planes(channels)
        alpha, missing = planes[:, 0], planes[:, 1:].expand(-1, 3, -1, -1)
        if albedo is not None:
            missing = 1 - shading_of(1 - missing) * albedo.float().sigmoid()[:, :, None, None]
        white = alpha.new_ones(())
        images = torch.empty((*alpha.shape, 3), device=planes.device)
        for image, colour in zip(images.unbind(3), missing.unbind(1), strict=True):
            torch.addcmul(white, alpha, colour, value=-1, out=image)
        return images

    def coverage(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return the share of each pixel that is covered, float32 [P, S, S, 1], of such images."""
        planes, _ = self._planes(channels)
        alpha = planes[:, 0]
        if self.network.config.heads == ("grey",):
            # Nothing in neutral grey is brighter than that: what a brighter cover lets through is
            # the white background, which the network draws beside outlines in alpha and cover.
            alpha = alpha * (planes[:, 1] / (1 - NEUTRAL)).clamp(max=1.0)
        return alpha[..., None]

    def _planes(self, channels: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return alpha and 1 less the first head [P, planes, S, S], 0..1, and any albedo."""
        layers = self.for_one if len(channels) == 1 else self.for_many
        output, albedo = layers(channels)
        planes = output.float().sigmoid_()
        if self.network.config.inputs.meshes:
            planes = take_meshes(planes, channels, self.network.config.inputs)
        return planes, albedo


class _Layers:
    """All convolutions, laid out for groups of `group` images of a size."""

    def __init__(self, network: SplatNet, dtype: torch.dtype, size: int, group: int) -> None:
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
                assert isinstance(lift, nn.Conv2d)
                assert lift.bias is not None
                # each channel twice, for `_with_doubled`
                kernel, bias = lift.weight.double().repeat(2, 1, 1, 1), lift.bias.double().repeat(2)
                below = Convolution(kernel, bias, [group, width, size, size], dtype)
                size *= 2
                inner = [group, widths[len(widths) - 2 - place], size, size]
                blocks = [_folded(block, inner, dtype) for block in level]  # type: ignore[attr-defined]
                self.up.append((below, blocks))
            self.last = _last(network, [group, widths[0], size, size], dtype)
            self.albedo = network.albedo if "albedo" in network.config.heads else None

    def __call__(self, channels: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return planes and any albedo [P, 3] before the sigmoid; covers negated, see `_last`."""
        x = self.first(channels)
        passed = []
        for halving, block in self.down:
            passed.append(x)
            x = block(halving(x))
        x = self.middle(x)
        albedo = None if self.albedo is None else self.albedo(x.mean(dim=(2, 3)).float())
        for lift, blocks in self.up:
            y = _with_doubled(passed.pop(), lift(x))
            for block in blocks:
                y = block(y)
            x = y
        return self.last(x), albedo


def _with_doubled(y: Tensor, x: Tensor) -> Tensor:
    """Return y [B, c, 2H, 2W] with x [B, 2 c, H, W], nearest up-sampled, added in place."""
    # x has each pixel's channels twice, so that what is added to a row is one run.
    # On the CPU both are channels last already; other devices lay results out as they like.
    y, x = (some.contiguous(memory_format=torch.channels_last) for some in (y, x))
    b, c, h, w = y.shape
    rows = y.permute(0, 2, 3, 1).view(b, h // 2, 2, w * c)
    rows += x.permute(0, 2, 3, 1).view(b, h // 2, 1, w * c)
    return y


def _folded(block: nn.Module, like: list[int], dtype: torch.dtype) -> Convolution:
    assert isinstance(block, Block)
    scale, shift = normalisation(block.norm)
    kernel = block.conv.weight.double() * scale[:, None, None, None]
    stride = block.conv.stride[0]
    return Convolution(kernel, shift, like, dtype, stride=stride, padding=1, relu=True)


def _last(network: SplatNet, like: list[int], dtype: torch.dtype) -> Convolution:
    """Return the convolution to alpha and the negated first head: 1 - s(x) = s(-x) is wanted."""
    conv = network.last
    assert conv.bias is not None
    count = 1 + PLANES[network.config.heads[0]]
    kernel, bias = conv.weight[:count].double(), conv.bias[:count].double()
    sign = torch.ones_like(bias)
    sign[1:] = -1.0
    return Convolution(kernel * sign[:, None, None, None], bias * sign, like, dtype, padding=1)
