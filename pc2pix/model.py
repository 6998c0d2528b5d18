"""The generator and the discriminator of pc2pix; all its networks can be imported from here.

They follow section 3.2 of the paper (Tables 1 and 2) and its code, roatienza/pc2pix@23b7b46d; where
the two differ the code is followed, and a docstring says so. `ModelConfig.width` scales all widths.
Tensors have PyTorch's layout (batch, channel, height, width). Where a dense layer takes or gives
images, their values are in the original's order (height, width, channel), so that weights that were
trained with the original code can be loaded.

Two identities save 40 % of the arithmetic, and change results by no more than rounding errors:
- nearest up-sampling commutes with BatchNorm and ReLU, and up-sampling followed by a 3x3
  convolution is a transposed 4x4 convolution of stride 2;
- a 3x3 convolution followed by 2x2 average pooling is a 4x4 convolution of stride 2, and a 1x1
  convolution commutes with the pooling.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from pc2pix.autoencoder import Decoder, Encoder, PointNet, build_encoder, initialise
from pc2pix.model_config import LITE, PAPER, ModelConfig

__all__ = [
    "LITE",
    "NOISE_DIM",
    "PAPER",
    "Decoder",
    "Discriminator",
    "DiscriminatorOutput",
    "Encoder",
    "Generator",
    "ModelConfig",
    "PointNet",
    "UpBlock",
    "build_encoder",
    "channels_last",
    "sine_cosine",
    "take_scaled_codes",
]

NOISE_DIM = 128  # length of the generator's noise z, which is uniform in (-1, 1)
# Channels at width 1. Of the generator (Table 1) at 4, 8, 16, 32, 64 and 128 pixels; of the
# discriminator (Table 2) at 64, 32, 16, 8 and 4 pixels, and of the layers that tell the code.
_GENERATOR_CHANNELS = (1024, 1024, 512, 256, 128, 64)
_DISCRIMINATOR_CHANNELS = (64, 128, 256, 512, 1024)
_CODE_HEAD_CHANNELS = (256, 1024, 1024, 1024)


def sine_cosine(azimuth01: Tensor) -> Tensor:
    """Return the sines and cosines of azimuths, [B, 2]; they are (0, 1) for the front.

    azimuth01  [B, 1], azimuth_deg / 360 + 0.5; 0.5 is the front
    """
    angle = 2 * math.pi * (azimuth01 - 0.5)
    return torch.cat([torch.sin(angle), torch.cos(angle)], dim=1)


class DiscriminatorOutput(NamedTuple):
    """The discriminator's answers about B images.

    Attributes
    ----------
    real_logit : Tensor, [B, 1]
        Logit of being real, before the sigmoid, so that the cross entropy is stable; see `real`.
    code : Tensor, [B, latent_dim]
        Reconstructed code rho.
    elevation : Tensor, [B, 1]
        Elevation in (0, 1), normalised as the generator's input.
    azimuth : Tensor, [B, 1] or [B, 2]
        Azimuth in (0, 1), normalised as the generator's input; or sine and cosine, unbounded.
    """

    real_logit: Tensor
    code: Tensor
    elevation: Tensor
    azimuth: Tensor

    @property
    def real(self) -> Tensor:
        """Return the probability [B, 1] that the image is a real one (Table 2: p_real)."""
        return torch.sigmoid(self.real_logit)


def channels_last(network: nn.Module) -> None:
    """Change the memory layout of a network's kernels to channels last, which is faster."""
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] (stub gap)


# Generator: paper Table 1


def _upsample_then_conv(x: Tensor, conv: nn.Conv2d) -> Tensor:
    """Return a convolution of the input enlarged two times (nearest), [B, cout, 2H, 2W].

    x     [B, cin, H, W]
    conv  convolution with a 3x3 kernel, stride 1 and padding 1

    Both steps are one transposed convolution, which has 4 products for a value in place of 9.
    """
    kernel = upsampling_kernel(conv.weight)
    return functional.conv_transpose2d(x, kernel, conv.bias, stride=2, padding=1)


def upsampling_kernel(kernel: Tensor) -> Tensor:
    """Return the kernel [cin, cout, 4, 4] of the transposed convolution of stride 2, padding 1.

    kernel  [cout, cin, 3, 3], of the convolution that follows nearest up-sampling x2
    """
    return 4 * functional.avg_pool2d(kernel.flip(2, 3), 2, stride=1, padding=1).transpose(0, 1)


