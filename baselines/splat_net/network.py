"""The network: a U-Net over the projected points, with a code of the whole cloud at its narrowest.

It predicts how much of a pixel is covered (alpha) and what covers it apart; the picture is their
composite on white. What covers it has a head for each material: the object's own colours, which are
a guess, or the neutral grey that reconstructions are rendered in. Both are trained at once, on one
trunk; bundled weights have one of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.splat_net.projection import ALL_INPUTS, Inputs
from data_prep.failures import BadInput
from data_prep.scene import View

SMALLEST = 16  # the picture's side over that of the narrowest level: sizes must be its multiples
CODE_POINTS = 1024  # of a cloud, at most
CAMERA_NUMBERS = 4  # sine and cosine of both angles
PRIOR = 24  # channels that say what is to be expected
Material = Literal["colour", "grey"]
PLANES: dict[Material, int] = {"colour": 3, "grey": 1}


@dataclass(frozen=True)
class NetworkConfig:
    """What the network looks like.

    widths  channels at 128, 64, 32, 16 and 8 pixels
    code    numbers that say what the whole cloud is; 0: there is no code
    heads   materials that it draws in
    """

    inputs: Inputs = ALL_INPUTS
    widths: tuple[int, ...] = (16, 32, 64, 128, 160)
    code: int = 128
    heads: tuple[Material, ...] = ("colour", "grey")

    def __post_init__(self) -> None:
        if len(self.widths) != 5 or min(self.widths) < 1:
            raise BadInput(f"widths {self.widths}: expected five numbers, each at least 1")

    @property
    def outputs(self) -> int:
        """Alpha, and what each head has."""
        return 1 + sum(PLANES[head] for head in self.heads)


DEFAULT = NetworkConfig()
# Normals and flattened points cost more than all of its layers.
TINY = NetworkConfig(
    inputs=Inputs(normals=False, flattened=False), widths=(8, 16, 32, 48, 64), code=64
)
LARGE = NetworkConfig(widths=(24, 48, 96, 192, 224))
SIZES = {"tiny": TINY, "default": DEFAULT, "large": LARGE}


class CloudCode(nn.Module):
    """A PointNet: points [B, N, 3] -> code [B, code] in -1..1, whatever their order and number."""

    def __init__(self, code: int) -> None:
        super().__init__()
        self.points = nn.Sequential(
            nn.Linear(3, 64), nn.ReLU(), nn.Linear(64, 128), nn.ReLU(), nn.Linear(128, 256)
        )
        self.cloud = nn.Sequential(nn.Linear(2 * 256 + 1, 256), nn.ReLU(), nn.Linear(256, code))

    def forward(self, points: Tensor) -> Tensor:
        """Bounded, so that a cloud unlike any seen can shift the picture only so far."""
        seen = self.points(points)
        count = torch.full_like(seen[:, :1, 0], float(points.shape[1])).log() - 7.0
        return torch.tanh(self.cloud(torch.cat([seen.amax(1), seen.mean(1), count], dim=1)))


class Prior(nn.Module):
    """What such a cloud looks like from there: code and angles -> [P, PRIOR, S / 16, S / 16].

    A map of 8x8, resized for pictures of another size than 128.
    """

    def __init__(self, code: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(code + CAMERA_NUMBERS, 128), nn.ReLU(), nn.Linear(128, PRIOR * 64)
        )

    def forward(self, code: Tensor, angles: Tensor, size: int) -> Tensor:
        """`size` is that of the narrowest level."""
        drawn = self.layers(torch.cat([code, angles], dim=1)).unflatten(1, (PRIOR, 8, 8))
        if size == 8:
            return drawn
        return functional.interpolate(drawn, (size, size), mode="bilinear", align_corners=False)


class Block(nn.Sequential):
    """Convolution, normalisation, ReLU. `norm` is folded into the convolution for inference."""

    def __init__(self, cin: int, cout: int, stride: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(cin, cout, 3, stride, 1, bias=False)
        self.norm = nn.BatchNorm2d(cout)
        self.act = nn.ReLU(inplace=True)


class SplatNet(nn.Module):
    """Pictures of projected points."""

    def __init__(self, config: NetworkConfig = DEFAULT) -> None:
        super().__init__()
        self.config = config
        widths = config.widths
        self.first = Block(config.inputs.channels, widths[0])
        pairs = list(pairwise(widths))
        self.down = nn.ModuleList(
            nn.Sequential(Block(a, b, stride=2), Block(b, b)) for a, b in pairs
        )
        narrow = widths[-1] + (PRIOR if config.code else 0)
        self.middle = Block(narrow, widths[-1])
        self.lift = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in reversed(pairs))
        # two at the coarse levels, where they are cheap
        self.up = nn.ModuleList(
            nn.Sequential(*(Block(a, a) for _ in range(2 if a >= widths[2] else 1)))
            for a, _ in reversed(pairs)
        )
        self.last = nn.Conv2d(widths[0], config.outputs, 3, padding=1)
        if config.code:
            self.code = CloudCode(config.code)
            self.prior = Prior(config.code)

    def forward(self, channels: Tensor, code: Tensor | None, angles: Tensor) -> Tensor:
        """Alpha and the heads' planes, before the sigmoid: [P, outputs, S, S].

        channels  [P, C, S, S] of `project`
        code      [P, code] of `CloudCode`; None where the network has none
        angles    [P, CAMERA_NUMBERS]
        """
        x = self.first(channels)
        passed = []
        for level in self.down:
            passed.append(x)
            x = level(x)
        if code is not None:
            x = torch.cat([x, self.prior(code, angles, x.shape[-1]).to(x.dtype)], dim=1)
        x = self.middle(x)
        for lift, level in zip(self.lift, self.up, strict=True):
            x = functional.interpolate(lift(x), scale_factor=2.0, mode="nearest")
            x = level(x + passed.pop())
        return self.last(x)


def code_rows(count: int) -> Tensor:
    """Which of `count` sorted points the code is made from: all, or CODE_POINTS at random.

    The choice depends on their number alone.
    """
    if count <= CODE_POINTS:
        return torch.arange(count)
    return torch.from_numpy(np.random.default_rng(count).permutation(count)[:CODE_POINTS])


def camera_numbers(views: Sequence[View]) -> Tensor:
    """Sine and cosine of azimuth and elevation, float32 [V, CAMERA_NUMBERS]."""
    angles = [(math.remainder(v.azimuth_deg, 360), v.elevation_deg) for v in views]
    angles = torch.deg2rad(torch.tensor(angles, dtype=torch.float32).view(-1, 2))
    return torch.cat([angles.sin(), angles.cos()], dim=1)


def composite(output: Tensor, heads: tuple[Material, ...]) -> tuple[Tensor, list[Tensor]]:
    """Alpha [P, 1, S, S] and, for each head, a picture on white [P, 3 or 1, S, S]; all in 0..1."""
    planes = torch.sigmoid(output.float())
    alpha, *covers = planes.split([1, *(PLANES[head] for head in heads)], dim=1)
    return alpha, [1 + alpha * (cover - 1) for cover in covers]
