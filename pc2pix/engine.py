"""Inference engine: the generator with normalisation and fixed inputs folded into its weights.

It draws what `pc2pix.model.Generator` draws in evaluation mode, up to rounding, with less
arithmetic:

- BatchNorm behind a convolution (`bn2`) becomes part of that convolution. `bn1` and the last one
  stay: a ReLU follows them, and the sum that they normalise is wanted as it is by the shortcut.
- Nearest up-sampling x2 and a 3x3 convolution are one transposed convolution, whose kernel is made
  once (`pc2pix.model.upsampling_kernel`).
- Of the first dense layer, the part that depends on the cloud is computed once for all views.

Images pass through the later blocks in groups that fit the processor's cache.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from data_prep.scene import IMAGE_SIZE
from learning.convolution import Precision, dtype_of
from learning.exact import exact_inference
from pc2pix.model import NOISE_DIM, Generator, UpBlock, sine_cosine, upsampling_kernel

# Of a block's result: stays in the cache with what is made from it. Larger tensors come fresh from
# the operating system, too, and to touch a new page costs more than to compute what is in it.
_GROUP_BYTES = 2 << 20
ALL = 1 << 30  # images in a group on other devices: no cache to stay in, and calls are expensive


class _FoldedBlock:
    """An `UpBlock` in evaluation mode."""

    def __init__(self, block: UpBlock, dtype: torch.dtype) -> None:
        self.norm = block.bn1
        self.conv1 = _prepared(fuse_conv_bn_eval(block.conv1, block.bn2), dtype)
        kernel = upsampling_kernel(block.conv2.weight)
        self.kernel = kernel.to(dtype, memory_format=torch.channels_last)
        self.shortcut = _prepared(copy.deepcopy(block.shortcut), dtype)
        # Up-sampling leaves a bias what it is, so that of conv2 may come with the shortcut.
        assert self.shortcut.bias is not None
        assert block.conv2.bias is not None
        self.shortcut.bias += block.conv2.bias

    def __call__(self, x: Tensor) -> Tensor:
        y = self.conv1(_normalised(x, self.norm)).relu_()
        y = functional.conv_transpose2d(y, self.kernel, stride=2, padding=1)
        return y.add_(functional.interpolate(self.shortcut(x), scale_factor=2.0))


def _prepared(conv: nn.Conv2d, dtype: torch.dtype) -> nn.Conv2d:
    return conv.to(dtype, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]


def _normalised(x: Tensor, bn: nn.BatchNorm2d) -> Tensor:
    """Return x after BatchNorm in evaluation mode, with float32 statistics, and ReLU."""
    y = functional.batch_norm(x, bn.running_mean, bn.running_var, bn.weight, bn.bias, eps=bn.eps)
    return y.relu_()


class _LastLayers:
    """The last BatchNorm, ReLU and convolution to three channels, as images in [0, 1]."""

    def __init__(self, generator: Generator, dtype: torch.dtype) -> None:
        self.norm = generator.bn
        self.conv = _prepared(copy.deepcopy(generator.conv), dtype)

    def __call__(self, x: Tensor) -> Tensor:
        x = self.conv(_normalised(x, self.norm)).permute(0, 2, 3, 1).float()
        return torch.tanh(x).add_(1).div_(2)


class _Stack:
    """The blocks and last layers of a generator, for groups of images.

    A block's result for a group takes at most `group_bytes`, or is of a single image.
    """

    def __init__(self, generator: Generator, dtype: torch.dtype, group_bytes: int) -> None:
        self.layers: list[_FoldedBlock | _LastLayers] = []
        self.groups: list[int] = []  # images that pass a layer together
        cpu = generator.conv.weight.device.type == "cpu"
        size, group = 4, 1
        with torch.no_grad():
            for block in generator.blocks:
                assert isinstance(block, UpBlock)
                size *= 2
                image_bytes = block.conv1.out_channels * size * size * dtype.itemsize
                group = max(1, group_bytes // image_bytes) if cpu else ALL
                self.groups.append(group)
                self.layers.append(_FoldedBlock(block, dtype))
            self.groups.append(group)
            self.layers.append(_LastLayers(generator, dtype))

    def draw(self, x: Tensor, out: Tensor, first: int = 0) -> None:
        """Apply layers `first` and on to x, into `out`: each group to its end before the next."""
        if first == len(self.layers):
            out.copy_(x)
            return
        groups = zip(x.split(self.groups[first]), out.split(self.groups[first]), strict=True)
        for part, place in groups:
            self.draw(self.layers[first](part), place, first + 1)


class FoldedGenerator:
    """A generator in evaluation mode, for inference, on the device that it is on.

    The weights are copied: what happens to `generator` afterwards changes nothing. float32 draws
    what the generator draws, up to rounding (some 1e-6 of the range); bfloat16 keeps weights and
    everything between the layers in 8 binary digits, sums and BatchNorm in float32. On a CPU
    without bfloat16 that is right, but slow. Raises ValueError for another precision.
    """

    def __init__(
        self,
        generator: Generator,
        precision: Precision = "float32",
        group_bytes: int = _GROUP_BYTES,
    ) -> None:
        self.dtype = dtype_of(precision)
        self.generator = copy.deepcopy(generator)
        self.config = generator.config
        weight = self.generator.dense.weight.detach()
        parts = [NOISE_DIM, self.config.latent_dim, 1 + self.config.azimuth_numbers]
        self.noise, self.code, self.angles = weight.split(parts, dim=1)
        self.bias = self.generator.dense.bias.detach()
        self.stack = _Stack(self.generator, self.dtype, group_bytes)

    @exact_inference()
    def __call__(
        self, code: Tensor, elevation01: Tensor, azimuth01: Tensor, noise: Tensor | None = None
    ) -> Tensor:
        """Return images float32 [V, 128, 128, 3] in [0, 1] of one cloud.

        code                    [1, latent_dim]
        elevation01, azimuth01  [V, 1], as the generator takes them
        noise                   [V, 128]; None stands for zeros
        """
        azimuth = azimuth01 if self.config.azimuth == "scalar" else sine_cosine(azimuth01)
        x = functional.linear(code, self.code, self.bias)  # [1, 16 c0]
        x = x + functional.linear(torch.cat([elevation01, azimuth], dim=1), self.angles)
        if noise is not None:
            x += functional.linear(noise, self.noise)
        x = x.to(self.dtype).unflatten(1, (4, 4, -1)).permute(0, 3, 1, 2)  # [V, c0, 4, 4]
        out = x.new_empty((len(x), IMAGE_SIZE, IMAGE_SIZE, 3), dtype=torch.float32)
        self.stack.draw(x, out)
        return out
