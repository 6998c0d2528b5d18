"""The network: features of points on three planes, a U-Net over them, a perceptron for each place.

After the convolutional occupancy networks of Peng et al. 2020 (arXiv 2003.04618) with three planes.
Ours differ in four ways: places are given with sines and cosines at the width of a cell, points of
a cell are averaged, the U-Net adds its skips and knows which plane it sees, and its coarsest level
has a code of the whole cloud.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

HALF_EXTENT = (
    1.1  # of the box that the planes cover, as in the paper; points beyond are at its edge
)
AXES = ((0, 1), (2, 1), (0, 2))  # of the planes: from the front, from the side, from above
_FREQUENCIES = (1, 2)  # periods of the sines in a cell
_NODES_TOGETHER = 2**11  # their features stay in a processor's cache


@dataclass(frozen=True)
class OccupancyConfig:
    """The sizes of a network.

    resolution  cells along a side of each plane, a multiple of 2 ** (len(widths) - 1)
    widths      channels of the U-Net, from the finest level; the first is that of the planes
    rounds      times that points see the mean of their cells
    hidden      channels of the perceptron
    blocks      its residual blocks
    """

    resolution: int = 64
    widths: tuple[int, ...] = (32, 64, 128, 192)
    rounds: int = 2
    hidden: int = 64
    blocks: int = 4


DEFAULT = OccupancyConfig()


class _ResidualLayers(nn.Module):
    """Two layers of a perceptron, with a skip past them."""

    def __init__(self, width_in: int, width: int) -> None:
        super().__init__()
        self.first = nn.Linear(width_in, width)
        self.second = nn.Linear(width, width)
        self.skip = nn.Identity() if width_in == width else nn.Linear(width_in, width, bias=False)
        nn.init.zeros_(self.second.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Return features [..., width] of [..., width_in]."""
        return self.skip(x) + self.second(self.first(x.relu()).relu())


class Cells:
    """The cells of the planes that points lie in.

    points [B, N, 3]; index [3, B * N] into the cells of all planes, B * 3 * R * R.
    """

    def __init__(self, points: Tensor, resolution: int) -> None:
        batch, count, _ = points.shape
        place = (points / HALF_EXTENT + 1) * (resolution / 2)
        cell = place.clamp(0, resolution - 1).long()
        start = torch.arange(batch, device=points.device)[:, None] * len(AXES)
        self.index = torch.stack(
            [
                (
                    ((start + plane) * resolution + cell[..., v]) * resolution + cell[..., u]
                ).flatten()
                for plane, (u, v) in enumerate(AXES)
            ]
        )
        self.total = batch * len(AXES) * resolution**2
        ones = torch.ones(batch * count, device=points.device)
        self.counts = torch.zeros(self.total, device=points.device)
        for index in self.index:
            self.counts.index_add_(0, index, ones)

    def means(self, features: Tensor) -> Tensor:
        """Return the mean features [cells, C] of the points [B * N, C] of each cell; 0 of none."""
        sums = features.new_zeros(self.total, features.shape[1])
        for index in self.index:
            sums = sums.index_add(0, index, features)
        return sums / self.counts.clamp(min=1)[:, None].to(features.dtype)

    def around(self, features: Tensor) -> Tensor:
        """Return the sum over the planes of the means that each point lies in, [B * N, C]."""
        means = self.means(features)
        first, second, third = (means.index_select(0, index) for index in self.index)
        return first + second + third


