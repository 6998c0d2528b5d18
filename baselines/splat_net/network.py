"""The network: a U-Net over the projected points.

It predicts how much of a pixel is covered (alpha) and, apart from it, what covers it; the image is
their composite on white. A head for each material tells what covers a pixel: "grey" in the neutral
grey that reconstructions are rendered in, "colour" in colours of its own at every pixel. The light
shines along the view, so the grey image is the shading of any material. A cloud has no colours, and
"albedo" guesses one colour for the whole image, which the shading of "grey" is multiplied with.
Heads are trained together, on one trunk; a file of weights has the heads of one image.
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
from data_prep.scene import NEUTRAL_GREY

SMALLEST = 16  # the image's side over that of the narrowest level: sizes must be its multiples
Material = Literal["colour", "grey", "albedo"]
_Body = Literal["splat-net", "points2pix"]
BODIES: tuple[_Body, ...] = get_args(_Body)
PLANES: dict[Material, int] = {"colour": 3, "grey": 1, "albedo": 3}
NEUTRAL = NEUTRAL_GREY[0] / 255  # a grey pixel over it is the shading, 0..1
# In training, and of a file of weights: a colour for each pixel, or one for the image.
COLOUR_HEADS: dict[str, tuple[Material, ...]] = {
    "pixel": ("colour", "grey"),
    "image": ("grey", "albedo"),
}


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
    body: _Body = "splat-net"

    def __post_init__(self) -> None:
        if len(self.widths) != 5 or min(self.widths) < 1:
            raise BadInput(f"widths {self.widths}: expected five numbers, each at least 1")
        if "albedo" in self.heads and (self.heads, self.body) != (("grey", "albedo"), "splat-net"):
            raise BadInput(
                f"heads {self.heads} of {self.body}: an albedo goes with the head grey of "
                "splat-net; use ('grey', 'albedo')"
            )

    @property
    def outputs(self) -> int:
        """Return the number of planes of the last convolution: alpha, and those of each head.

        The albedo has none: it is the same at every pixel.
        """
        return 1 + sum(PLANES[head] for head in self.heads if head != "albedo")


DEFAULT = NetworkConfig()
POINTS2PIX = NetworkConfig(
    inputs=Inputs((1,), normals=False, density=False, flattened=False, far=False),
    widths=(16, 32, 64, 96, 96),
    body="points2pix",
)
NETWORKS = {"default": DEFAULT, "points2pix": POINTS2PIX}


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
        if "albedo" in config.heads:
            self.albedo = nn.Linear(widths[-1], PLANES["albedo"])

    def forward(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return alpha and the heads' planes [P, planes, S, S], before the sigmoid.

        Planes of the albedo have one value an image. `points` are not used.
        """
        x = self.first(channels)
        passed = []
        for level in self.down:
            passed.append(x)
            x = level(x)
        x = middle = self.middle(x)
        for lift, level in zip(self.lift, self.up, strict=True):
            x = functional.interpolate(lift(x), scale_factor=2.0, mode="nearest")
            x = level(x + passed.pop())
        planes = self.last(x)
        if "albedo" not in self.config.heads:
            return planes
        # a wrong guess of the colour must not change the shape: nothing is learned from it here
        albedo = self.albedo(middle.detach().mean(dim=(2, 3))).to(planes)[:, :, None, None]
        return torch.cat([planes, albedo.expand(-1, -1, *planes.shape[2:])], dim=1)


def composite(output: Tensor, heads: tuple[Material, ...]) -> tuple[Tensor, list[Tensor]]:
    """Return alpha [P, 1, S, S] and an image on white [P, 3 or 1, S, S] for each head.

    All lie in 0..1. No gradient of an image by the albedo reaches alpha or the shading.
    """
    planes = torch.sigmoid(output.float())
    alpha, *covers = planes.split([1, *(PLANES[head] for head in heads)], dim=1)
    images = [1 + alpha * (cover - 1) for cover in covers]
    if "albedo" in heads:
        grey, albedo = covers
        images[1] = 1 + alpha.detach() * (albedo * shading_of(grey.detach()) - 1)
    return alpha, images


def shading_of(cover: Tensor) -> Tensor:
    """Return the shading, cos(t)^(1/2.2) for a tilt t, of what covers a grey pixel; both 0..1."""
    return (cover / NEUTRAL).clamp(max=1.0)
