"""points2pix: the U-Net of pix2pix on the projected points, with a code of the cloud in its middle.

After Milz et al. 2019 (https://arxiv.org/abs/1901.09280): PointNet (Qi et al. 2017) on the points,
in the camera's frame, is joined with the narrowest level of the U-Net of pix2pix (Isola et al.
2017, https://arxiv.org/abs/1611.07004). Their third condition, a patch of the background, is white
in every image here and says nothing: it is left out. Widths are those of splat-net, so that both
have about as many parameters; like it, the network has a head for the coverage and one for each
material.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.splat_net.network import NetworkConfig, SplatNet, composite
from data_prep.rendering.camera import CAMERA_DISTANCE

CODE = 128  # numbers of the code of the cloud
_SLOPE = 0.2
_DROPPED = 0.5  # of the channels of the widest two levels that go up, in training


class PointNetCode(nn.Sequential):
    """A PointNet from points [P, 3, N] to codes [P, CODE]; their order does not matter."""

    def __init__(self) -> None:
        layers: list[nn.Module] = []
        for a, b in pairwise((3, 32, 64, CODE)):
            layers += [nn.Conv1d(a, b, 1), nn.ReLU(inplace=True)]
        super().__init__(*layers, nn.AdaptiveMaxPool1d(1), nn.Flatten(), nn.Linear(CODE, CODE))


class Points2Pix(nn.Module):
    """The network from projected points, and the points themselves, to planes of images."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        widths = config.widths + config.widths[-1:] * 2  # seven levels: 128 pixels down to one
        self.code = PointNetCode()
        self.down = nn.ModuleList()
        wide = config.inputs.channels
        for level, width in enumerate(widths):
            edge = level in (0, len(widths) - 1)  # one pixel has no statistics
            self.down.append(
                nn.Sequential(
                    *([nn.LeakyReLU(_SLOPE)] if level else []),
                    nn.Conv2d(wide, width, 4, 2, 1, bias=edge),
                    *([] if edge else [nn.BatchNorm2d(width)]),
                )
            )
            wide = width
        self.up = nn.ModuleList()
        wide += CODE
        for level, width in enumerate(reversed(widths[:-1])):
            self.up.append(
                nn.Sequential(
                    nn.ReLU(),
                    nn.ConvTranspose2d(wide, width, 4, 2, 1, bias=False),
                    nn.BatchNorm2d(width),
                    *([nn.Dropout(_DROPPED)] if level < 2 else []),
                )
            )
            wide = 2 * width
        self.last = nn.Conv2d(wide, config.outputs, 3, padding=1)

    def forward(self, channels: Tensor, points: Tensor) -> Tensor:
        """Return alpha and the heads' planes [P, outputs, 128, 128], before the sigmoid.

        channels  [P, C, 128, 128] of `project`
        points    [P, 3, N], in the camera's frame
        """
        x, passed = channels, []
        for level in self.down:
            x = level(x)
            passed.append(x)
        middle = points + points.new_tensor([0.0, 0.0, CAMERA_DISTANCE])[:, None]
        x = torch.cat([passed.pop(), self.code(middle)[:, :, None, None]], dim=1)
        for level in self.up:
            x = torch.cat([level(x), passed.pop()], dim=1)
        x = functional.interpolate(torch.relu(x), scale_factor=2.0, mode="nearest")
        return self.last(x)


class Points2PixEngine:
    """The inference engine, called as a `FoldedSplatNet`."""

    dtype = torch.float32

    def __init__(self, network: Points2Pix) -> None:
        self.network = network

    def __call__(self, channels: Tensor, points: Tensor) -> Tensor:
        """Return images float32 [P, 128, 128, 3] in 0..1 by the first head."""
        output = self.network(channels, points)
        _, (image, *_) = composite(output, self.network.config.heads)
        return image.expand(-1, 3, -1, -1).permute(0, 2, 3, 1)

    def coverage(self, channels: Tensor, points: Tensor) -> Tensor:
        """Return the share of each pixel that is covered, float32 [P, 128, 128, 1]."""
        alpha, _ = composite(self.network(channels, points), self.network.config.heads)
        return alpha.permute(0, 2, 3, 1)


Network = SplatNet | Points2Pix


def build(config: NetworkConfig) -> Network:
    """Return the network of a configuration, with random weights."""
    return Points2Pix(config) if config.body == "points2pix" else SplatNet(config)
