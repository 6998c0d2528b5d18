"""The paper's networks and its training step in plain PyTorch, as the reference for speed.

No code is shared with `pc2pix` and none of its savings is used: nearest up-sampling and then a 3x3
convolution, a 3x3 convolution and then average pooling, real and drawn images in passes of their
own, contiguous memory, float32, PyTorch's default Adam. The names of the layers are the same, so
that weights can be handed over (PyTorch's `load_state_dict`).

Objective `acgan-code`, azimuth as one number, encoder frozen. There is no average of the weights
and no writing, which `pc2pix` does pay for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import (
    avg_pool2d,
    binary_cross_entropy_with_logits,
    conv2d,
    interpolate,
    l1_loss,
    linear,
    normalize,
    relu,
)

NOISE = 128


class Target(NamedTuple):
    """The content of images [B, 3, 128, 128]: code [B, d], elevation and azimuth [B, 1] in 0..1."""

    code: Tensor
    elevation: Tensor
    azimuth: Tensor


class PlainUpBlock(nn.Module):
    """The up-sampling block: BN-ReLU-conv-up-BN-ReLU-conv beside conv-up, as in the paper."""

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__()
        self.bn1 = nn.BatchNorm2d(cin, eps=2e-5)
        self.conv1 = nn.Conv2d(cin, cout, 3, padding=1)
        self.bn2 = nn.BatchNorm2d(cout, eps=2e-5)
        self.conv2 = nn.Conv2d(cout, cout, 3, padding=1)
        self.shortcut = nn.Conv2d(cin, cout, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, 2H, 2W]."""
        y = self.conv1(relu(self.bn1(x)))
        y = interpolate(y, scale_factor=2.0, mode="nearest")
        y = self.conv2(relu(self.bn2(y)))
        return y + interpolate(self.shortcut(x), scale_factor=2.0, mode="nearest")


class PlainGenerator(nn.Module):
    """The generator of Table 1."""

    def __init__(self, width: float, code: int) -> None:
        super().__init__()
        c = [round(n * width) for n in (1024, 1024, 512, 256, 128, 64)]
        self.dense = nn.Linear(NOISE + code + 2, 16 * c[0])
        self.blocks = nn.Sequential(*(PlainUpBlock(c[i], c[i + 1]) for i in range(5)))
        self.bn = nn.BatchNorm2d(c[-1], eps=2e-5)
        self.conv = nn.Conv2d(c[-1], 3, 3, padding=1)

    def forward(self, noise: Tensor, wanted: Target) -> Tensor:
        """Return images [B, 3, 128, 128]."""
        x = self.dense(torch.cat([noise, *wanted], dim=1))
        x = x.reshape(len(x), 4, 4, -1).permute(0, 3, 1, 2).contiguous()
        return torch.tanh(self.conv(relu(self.bn(self.blocks(x)))))


class SpectralNorm(nn.Module):
    """A kernel divided by its largest singular value, one power iteration a pass."""

    u: Tensor

    def __init__(self, *shape: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(shape))
        self.bias = nn.Parameter(torch.zeros(shape[0]))
        self.register_buffer("u", torch.randn(shape[0]))

    def normalised(self) -> Tensor:
        """Return the kernel to use in this pass."""
        matrix = self.weight.reshape(len(self.weight), -1)
        with torch.no_grad():
            v = normalize(matrix.t() @ self.u, dim=0)
            u = normalize(matrix @ v, dim=0)
            self.u.copy_(u)
        return self.weight / (u @ (matrix @ v))


class PlainConv(SpectralNorm):
    """A "same" convolution."""

    def __init__(self, cin: int, cout: int, size: int) -> None:
        super().__init__(cout, cin, size, size)

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, H, W]."""
        return conv2d(x, self.normalised(), self.bias, padding="same")


class PlainDense(SpectralNorm):
    """A dense layer."""

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__(cout, cin)

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin] to [B, cout]."""
        return linear(x, self.normalised(), self.bias)


