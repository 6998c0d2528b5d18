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

import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.splat_net.projection import ALL_INPUTS, Inputs
from data_prep.failures import BadInput
from data_prep.scene import View

SMALLEST = 16  # the picture's side over that of the narrowest level: sizes must be its multiples
CAMERA_NUMBERS = 4  # sine and cosine of both angles
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
    code: int = 64
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
    inputs=Inputs(normals=False, flattened=False), widths=(8, 16, 32, 48, 64), code=32
)
LARGE = NetworkConfig(widths=(24, 48, 96, 192, 256), code=128)
SIZES = {"tiny": TINY, "default": DEFAULT, "large": LARGE}


class CloudCode(nn.Module):
    """A PointNet: points [B, N, 3] -> code [B, code] in -1..1, whatever their order and number."""

    def __init__(self, code: int) -> None:
        super().__init__()
        self.points = nn.Sequential(
            nn.Linear(3, 64), nn.ReLU(), nn.Linear(64, 128), nn.ReLU(), nn.Linear(128, 128)
        )
        self.cloud = nn.Sequential(nn.Linear(2 * 128 + 1, 128), nn.ReLU(), nn.Linear(128, code))

    def forward(self, points: Tensor) -> Tensor:
        """Bounded, so that a cloud unlike any seen can shift the picture only so far."""
        seen = self.points(points)
        count = torch.full_like(seen[:, :1, 0], float(points.shape[1])).log() - 7.0
        return torch.tanh(self.cloud(torch.cat([seen.amax(1), seen.mean(1), count], dim=1)))


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
        self.lift = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in reversed(pairs))
        self.up = nn.ModuleList(Block(a, a) for a, _ in reversed(pairs))
        self.last = nn.Conv2d(widths[0], config.outputs, 3, padding=1)
        if config.code:
            self.code = CloudCode(config.code)
            hidden = 2 * config.code
            self.film = nn.Sequential(
                nn.Linear(config.code + CAMERA_NUMBERS, hidden),
                nn.ReLU(),
                nn.Linear(hidden, 2 * widths[-1]),
            )

    def modulation(self, code: Tensor, angles: Tensor) -> tuple[Tensor, Tensor]:
        """What the code does at the narrowest level: x + shift + x scale, [P, widths[-1]] each."""
        scale, shift = self.film(torch.cat([code, angles], dim=1)).chunk(2, dim=1)
        return scale, shift

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
            scale, shift = self.modulation(code, angles)
            x = x + shift[:, :, None, None] + x * scale[:, :, None, None]
        for lift, level in zip(self.lift, self.up, strict=True):
            x = functional.interpolate(lift(x), scale_factor=2.0, mode="nearest")
            x = level(x + passed.pop())
        return self.last(x)


def camera_numbers(views: Sequence[View]) -> Tensor:
    """Sine and cosine of azimuth and elevation, float32 [V, CAMERA_NUMBERS]."""
    angles = torch.tensor([(math.remainder(v.azimuth_deg, 360), v.elevation_deg) for v in views])
    angles = torch.deg2rad(angles.view(-1, 2))
    return torch.cat([angles.sin(), angles.cos()], dim=1)


def composite(output: Tensor, heads: tuple[Material, ...]) -> tuple[Tensor, list[Tensor]]:
    """Alpha [P, 1, S, S] and, for each head, a picture on white [P, 3 or 1, S, S]; all in 0..1."""
    planes = torch.sigmoid(output.float())
    alpha, *covers = planes.split([1, *(PLANES[head] for head in heads)], dim=1)
    return alpha, [1 + alpha * (cover - 1) for cover in covers]
