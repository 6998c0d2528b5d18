"""Inference engine: the generator with normalisation and fixed inputs folded into its weights.

It draws what `pc2pix.model.Generator` draws in evaluation mode, up to rounding, with less
arithmetic:

- BatchNorm behind a convolution (`bn2`) becomes part of that convolution. `bn1` and the last one
  stay: a ReLU follows them, and the sum that they normalise is wanted as it is by the shortcut.
- Nearest up-sampling x2 and a 3x3 convolution are four small convolutions on the grid before it,
  one for each phase (even or odd row, even or odd column) of the result. With the kernel's rows a,
  b, c and S = a + b + c, in one dimension, they are

      even_i = a x_{i-1} + (b + c) x_i = S x_i - a (x_i - x_{i-1})
      odd_i  = (a + b) x_i + c x_{i+1} = S x_i + c (x_{i+1} - x_i)

  The middle form is 2x2 products a position for each phase, 16 in all for the 36 written down in
  Table 1; the form on the right is nine, at the price of differences before and sums behind.
  `_Phases` and `_NineProducts` are the two, `_Rows` the former for few channels; which is fastest
  depends on the number of channels (`_upsampled`).
- The 3x3 convolution to three channels draws 2x2 pixels at once: a 4x4 convolution of stride 2 to
  twelve channels fills the registers that three leave empty.
- Of the first dense layer, the part that depends on the cloud is computed once for all views.

Kernels are laid out in memory beforehand (`learning.convolution`). Images pass through the later
blocks in groups that fit the processor's cache.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from data_prep.scene import IMAGE_SIZE
from learning.convolution import Convolution, Precision, dtype_of, normalisation
from learning.exact import exact_inference
from pc2pix.model import NOISE_DIM, Generator, UpBlock, sine_cosine

_NINE_PRODUCTS_FROM = 128  # channels; below, differences and sums cost more than they save
_VECTOR_BYTES = 64  # a register of AVX-512; what is added in shorter runs is added one by one
# Of a block's result: stays in the cache with what is made from it. Larger tensors come fresh from
# the operating system, too, and to touch a new page costs more than to compute what is in it.
_GROUP_BYTES = 2 << 20
ALL = 1 << 30  # images in a group on other devices: no cache to stay in, and calls are expensive
# Matrices R with R [a, b, c] = the kernel rows in question, see above.
_PHASE_ROWS = torch.tensor(
    [[[1.0, 0, 0], [0, 1, 1]], [[1, 1, 0], [0, 0, 1]]], dtype=torch.float64
)  # [phase, tap, kernel row]
_PRODUCT_ROWS = torch.tensor([[-1.0, 0, 0], [1, 1, 1], [0, 0, 1]], dtype=torch.float64)


class _Upsampled:
    """Nearest x2, a 3x3 convolution without a bias, and a shortcut that is up-sampled, too.

    Maps [B, c, H, W] and shortcuts [B, shortcuts * c, H, W] to [B, c, 2H, 2W].
    """

    shortcuts = 1  # how many times over the channels of the shortcut are wanted

    def __call__(self, y: Tensor, shortcut: Tensor) -> Tensor:
        raise NotImplementedError


def _upsampled(kernel: Tensor, like: Sequence[int], dtype: torch.dtype) -> _Upsampled:
    """Return the fastest form for a float64 kernel [c, c, 3, 3] and inputs [B, c, H, W]."""
    channels = like[1]
    if channels >= _NINE_PRODUCTS_FROM:
        return _NineProducts(kernel, like, dtype)
    if channels * dtype.itemsize < _VECTOR_BYTES:
        return _Rows(kernel, like, dtype)
    return _Phases(kernel, like, dtype)


class _Phases(_Upsampled):
    """Four 2x2 convolutions."""

    def __init__(self, kernel: Tensor, like: Sequence[int], dtype: torch.dtype) -> None:
        rows = _PHASE_ROWS.to(kernel.device)
        kernels = torch.einsum("pru,oiuv,qsv->pqoirs", rows, kernel, rows)
        self.phases = [
            (p, q, Convolution(kernels[p, q], None, like, dtype, padding=1))
            for p in (0, 1)
            for q in (0, 1)
        ]

    def __call__(self, y: Tensor, shortcut: Tensor) -> Tensor:
        h, w = y.shape[2:]
        out = _doubled(y)
        for p, q, conv in self.phases:
            convolved = conv(y)  # [B, c, H + 1, W + 1]: row i looks at i - 1 and i
            torch.add(convolved[:, :, p : p + h, q : q + w], shortcut, out=out[:, :, p::2, q::2])
        return out


class _Rows(_Upsampled):
    """Two 2x3 convolutions, for even and for odd rows of the result.

    Each gives the pixels of two columns side by side, so that what is left to do is to interleave
    whole rows. Of its six taps a column needs four; where channels are few that is the lesser evil.
    """

    shortcuts = 2

    def __init__(self, kernel: Tensor, like: Sequence[int], dtype: torch.dtype) -> None:
        rows = _PHASE_ROWS.to(kernel.device)
        columns = rows.new_zeros(2, 3, 3)  # [phase, tap, kernel column]
        columns[0, :2], columns[1, 1:] = rows
        kernels = torch.einsum("pru,oiuv,qsv->pqoirs", rows, kernel, columns).flatten(1, 2)
        self.rows = [Convolution(k, None, like, dtype, padding=1) for k in kernels]

    def __call__(self, y: Tensor, shortcut: Tensor) -> Tensor:
        b, c, h, w = y.shape
        out = y.new_empty((b, h, 2, w, 2 * c))
        shortcut = shortcut.permute(0, 2, 3, 1)
        for p, conv in enumerate(self.rows):
            convolved = conv(y).permute(0, 2, 3, 1)  # [B, H + 1, W, 2 c]
            torch.add(convolved[:, p : p + h], shortcut, out=out[:, :, p])
        return out.view(b, 2 * h, 2 * w, c).permute(0, 3, 1, 2)


class _NineProducts(_Upsampled):
    """Products with differences of neighbours."""

    def __init__(self, kernel: Tensor, like: Sequence[int], dtype: torch.dtype) -> None:
        rows = _PRODUCT_ROWS.to(kernel.device)
        m = torch.einsum("ru,oiuv,sv->rsoi", rows, kernel, rows)[..., None, None]
        batch, channels, h, w = like

        def products(kernels: list[Tensor], h: int, w: int) -> Convolution:
            return Convolution(torch.cat(kernels), None, (batch, channels, h, w), dtype)

        self.plain = products([m[1, 1]], h, w)
        self.down = products([m[0, 1], m[2, 1]], h + 1, w)
        self.across = products([m[1, 0], m[1, 2]], h, w + 1)
        self.both = products([m[0, 0], m[0, 2], m[2, 0], m[2, 2]], h + 1, w + 1)

    def __call__(self, y: Tensor, shortcut: Tensor) -> Tensor:
        h, w = y.shape[2:]
        wide = functional.pad(y, (1, 1, 1, 1))
        steps = wide[:, :, 1:] - wide[:, :, :-1]  # [B, c, H + 1, W + 2], down
        down = self.down(_dense(steps[..., 1:-1])).chunk(2, dim=1)
        wide = wide[:, :, 1:-1]
        across = self.across(_dense(wide[..., 1:] - wide[..., :-1])).chunk(2, dim=1)
        both = self.both(_dense(steps[..., 1:] - steps[..., :-1])).chunk(4, dim=1)
        plain = self.plain(y).add_(shortcut)
        out = _doubled(y)
        for p in (0, 1):
            row = plain + down[p][:, :, p : p + h]
            for q in (0, 1):
                phase = out[:, :, p::2, q::2]
                torch.add(row, across[q][..., q : q + w], out=phase)
                phase += both[2 * p + q][:, :, p : p + h, q : q + w]
        return out


def _doubled(y: Tensor) -> Tensor:
    b, c, h, w = y.shape
    return y.new_empty((b, 2 * h, 2 * w, c)).permute(0, 3, 1, 2)


def _dense(x: Tensor) -> Tensor:
    return x.contiguous(memory_format=torch.channels_last)


class _FoldedBlock:
    """An `UpBlock` in evaluation mode; `like` is the shape [B, cin, H, W] of its inputs."""

    def __init__(self, block: UpBlock, like: Sequence[int], dtype: torch.dtype) -> None:
        batch, _, h, w = like
        self.norm = _Norm(block.bn1)
        conv1, conv2, shortcut = block.conv1, block.conv2, block.shortcut
        scale, shift = normalisation(block.bn2)
        kernel = conv1.weight.double() * scale[:, None, None, None]
        self.conv1 = Convolution(kernel, _bias(conv1) * scale + shift, like, dtype, padding=1)
        # up-sampling leaves a bias what it is, so that of conv2 may come with the shortcut
        bias = _bias(shortcut) + _bias(conv2)
        channels = conv2.in_channels
        self.conv2 = _upsampled(conv2.weight.double(), (batch, channels, h, w), dtype)
        copies = self.conv2.shortcuts
        kernel = shortcut.weight.double().repeat(copies, 1, 1, 1)
        self.shortcut = Convolution(kernel, bias.repeat(copies), like, dtype)

    def __call__(self, x: Tensor) -> Tensor:
        y = self.conv1(self.norm(x)).relu_()
        return self.conv2(y, self.shortcut(x))


class _Norm:
    """A BatchNorm in evaluation mode, then ReLU; the statistics stay in float32."""

    def __init__(self, bn: nn.BatchNorm2d) -> None:
        scale, shift = (x.float() for x in normalisation(bn))
        self.arguments = torch.zeros_like(scale), torch.ones_like(scale), scale, shift

    def __call__(self, x: Tensor) -> Tensor:
        # Some versions of PyTorch refuse 0; a variance of 1 is 1 in float32 with this one, too.
        return functional.batch_norm(x, *self.arguments, eps=2.0**-64).relu_()


class _LastLayers:
    """The last BatchNorm, ReLU and convolution to three channels, as images in [0, 1]."""

    def __init__(self, generator: Generator, like: Sequence[int], dtype: torch.dtype) -> None:
        self.norm = _Norm(generator.bn)
        conv = generator.conv
        kernel = conv.weight.new_zeros((2, 2, 3, conv.in_channels, 4, 4), dtype=torch.float64)
        for p in (0, 1):  # the pixel's place in its 2x2
            for q in (0, 1):
                kernel[p, q, :, :, p : p + 3, q : q + 3] = conv.weight
        bias = _bias(conv).repeat(4)
        self.conv = Convolution(kernel.flatten(0, 2), bias, like, dtype, stride=2, padding=1)

    def __call__(self, x: Tensor) -> Tensor:
        x = self.conv(self.norm(x)).permute(0, 2, 3, 1)  # [B, H / 2, W / 2, 12]
        x = x.unflatten(3, (2, 2, 3)).permute(0, 1, 3, 2, 4, 5)  # [B, H / 2, 2, W / 2, 2, 3]
        x = x.flatten(3, 4).flatten(1, 2).float()
        return torch.tanh(x).add_(1).div_(2)


class _Stack:
    """The blocks and last layers of a generator, for groups of at most `most` images.

    A block's result for a group takes at most `group_bytes`, or is of a single image.
    """

    def __init__(
        self, generator: Generator, dtype: torch.dtype, most: int, group_bytes: int = _GROUP_BYTES
    ) -> None:
        self.layers: list[_FoldedBlock | _LastLayers] = []
        self.groups: list[int] = []  # images that pass a layer together
        cpu = generator.conv.weight.device.type == "cpu"
        size, group = 4, 1
        with torch.no_grad():
            for block in generator.blocks:
                assert isinstance(block, UpBlock)
                cin, cout = block.conv1.in_channels, block.conv1.out_channels
                group = max(1, group_bytes // (cout * 4 * size * size * dtype.itemsize))
                group = min(group if cpu else ALL, most)
                self.groups.append(group)
                self.layers.append(_FoldedBlock(block, (group, cin, size, size), dtype))
                size *= 2
            self.groups.append(group)
            like = (group, generator.conv.in_channels, size, size)
            self.layers.append(_LastLayers(generator, like, dtype))

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
        self.for_many = _Stack(self.generator, self.dtype, ALL, group_bytes)

    @functools.cached_property
    def for_one(self) -> _Stack:
        """Return the layers for a single image: kernels laid out for 32 are slow with one."""
        return _Stack(self.generator, self.dtype, 1)

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
        (self.for_one if len(x) == 1 else self.for_many).draw(x, out)
        return out


def _bias(conv: nn.Conv2d) -> Tensor:
    assert conv.bias is not None
    return conv.bias.double()
