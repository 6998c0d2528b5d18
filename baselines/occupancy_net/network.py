"""The network of occupancy-net: it tells how likely a place lies inside the object of a cloud.

Features of points are projected onto three planes, a U-Net goes over the planes, and a perceptron
answers for each place by the features of the planes there. These are the convolutional occupancy
networks of Peng et al. 2020 (arXiv 2003.04618) with three planes, changed in four ways. Places are
given with sines and cosines whose wavelengths are one cell and half a cell. The features of the
points in a cell are averaged. The U-Net adds features of the way down to those of the way up, and
learns a bias for each plane. Its coarsest level also gets a code of the whole cloud.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

# Half the side of the box, about the origin, that the planes cover: the paper's 10 % more than the
# unit sphere. Points outside are put into the outermost cells.
HALF_EXTENT = 1.1
AXES = ((0, 1), (2, 1), (0, 2))  # columns and rows of the planes: seen from front, side and above
_FREQUENCIES = (1, 2)  # periods, for each cell, of the sines and cosines of a place
_NODES_TOGETHER = 2**11  # nodes computed at a time: their features fit into a processor's cache


@dataclass(frozen=True)
class OccupancyConfig:
    """The sizes of a network.

    resolution  cells along a side of each plane, a multiple of 2 ** (len(widths) - 1)
    widths      channels of the U-Net at each level, from the finest, which is that of the planes
    rounds      how often the features of a point are computed anew from the means of its cells
    hidden      channels of the perceptron for a place
    blocks      number of its residual blocks
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
    """The cells of the three planes that the points of B clouds lie in.

    points      [B, N, 3]
    resolution  cells along a side of a plane, R

    index   [3, B * N]: for each plane, the cells of the points, as numbers of all B * 3 * R * R
    total   the number of all cells
    counts  [total]: the points of each cell
    """

    def __init__(self, points: Tensor, resolution: int) -> None:
        batch, count, _ = points.shape
        place = (points / HALF_EXTENT + 1) * (resolution / 2)
        cell = place.clamp(0, resolution - 1).long()
        first_plane = torch.arange(batch, device=points.device)[:, None] * len(AXES)
        index = []
        for plane, (u, v) in enumerate(AXES):
            row = (first_plane + plane) * resolution + cell[..., v]
            index.append((row * resolution + cell[..., u]).flatten())
        self.index = torch.stack(index)
        self.total = batch * len(AXES) * resolution**2
        ones = torch.ones(batch * count, device=points.device)
        self.counts = torch.zeros(self.total, device=points.device)
        for index in self.index:
            self.counts.index_add_(0, index, ones)

    def means(self, features: Tensor) -> Tensor:
        """Return the mean [total, C] over each cell of features [B * N, C] of points.

        It is 0 in a cell without points.
        """
        sums = features.new_zeros(self.total, features.shape[1])
        for index in self.index:
            sums = sums.index_add(0, index, features)
        return sums / self.counts.clamp(min=1)[:, None].to(features.dtype)

    def around(self, features: Tensor) -> Tensor:
        """Return for each point the sum of the means of its cells on the three planes, [B * N, C].

        features  [B * N, C] of the points
        """
        means = self.means(features)
        first, second, third = (means.index_select(0, index) for index in self.index)
        return first + second + third


class _PlaneNetwork(nn.Module):
    """A U-Net over planes [B * 3, C, R, R]; features of the way down are added on the way up."""

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
    """A network that tells how likely a place lies inside the object of a cloud."""

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
        """Return logits [B, Q] of being inside, for places [B, Q, 3] and clouds [B, N, 3]."""
        return self.occupancy(self.encode(points), places)

    def encode(self, points: Tensor) -> Tensor:
        """Return planes of features [B * 3, C, R, R] of clouds [B, N, 3]."""
        resolution = self.config.resolution
        cells = Cells(points, resolution)
        x = self.start(self.enter(self.waves(points).flatten(0, 1)))
        for block in self.rounds:
            x = block(torch.cat([x, cells.around(x)], dim=1))
        means = cells.means(x) + cells.counts.log1p()[:, None] * self.crowd
        return self.planes(means.view(-1, resolution, resolution, x.shape[1]).permute(0, 3, 1, 2))

    def occupancy(self, planes: Tensor, places: Tensor) -> Tensor:
        """Return logits [B, Q] of being inside, for places [B, Q, 3] and planes of `encode`."""
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
        """Return the occupancy on nodes of grids, for planes of `encode` of one cloud."""
        return GridOccupancy(self, planes)

    def waves(self, places: Tensor) -> Tensor:
        """Return coordinates [..., n] followed by their sines and cosines, [..., 5 n]."""
        turn = places * (math.pi * self.config.resolution / HALF_EXTENT)
        parts = [places]
        for frequency in _FREQUENCIES:
            parts += [torch.sin(turn * frequency), torch.cos(turn * frequency)]
        return torch.cat(parts, dim=-1)


class GridOccupancy:
    """The network on the nodes of cubic grids over the box, in half the time of `occupancy`.

    The features that enter the perceptron are a sum of three parts, one for each plane, and nodes
    in a line across a plane share its part. So the first layers are computed once for each plane of
    a grid and kept in a table. For a node, three rows of the table are added, and the blocks of the
    perceptron follow.

    planes  [3, C, R, R] of `OccupancyNet.encode`, of one cloud
    """

    def __init__(self, network: OccupancyNet, planes: Tensor) -> None:
        self.network = network
        weight = network.at_planes.weight.unflatten(1, (len(AXES), -1))
        self.planes = torch.einsum("pcvu,hpc->pvuh", planes.to(weight), weight).contiguous()

    def __call__(self, nodes: Tensor, cells: int) -> Tensor:
        """Return logits [M] of nodes, on the CPU.

        nodes  int64 [3, M]: their numbers along x, y and z, 0..cells
        cells  of the grid, along a side
        """
        table = self._table(cells)
        side = cells + 1
        rows = [(plane * side + nodes[v]) * side + nodes[u] for plane, (u, v) in enumerate(AXES)]
        parts = torch.stack(rows, dim=1).split(_NODES_TOGETHER)
        return torch.cat([self._answer(table, part.to(table.device)) for part in parts]).cpu()

    def _table(self, cells: int) -> Tensor:
        """Return what each plane adds to the features of a node, [3 * K * K, hidden].

        K is the number of nodes along a side, cells + 1.
        """
        resolution = self.planes.shape[1]
        node = torch.arange(cells + 1).to(self.planes)
        place = (node * (resolution / cells) - 0.5).clamp(0, resolution - 1)
        low = place.long().clamp(max=resolution - 2)
        share = (place - low)[:, None, None]
        table = self.planes.new_empty(len(AXES), cells + 1, cells + 1, self.planes.shape[3])
        # Bilinear interpolation between the cells of a plane: down, then across. The planes are
        # taken one by one, so that each fits into a processor's cache.
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
        """Return logits [M] of nodes whose features are sums of three rows of the table, [M, 3]."""
        x = functional.embedding_bag(rows, table, mode="sum")
        for block in self.network.blocks:
            assert isinstance(block, _ResidualLayers)
            inner = block.first(x.relu()).relu_()
            x = x.add_(block.second.bias).addmm_(inner, block.second.weight.T)
        return self.network.answer(x.relu_())[:, 0]