class UpBlock(nn.Module):
    """The ResBlock of Table 1: BN-ReLU-conv-(x2)-BN-ReLU-conv beside a 1x1 convolution and x2.

    As in the original code, the shortcut is a convolution also where the widths agree. The second
    BN comes before the up-sampling here, where it has the same statistics and a quarter of the
    values.
    """

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__()
        self.bn1 = nn.BatchNorm2d(cin, eps=2e-5, momentum=0.1)
        self.conv1 = nn.Conv2d(cin, cout, 3, padding=1)
        self.bn2 = nn.BatchNorm2d(cout, eps=2e-5, momentum=0.1)
        self.conv2 = nn.Conv2d(cout, cout, 3, padding=1)
        self.shortcut = nn.Conv2d(cin, cout, 1)

    def forward(self, x: Tensor) -> Tensor:  # [B, cin, H, W]
        """Map [B, cin, H, W] to [B, cout, 2H, 2W]."""
        y = self.conv1(functional.relu(self.bn1(x)))  # [B, cout, H, W]
        y = _upsample_then_conv(functional.relu(self.bn2(y)), self.conv2)  # [B, cout, 2H, 2W]
        return y + functional.interpolate(self.shortcut(x), scale_factor=2.0)


class Generator(nn.Module):
    """The generator of Table 1, which makes an image of noise, code and angles.

    As in the original code, and unlike in Table 1, no ReLU follows the first dense layer.
    """

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        c = [config.scaled(channels) for channels in _GENERATOR_CHANNELS]
        angles = 1 + config.azimuth_numbers
        self.dense = nn.Linear(NOISE_DIM + config.latent_dim + angles, 4 * 4 * c[0])
        self.blocks = nn.ModuleList(UpBlock(cin, cout) for cin, cout in pairwise(c))
        self.bn = nn.BatchNorm2d(c[-1], eps=2e-5, momentum=0.1)
        self.conv = nn.Conv2d(c[-1], 3, 3, padding=1)
        initialise(self)

    def forward(
        self, noise: Tensor, code: Tensor, elevation01: Tensor, azimuth01: Tensor
    ) -> Tensor:
        """Return images of codes seen from angles.

        Parameters
        ----------
        noise : Tensor, [B, 128]
            Noise z, uniform in (-1, 1) while training.
        code : Tensor, [B, latent_dim]
            Code rho, whitened over the training set.
        elevation01 : Tensor, [B, 1]
            elevation_deg / 80 + 0.5.
        azimuth01 : Tensor, [B, 1]
            azimuth_deg / 360 + 0.5.

        Returns
        -------
        Tensor, [B, 3, 128, 128]
            Images in [-1, 1].
        """
        azimuth = azimuth01 if self.config.azimuth == "scalar" else sine_cosine(azimuth01)
        x = torch.cat([noise, code, elevation01, azimuth], dim=1)  # [B, 128 + d + 2 or 3]
        x = self.dense(x).unflatten(1, (4, 4, -1)).permute(0, 3, 1, 2)  # [B, c0, 4, 4]
        for block in self.blocks:
            x = block(x)  # [B, c1, 8, 8] ... [B, c5, 128, 128]
        return torch.tanh(self.conv(functional.relu(self.bn(x))))  # [B, 3, 128, 128]


@torch.no_grad()
def take_scaled_codes(generator: Generator, scale: Tensor, shift: Tensor) -> None:
    """Change a generator in place for codes of another scale.

    For a code y it then draws what it drew for scale * y + shift before.

    generator     on the CPU or a GPU
    scale, shift  [latent_dim], factors and offsets of the numbers of a code
    """
    kernel = generator.dense.weight[:, NOISE_DIM : NOISE_DIM + generator.config.latent_dim]
    generator.dense.bias.add_(kernel @ shift.to(kernel.device))
    kernel.mul_(scale.to(kernel.device))


# Discriminator: paper Table 2


def _spectrally_normalised(weight: Tensor, u: Tensor, *, store: bool) -> Tensor:
    """Return a kernel [cout, ...] divided by an estimate of its largest singular value.

    weight  the kernel; one of zeros gives NaN
    u       [cout], the estimate of the singular vector, at first drawn from N(0, 1)
    store   whether u is replaced by its better estimate

    As in the original, each forward pass takes one step of the power iteration from u, and the
    singular value from the new vectors. There are two differences. The original stores the new u in
    every forward pass; here only training does, so that evaluation has no side effect. And the
    original has gradients through u and v, which are constants here as in Miyato et al. 2018; this
    changes the gradient by 0.05 % or less once u has converged.

    It is computed in the precision of the weights, also within autocast.
    """
    with torch.autocast(weight.device.type, enabled=False):
        matrix = weight.flatten(1)  # [cout, K]
        with torch.no_grad():
            v = _unit(u @ matrix)  # [K]
            new_u = _unit(matrix @ v)  # [cout]
            if store:
                u.copy_(new_u)
        return weight / torch.dot(new_u, matrix @ v)


def _unit(vector: Tensor) -> Tensor:
    """Return a vector of length 1; zeros stay zeros."""
    return vector / (vector.norm() + 1e-12)


