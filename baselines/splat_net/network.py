"""The network of splat-net: a U-Net over the projected points.

For each pixel it predicts how much of it is covered (alpha), and what covers it; the image is their
composite on white. What covers a pixel is told by heads, one for each material. The head "grey"
tells it in the neutral grey that reconstructions are rendered in, and "colour" in a colour for each
pixel. A third head, "albedo", guesses one colour for the whole image. It is multiplied by the
shading, which the grey image shows, because the light shines along the view. The heads are
trained together on one U-Net. A file of weights has only those that one image needs.
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

# The U-Net halves images four times, so that the side of an image must be a multiple of this.
SMALLEST = 16
Material = Literal["colour", "grey", "albedo"]
_Body = Literal["splat-net", "points2pix"]
BODIES: tuple[_Body, ...] = get_args(_Body)
PLANES: dict[Material, int] = {"colour": 3, "grey": 1, "albedo": 3}  # numbers of a head, at a pixel
# Neutral grey in full light, 0..1: the grey of a covered pixel divided by it is the shading.
NEUTRAL = NEUTRAL_GREY[0] / 255
# The heads that are trained together: for a colour at each pixel, or for one colour of the image.
COLOUR_HEADS: dict[str, tuple[Material, ...]] = {
    "pixel": ("colour", "grey"),
    "image": ("grey", "albedo"),
}


@dataclass(frozen=True)
class NetworkConfig:
    """The shape of a network.

    inputs  its input channels
    widths  channels of the five levels, where an image of 128 pixels has 128, 64, 32, 16 and 8
    heads   materials that it draws in
    body    "splat-net" for the U-Net of this module, "points2pix" for
            `baselines.splat_net.points2pix`

    Raises BadInput for other than five widths, a width below 1, and an albedo without its grey.
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
    """A convolution, normalisation and ReLU; for inference `norm` is folded into `conv`."""

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
        self.up = nn.ModuleList()
        for width, _ in reversed(pairs):
            coarse = width >= widths[2]  # there a second block is cheap
            blocks = [Block(width, width), Block(width, width)] if coarse else [Block(width, width)]
            self.up.append(nn.Sequential(*blocks))
        self.last = nn.Conv2d(widths[0], config.outputs, 3, padding=1)
        if "albedo" in config.heads:
            self.albedo = nn.Linear(widths[-1], PLANES["albedo"])

    def forward(self, channels: Tensor, points: Tensor | None = None) -> Tensor:
        """Return alpha and the planes of the heads, [P, planes, S, S], before the sigmoid.

        channels  [P, C, S, S], of `baselines.splat_net.projection`
        points    not used; `Points2Pix` needs them

        The three planes of the albedo have the same value at all pixels of an image.
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
        # `detach`: errors of the guessed colour must not change the features that make the shape.
        albedo = self.albedo(middle.detach().mean(dim=(2, 3))).to(planes)[:, :, None, None]
        return torch.cat([planes, albedo.expand(-1, -1, *planes.shape[2:])], dim=1)


def composite(output: Tensor, heads: tuple[Material, ...]) -> tuple[Tensor, list[Tensor]]:
    """Return alpha [P, 1, S, S] and, for each head, an image on white [P, 3 or 1, S, S].

    output  [P, planes, S, S], of the network, before the sigmoid

    All values lie in 0..1. The image that is made with the albedo gives no gradient to alpha and to
    the shading.
    """
    planes = torch.sigmoid(output.float())
    counts = [PLANES[head] for head in heads]
    alpha, *covers = planes.split([1, *counts], dim=1)
    images = [1 + alpha * (cover - 1) for cover in covers]
    if "albedo" in heads:
        grey, albedo = covers
        images[1] = 1 + alpha.detach() * (albedo * shading_of(grey.detach()) - 1)
    return alpha, images


def shading_of(cover: Tensor) -> Tensor:
    """Return the shading, 0..1, of what covers a pixel in neutral grey, 0..1.

    It is cos(t)^(1/2.2), where t is the angle between the surface's normal and the view.
    """
    return (cover / NEUTRAL).clamp(max=1.0)
