"""The network: a U-Net over the projected points.

It predicts how much of a pixel is covered (alpha) and what covers it apart; the image is their
composite on white. What covers it has a head for each material: the object's own colours, which are
a guess, or the neutral grey that reconstructions are rendered in. Both are trained at once, on one
trunk; bundled weights have one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.splat_net.projection import ALL_INPUTS, Inputs
from data_prep.failures import BadInput

SMALLEST = 16  # the image's side over that of the narrowest level: sizes must be its multiples
Material = Literal["colour", "grey"]
Body = Literal["splat-net", "points2pix"]
BODIES: tuple[Body, ...] = get_args(Body)
PLANES: dict[Material, int] = {"colour": 3, "grey": 1}


@dataclass(frozen=True)
class NetworkConfig:
    """The shape of the network.

    widths  channels at 128, 64, 32, 16 and 8 pixels
    heads   materials that it draws in
    body    what lies between: this module's, or `baselines.splat_net.points2pix`
    """

    inputs: Inputs = ALL_INPUTS
    widths: tuple[int, ...] = (16, 32, 64, 128, 160)
    heads: tuple[Material, ...] = ("colour", "grey")
    body: Body = "splat-net"

    def __post_init__(self) -> None:
        if len(self.widths) != 5 or min(self.widths) < 1:
            raise BadInput(f"widths {self.widths}: expected five numbers, each at least 1")

    @property
    def outputs(self) -> int:
        """Return the number of output planes: one for alpha, and those of each head."""
        return 1 + sum(PLANES[head] for head in self.heads)


DEFAULT = NetworkConfig()
# Normals and flattened points cost more than all of its layers.
TINY = NetworkConfig(inputs=Inputs(normals=False, flattened=False), widths=(8, 16, 32, 48, 64))
LARGE = NetworkConfig(widths=(24, 48, 96, 192, 224))
# The nearest depth alone, as Z2P has it.
DEPTH = NetworkConfig(
    inputs=Inputs(normals=False, density=False, flattened=False, far=False, noise=False)
)
POINTS2PIX = NetworkConfig(
    inputs=Inputs((1,), normals=False, density=False, flattened=False, far=False),
    widths=(16, 32, 64, 96, 96),
    body="points2pix",
)
NETWORKS = {
    "tiny": TINY,
    "default": DEFAULT,
    "large": LARGE,
    "depth": DEPTH,
    "points2pix": POINTS2PIX,
}


class Block(nn.Sequential):
    """A convolution, normalisation and ReLU; inference folds `norm` into the convolution."""

    def __init__(self, cin: int, cout: int, stride: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(cin, cout, 3, stride, 1, bias=False)
        self.norm = nn.BatchNorm2d(cout)
        self.act = nn.ReLU(inplace=True)


class SplatNet(nn.Module):
    """The U-Net from projected points to the planes of images."""

    def __init__(self, config: NetworkConfig = DEFAULT) -> None:
        super().__init__()
        self.config = config
        widths = config.widths
        self.first = Block(config.inputs.channels, widths[0])
        pairs = list(pairwise(widths))
        self.down = nn.ModuleList(
            nn.Sequential(Block(a, b, stride=2), Block(b, b)) for a, b in pairs
        )
        self.middle = Block(widths[-1], widths[-1])
        self.lift = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in reversed(pairs))
        # two at the coarse levels, where they are cheap
        self.up = nn.ModuleList(
            nn.Sequential(*(Block(a, a) for _ in range(2 if a >= widths[2] else 1)))
            for a, _ in reversed(pairs)
        )
        self.last = nn.Conv2d(widths[0], config.outputs, 3, padding=1)

    def forward(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return alpha and the heads' planes [P, outputs, S, S], before the sigmoid.

        channels  [P, C, S, S] of `project`
        points    not used: all that is known of them is projected
        """
        x = self.first(channels)
        passed = []
        for level in self.down:
            passed.append(x)
            x = level(x)
        x = self.middle(x)
        for lift, level in zip(self.lift, self.up, strict=True):
            x = functional.interpolate(lift(x), scale_factor=2.0, mode="nearest")
            x = level(x + passed.pop())
        return self.last(x)


def composite(output: Tensor, heads: tuple[Material, ...]) -> tuple[Tensor, list[Tensor]]:
    """Return alpha [P, 1, S, S] and an image on white [P, 3 or 1, S, S] for each head.

    All lie in 0..1.
    """
    planes = torch.sigmoid(output.float())
    alpha, *covers = planes.split([1, *(PLANES[head] for head in heads)], dim=1)
    return alpha, [1 + alpha * (cover - 1) for cover in covers]