class _SpectralConv2d(nn.Conv2d):
    """A "same" convolution with spectral normalisation."""

    u: Tensor

    def __init__(self, cin: int, cout: int, kernel_size: int) -> None:
        super().__init__(cin, cout, kernel_size, padding=kernel_size // 2)
        self.register_buffer("u", torch.randn(cout))

    def forward(self, input: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, H, W]."""
        kernel = _spectrally_normalised(self.weight, self.u, store=self.training)
        return functional.conv2d(input, kernel, self.bias, padding=self.kernel_size[0] // 2)

    def then_pool(self, x: Tensor) -> Tensor:
        """Map [B, cin, 2H, 2W] to [B, cout, H, W]: 3x3 convolution, then 2x2 average pooling."""
        kernel = _spectrally_normalised(self.weight, self.u, store=self.training)
        kernel = functional.avg_pool2d(kernel, 2, stride=1, padding=1)  # 4x4
        return functional.conv2d(x, kernel, self.bias, stride=2, padding=1)


class SpectralLinear(nn.Linear):
    """The DenseSN of Table 2: a dense layer with spectral normalisation."""

    u: Tensor

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__(cin, cout)
        self.register_buffer("u", torch.randn(cout))

    def forward(self, input: Tensor) -> Tensor:
        """Map [B, cin] to [B, cout]."""
        kernel = _spectrally_normalised(self.weight, self.u, store=self.training)
        return functional.linear(input, kernel, self.bias)


class _DownBlock(nn.Module):
    """The ResBlockSN of Table 2: ReLU-conv-ReLU-conv-pool beside a 1x1 convolution and pool.

    As in the original code, the first block also begins with a ReLU, so that negative values of the
    image reach the network only through the shortcut.
    """

    def __init__(self, cin: int, cout: int, *, pool: bool = True) -> None:
        super().__init__()
        self.conv1 = _SpectralConv2d(cin, cout, 3)
        self.conv2 = _SpectralConv2d(cout, cout, 3)
        self.shortcut = _SpectralConv2d(cin, cout, 1)
        self.pool = pool

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, H/2, W/2], or to H and W without pooling."""
        y = functional.relu(self.conv1(functional.relu(x)))  # [B, cout, H, W]
        if not self.pool:
            return self.conv2(y) + self.shortcut(x)
        return self.conv2.then_pool(y) + self.shortcut(functional.avg_pool2d(x, 2))


class Discriminator(nn.Module):
    """The discriminator of Table 2: it tells whether an image is real, and its code and angles.

    All layers have spectral normalisation.
    """

    def __init__(self, config: ModelConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        c = [3, *(config.scaled(channels) for channels in _DISCRIMINATOR_CHANNELS)]
        h = [config.scaled(channels) for channels in _CODE_HEAD_CHANNELS]
        self.blocks = nn.ModuleList(_DownBlock(cin, cout) for cin, cout in pairwise(c))
        self.last_block = _DownBlock(c[-1], c[-1], pool=False)
        self.code_hidden = nn.ModuleList(
            SpectralLinear(cin, cout) for cin, cout in zip([8 * 8 * c[-2], *h[:-1]], h, strict=True)
        )
        self.code = SpectralLinear(h[-1], config.latent_dim)
        self.real = SpectralLinear(c[-1], 1)
        self.elevation = SpectralLinear(c[-1], 1)
        self.azimuth = SpectralLinear(c[-1], config.azimuth_numbers)
        initialise(self)

    def forward(self, images: Tensor) -> DiscriminatorOutput:
        """Return what the network tells of images; in training mode this updates every u.

        Parameters
        ----------
        images : Tensor, [B, 3, 128, 128]
            Images in [-1, 1].

        Returns
        -------
        DiscriminatorOutput
            Answers about the B images.
        """
        x = images
        for block in self.blocks[:-1]:
            x = block(x)  # [B, c1, 64, 64] ... [B, c4, 8, 8]
        code = x.permute(0, 2, 3, 1).flatten(1)  # [B, 64 c4]
        for layer in self.code_hidden:
            code = functional.relu(layer(code))  # [B, h]
        x = self.last_block(self.blocks[-1](x))  # [B, c5, 4, 4]
        x = functional.relu(x).sum(dim=(2, 3))  # [B, c5]
        # Gradients of the heads are added in this order. In another, sums have other rounding
        # errors, and trainings would not repeat.
        real_logit, code = self.real(x), self.code(code)
        elevation, azimuth = torch.sigmoid(self.elevation(x)), self.azimuth(x)
        if self.config.azimuth == "scalar":
            azimuth = torch.sigmoid(azimuth)
        return DiscriminatorOutput(real_logit, code, elevation, azimuth)
