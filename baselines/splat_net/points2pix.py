"""points2pix: the U-Net of pix2pix on the projected points, with a code of the cloud in its middle.

It follows Milz et al. 2019 (https://arxiv.org/abs/1901.09280). A PointNet (Qi et al. 2017) makes a
code of the points in the camera's frame, which is joined to the narrowest level of the U-Net of
pix2pix (Isola et al. 2017, https://arxiv.org/abs/1611.07004). Their network also sees a patch of
the background; it is left out here, where the background is always white. Widths are like those of
splat-net, so that both networks have about as many parameters. As in splat-net, one output is the
coverage, and the others tell what covers a pixel, for each material.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.splat_net.network import NetworkConfig, SplatNet, composite
from data_prep.rendering.camera import CAMERA_DISTANCE

CODE = 128  # length of the code of the cloud
_SLOPE = 0.2  # of LeakyReLU below 0, as in pix2pix
_DROPPED = 0.5  # share of channels that training drops in the first two levels upwards


class PointNetCode(nn.Sequential):
    """A PointNet: of points [P, 3, N], in any order, it makes codes [P, CODE]."""

    def __init__(self) -> None:
        layers: list[nn.Module] = []
        for a, b in pairwise((3, 32, 64, CODE)):
            layers += [nn.Conv1d(a, b, 1), nn.ReLU(inplace=True)]
        super().__init__(*layers, nn.AdaptiveMaxPool1d(1), nn.Flatten(), nn.Linear(CODE, CODE))


class Points2Pix(nn.Module):
    """The network, which makes planes of images from projected points and the points themselves."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        # Seven levels, from 128 pixels down to one: the last two have the width of the fifth.
        widths = (*config.widths, config.widths[-1], config.widths[-1])
        self.code = PointNetCode()
        self.down = nn.ModuleList()
        wide = config.inputs.channels
        for level, width in enumerate(widths):
            # As in pix2pix the first level is not normalised, nor is the last: a single pixel has
            # no statistics.
            normalised = 0 < level < len(widths) - 1
            layers: list[nn.Module] = []
            if level > 0:
                layers.append(nn.LeakyReLU(_SLOPE))
            layers.append(nn.Conv2d(wide, width, 4, 2, 1, bias=not normalised))
            if normalised:
                layers.append(nn.BatchNorm2d(width))
            self.down.append(nn.Sequential(*layers))
            wide = width
        self.up = nn.ModuleList()
        wide += CODE
        for level, width in enumerate(reversed(widths[:-1])):
            layers = [
                nn.ReLU(),
                nn.ConvTranspose2d(wide, width, 4, 2, 1, bias=False),
                nn.BatchNorm2d(width),
            ]
            if level < 2:
                layers.append(nn.Dropout(_DROPPED))
            self.up.append(nn.Sequential(*layers))
            wide = 2 * width
        self.last = nn.Conv2d(wide, config.outputs, 3, padding=1)

    def forward(self, channels: Tensor, points: Tensor) -> Tensor:
        """Return alpha and the planes of the heads, [P, outputs, 128, 128], before the sigmoid.

        channels  [P, C, 128, 128], of `baselines.splat_net.projection`
        points    [P, 3, N], in the camera's frame
        """
        x, passed = channels, []
        for level in self.down:
            x = level(x)
            passed.append(x)
        # The PointNet sees the points about the origin, where the object is, not about the camera.
        centred = points + points.new_tensor([0.0, 0.0, CAMERA_DISTANCE])[:, None]
        x = torch.cat([passed.pop(), self.code(centred)[:, :, None, None]], dim=1)
        for level in self.up:
            x = torch.cat([level(x), passed.pop()], dim=1)
        x = functional.interpolate(torch.relu(x), scale_factor=2.0, mode="nearest")
        return self.last(x)


class Points2PixEngine:
    """The network for inference, with the same calls as `engine.FoldedSplatNet`."""

    dtype = torch.float32

    def __init__(self, network: Points2Pix) -> None:
        self.network = network

    def __call__(self, channels: Tensor, points: Tensor) -> Tensor:
        """Return images of the first head, float32 [P, 128, 128, 3] in 0..1."""
        output = self.network(channels, points)
        _, images = composite(output, self.network.config.heads)
        return images[0].expand(-1, 3, -1, -1).permute(0, 2, 3, 1)

    def coverage(self, channels: Tensor, points: Tensor) -> Tensor:
        """Return the share of each pixel that is covered, float32 [P, 128, 128, 1] in 0..1."""
        alpha, _ = composite(self.network(channels, points), self.network.config.heads)
        return alpha.permute(0, 2, 3, 1)


Network = SplatNet | Points2Pix


def build(config: NetworkConfig) -> Network:
    """Return the network of a configuration, with random weights."""
    return Points2Pix(config) if config.body == "points2pix" else SplatNet(config)