class PlainDownBlock(nn.Module):
    """The down-sampling block: ReLU-conv-ReLU-conv-pool beside conv-pool; the last has no pool."""

    def __init__(self, cin: int, cout: int, pool: bool) -> None:
        super().__init__()
        self.conv1 = PlainConv(cin, cout, 3)
        self.conv2 = PlainConv(cout, cout, 3)
        self.shortcut = PlainConv(cin, cout, 1)
        self.pool = pool

    def forward(self, x: Tensor) -> Tensor:
        """Map [B, cin, H, W] to [B, cout, H/2, W/2], or to H and W without pooling."""
        y = self.conv2(relu(self.conv1(relu(x))))
        shortcut = self.shortcut(x)
        return avg_pool2d(y, 2) + avg_pool2d(shortcut, 2) if self.pool else y + shortcut


class PlainDiscriminator(nn.Module):
    """The discriminator of Table 2."""

    def __init__(self, width: float, code: int) -> None:
        super().__init__()
        c = [3, *(round(n * width) for n in (64, 128, 256, 512, 1024))]
        h = [64 * c[4], *(round(n * width) for n in (256, 1024, 1024, 1024))]
        self.blocks = nn.ModuleList(PlainDownBlock(c[i], c[i + 1], pool=True) for i in range(5))
        self.last_block = PlainDownBlock(c[5], c[5], pool=False)
        self.code_hidden = nn.ModuleList(PlainDense(h[i], h[i + 1]) for i in range(4))
        self.code = PlainDense(h[4], code)
        self.real, self.elevation, self.azimuth = (PlainDense(c[5], 1) for _ in range(3))

    def forward(self, x: Tensor) -> tuple[Tensor, Target]:
        """Return the logit of being real [B, 1], and what is recognised."""
        for block in self.blocks[:4]:
            x = block(x)
        code = x.permute(0, 2, 3, 1).reshape(len(x), -1)
        for layer in self.code_hidden:
            code = relu(layer(code))
        x = relu(self.last_block(self.blocks[4](x))).sum(dim=(2, 3))
        angles = torch.sigmoid(self.elevation(x)), torch.sigmoid(self.azimuth(x))
        return self.real(x), Target(self.code(code), *angles)


def angle_loss(recognised: Tensor, wanted: Tensor, range_rad: float) -> Tensor:
    """Return the paper's L_theta, in radians."""
    delta = range_rad * (wanted - recognised)
    return torch.atan2(torch.sin(delta), torch.cos(delta)).abs().mean()


def loss(judged: tuple[Tensor, Target], wanted: Target, label: float) -> Tensor:
    """Return cross entropy and ten times each error, as in the original code."""
    logit, recognised = judged
    return (
        binary_cross_entropy_with_logits(logit, torch.full_like(logit, label))
        + 10 * l1_loss(recognised.code, wanted.code)
        + 10 * angle_loss(recognised.elevation, wanted.elevation, 0.4444 * math.pi)
        + 10 * angle_loss(recognised.azimuth, wanted.azimuth, 2 * math.pi)
    )


class PlainLoop:
    """The alternating training: one step of the discriminator, one of the generator."""

    def __init__(
        self, width: float, code: int, generator_lr: float = 1e-4, discriminator_lr: float = 2e-4
    ) -> None:
        self.generator = PlainGenerator(width, code)
        self.discriminator = PlainDiscriminator(width, code)
        self.g_adam = torch.optim.Adam(self.generator.parameters(), generator_lr, (0.5, 0.999))
        self.d_adam = torch.optim.Adam(
            self.discriminator.parameters(), discriminator_lr, (0.5, 0.999)
        )

    def step(
        self,
        images: Tensor,
        shown: Target,
        noises: tuple[Tensor, Tensor],
        wanted: tuple[Target, Target],
    ) -> tuple[float, float]:
        """Return the losses of discriminator and generator.

        `noises` and `wanted` have one entry for each.
        """
        with torch.no_grad():
            drawn = self.generator(noises[0], wanted[0])
        d_loss = loss(self.discriminator(images), shown, 1.0)
        d_loss = d_loss + loss(self.discriminator(drawn), wanted[0], 0.0)
        self.d_adam.zero_grad()
        d_loss.backward()
        self.d_adam.step()

        self.discriminator.requires_grad_(False)
        drawn = self.generator(noises[1], wanted[1])
        g_loss = loss(self.discriminator(drawn), wanted[1], 1.0)
        self.g_adam.zero_grad()
        g_loss.backward()
        self.g_adam.step()
        self.discriminator.requires_grad_(True)
        return d_loss.item(), g_loss.item()