class _PlaneNetwork(nn.Module):
    """A U-Net over planes [B * 3, C, R, R], whose skips are added."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()

        def layer(width_in: int, width: int, stride: int = 1) -> nn.Module:
            return nn.Sequential(nn.Conv2d(width_in, width, 3, stride, 1), nn.ReLU(inplace=True))

        self.plane = nn.Parameter(torch.zeros(len(AXES), widths[0], 1, 1))
        self.first = nn.Conv2d(widths[0], widths[0], 3, padding=1)
        self.finest = layer(widths[0], widths[0])
        pairs = list(itertools.pairwise(widths))
        self.down = nn.ModuleList(nn.Sequential(layer(a, b, 2), layer(b, b)) for a, b in pairs)
        self.code = nn.Linear(widths[-1], widths[-1])
        self.up = nn.ModuleList(nn.ConvTranspose2d(b, a, 2, 2) for a, b in reversed(pairs))
        self.smooth = nn.ModuleList(layer(a, a) for a, _ in reversed(pairs))
        self.last = nn.Conv2d(widths[0], widths[0], 1)

    def forward(self, planes: Tensor) -> Tensor:
        """Return planes [B * 3, widths[0], R, R]."""
        batch = len(planes) // len(AXES)
        x = self.finest((self.first(planes) + self.plane.repeat(batch, 1, 1, 1)).relu())
        skips = []
        for down in self.down:
            skips.append(x)
            x = down(x)
        code = x.unflatten(0, (batch, len(AXES))).mean(dim=(1, 3, 4))
        x = x + self.code(code).repeat_interleave(len(AXES), dim=0)[:, :, None, None]
        for up, smooth in zip(self.up, self.smooth, strict=True):
            x = smooth(up(x) + skips.pop())
        return self.last(x)


class OccupancyNet(nn.Module):
    """A network that tells how likely places lie inside the object of a cloud."""

    def __init__(self, config: OccupancyConfig = DEFAULT) -> None:
        super().__init__()
        self.config = config
        channels, place = config.widths[0], 3 + 6 * len(_FREQUENCIES)
        self.enter = nn.Linear(place, 2 * channels)
        self.start = _ResidualLayers(2 * channels, channels)
        self.rounds = nn.ModuleList(
            _ResidualLayers(2 * channels, channels) for _ in range(config.rounds)
        )
        self.crowd = nn.Parameter(torch.zeros(channels))
        self.planes = _PlaneNetwork(config.widths)
        self.at_place = nn.Linear(place, config.hidden)
        self.at_planes = nn.Linear(len(AXES) * channels, config.hidden)
        self.blocks = nn.Sequential(
            *(_ResidualLayers(config.hidden, config.hidden) for _ in range(config.blocks))
        )
        self.answer = nn.Linear(config.hidden, 1)

    def forward(self, points: Tensor, places: Tensor) -> Tensor:
        """Return logits [B, Q] of places [B, Q, 3] in the clouds of points [B, N, 3]."""
        return self.occupancy(self.encode(points), places)

    def encode(self, points: Tensor) -> Tensor:
        """Return the planes [B * 3, C, R, R] of clouds [B, N, 3]."""
        resolution = self.config.resolution
        cells = Cells(points, resolution)
        x = self.start(self.enter(self.waves(points).flatten(0, 1)))
        for block in self.rounds:
            x = block(torch.cat([x, cells.around(x)], dim=1))
        means = cells.means(x) + cells.counts.log1p()[:, None] * self.crowd
        return self.planes(means.view(-1, resolution, resolution, x.shape[1]).permute(0, 3, 1, 2))

    def occupancy(self, planes: Tensor, places: Tensor) -> Tensor:
        """Return logits [B, Q] of places [B, Q, 3], from the planes of `encode`."""
        at = torch.stack([places[..., list(axes)] for axes in AXES], dim=1) / HALF_EXTENT
        features = functional.grid_sample(
            planes.to(places.dtype),
            at.flatten(0, 1)[:, None],
            padding_mode="border",
            align_corners=False,
        )  # [B * 3, C, 1, Q]
        features = features[:, :, 0].unflatten(0, (-1, len(AXES))).flatten(1, 2).transpose(1, 2)
        x = self.at_place(self.waves(places)) + self.at_planes(features)
        return self.answer(self.blocks(x).relu())[..., 0]

    def on_grid(self, planes: Tensor) -> GridOccupancy:
        """Return the occupancy on nodes of grids, from the planes of `encode` of one cloud."""
        return GridOccupancy(self, planes)

    def waves(self, places: Tensor) -> Tensor:
        """Return places [..., n] with sines and cosines at the width of a cell, [..., 5 n]."""
        turn = places * (math.pi * self.config.resolution / HALF_EXTENT)
        waves = [f(turn * k) for k in _FREQUENCIES for f in (torch.sin, torch.cos)]
        return torch.cat([places, *waves], dim=-1)


class GridOccupancy:
    """The network on the nodes of cubic grids over the box: what it gives there, in half the time.

    A node's features are sums over planes and axes, and nodes share them: the first layers are
    applied once to the planes, and to each axis, of a grid. What is left for a node is to add three
    rows of a table, and the blocks of the perceptron.

    planes  [3, C, R, R] of `OccupancyNet.encode`, of one cloud
    """

    def __init__(self, network: OccupancyNet, planes: Tensor) -> None:
        self.network = network
        weight = network.at_planes.weight.unflatten(1, (len(AXES), -1))
        self.planes = torch.einsum("pcvu,hpc->pvuh", planes.to(weight), weight).contiguous()

    def __call__(self, nodes: Tensor, cells: int) -> Tensor:
        """Return logits [M] of nodes, int64 [3, M], on the CPU."""
        table = self._table(cells)
        side = cells + 1
        rows = [(p * side + nodes[v]) * side + nodes[u] for p, (u, v) in enumerate(AXES)]
        parts = torch.stack(rows, dim=1).split(_NODES_TOGETHER)
        return torch.cat([self._answer(table, part.to(table.device)) for part in parts]).cpu()

    def _table(self, cells: int) -> Tensor:
        """Return what each plane adds to the features of a node, [3 * K * K, hidden]."""
        resolution = self.planes.shape[1]
        node = torch.arange(cells + 1).to(self.planes)
        place = (node * (resolution / cells) - 0.5).clamp(0, resolution - 1)
        low = place.long().clamp(max=resolution - 2)
        share = (place - low)[:, None, None]
        table = self.planes.new_empty(len(AXES), cells + 1, cells + 1, self.planes.shape[3])
        # linear between the cells of a plane, down and across; one after the other, in the cache
        for plane, both in zip(self.planes, table, strict=True):
            down = plane.index_select(0, low).lerp_(plane.index_select(0, low + 1), share)
            torch.index_select(down, 1, low, out=both)
            both.lerp_(down.index_select(1, low + 1), share[:, 0])
        waves = self.network.waves((node * (2 / cells) - 1)[:, None] * HALF_EXTENT)
        weight = self.network.at_place.weight
        x, y, z = (waves @ weight[:, axis::3].T for axis in range(3))
        y += self.network.at_place.bias + self.network.at_planes.bias
        table[0] += x
        table[0] += y[:, None]
        table[1] += z
        return table.flatten(0, 2)

    def _answer(self, table: Tensor, rows: Tensor) -> Tensor:
        """Return logits [M] of nodes, of which the features are sums of three rows [M, 3]."""
        x = functional.embedding_bag(rows, table, mode="sum")
        for block in self.network.blocks:
            assert isinstance(block, _ResidualLayers)
            inner = block.first(x.relu()).relu_()
            x = x.add_(block.second.bias).addmm_(inner, block.second.weight.T)
        return self.network.answer(x.relu_())[:, 0]
