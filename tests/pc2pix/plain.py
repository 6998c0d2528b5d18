"""The paper's networks and its losses in plain PyTorch, to compare a training step with.

No code is shared with `pc2pix` and none of its savings is used: nearest up-sampling and then a 3x3
convolution, a 3x3 convolution and then average pooling, real and drawn images in passes of their
own, singular values in place of power iteration. The names of the layers are the same.
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
    relu,
)

NOISE = 128


class Target(NamedTuple):
    """The content of images [B, 3, 128, 128]: code [B, d], elevation and azimuth [B, 1] in 0..1."""

    code: Tensor
    elevation: Tensor
    azimuth: Tensor


class PlainUpBlock(nn.Module):
    """BN-ReLU-conv-up-BN-ReLU-conv beside conv-up: [B, cin, H, W] to [B, cout, 2H, 2W]."""

    def __init__(self, cin: int, cout: int) -> None:
        super().__init__()
        self.bn1 = nn.BatchNorm2d(cin, eps=2e-5)
        self.conv1 = nn.Conv2d(cin, cout, 3, padding=1)
        self.bn2 = nn.BatchNorm2d(cout, eps=2e-5)
        self.conv2 = nn.Conv2d(cout, cout, 3, padding=1)
        self.shortcut = nn.Conv2d(cin, cout, 1)

    def forward(self, x: Tensor) -> Tensor:
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
        x = self.dense(torch.cat([noise, *wanted], dim=1))
        x = x.reshape(len(x), 4, 4, -1).permute(0, 3, 1, 2)
        return torch.tanh(self.conv(relu(self.bn(self.blocks(x)))))


def normalised(weight: Tensor) -> Tensor:
    """Return a kernel divided by its largest singular value."""
    return weight / torch.linalg.matrix_norm(weight.flatten(1), 2)


class PlainConv(nn.Conv2d):
    """A "same" convolution with a normalised kernel."""

    def forward(self, x: Tensor) -> Tensor:
        return conv2d(x, normalised(self.weight), self.bias, padding="same")


class PlainDense(nn.Linear):
    """A dense layer with a normalised kernel."""

    def forward(self, x: Tensor) -> Tensor:
        return linear(x, normalised(self.weight), self.bias)


class PlainDownBlock(nn.Module):
    """ReLU-conv-ReLU-conv-pool beside conv-pool, which halves the size; the last has no pool."""

    def __init__(self, cin: int, cout: int, pool: bool) -> None:
        super().__init__()
        self.conv1 = PlainConv(cin, cout, 3)
        self.conv2 = PlainConv(cout, cout, 3)
        self.shortcut = PlainConv(cin, cout, 1)
        self.pool = pool

    def forward(self, x: Tensor) -> Tensor:
        y = self.conv2(relu(self.conv1(relu(x)))) + self.shortcut(x)
        return avg_pool2d(y, 2) if self.pool else y


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
        code = x.permute(0, 2, 3, 1).flatten(1)
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
