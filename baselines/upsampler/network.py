"""The network: it moves places near a cloud onto the surface, and tells the normals there.

Points exchange what they know with their neighbours in a few rounds (edge convolutions: Wang et
al., Dynamic graph CNN for learning on point clouds, ACM TOG 38(5), 2019). A place asks the points
around it, and weighs their answers by attention. Everything is measured in the frame of a point and
in units of the spacing there, so that neither where an object is, nor how it is turned, nor how
large it is, nor what it is, makes a difference.

The answer is a correction of a classical estimate: the planes of the points around the place,
averaged. Without training the correction is 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

ASKED = 8  # points around a place that answer: its nearest point, and the nearest to that one
_NODE = 2  # numbers that a point starts from: noise, and how far it was moved against it
_EDGE = 17  # numbers that relate a point to a neighbour
_PLACE = 13  # numbers that relate a place to a point
_PLACES_TOGETHER = 2**10  # what they take stays in a processor's cache
_NOISE_UNIT = 3.0  # spacings: noise of 10 % at 2,048 points


@dataclass(frozen=True)
class UpsamplerConfig:
    """The sizes of a network.

    width   features of a point
    rounds  times that points hear of their neighbours
    heads   of the attention of a place
    """

    width: int = 64
    rounds: int = 3
    heads: int = 4


DEFAULT = UpsamplerConfig()


@dataclass(frozen=True, eq=False)
class Surroundings:
    """N points and what the network sees around them.

    points      float32 [N, 3]: the cloud, smoothed where it is noisy
    moved       float32 [N, 3]: by how much smoothing has moved them
    frames      float32 [N, 3, 3]: rows are two tangents and the normal, of any sign
    radius      float32 [N], > 0: the spacing of the points there, the unit of length
    noise       float32 [N], >= 0: standard deviation of the noise, in that unit
    neighbours  int64 [N, K], K >= ASKED: indices of points, the nearest first, itself not among
                them
    """

    points: Tensor
    moved: Tensor
    frames: Tensor
    radius: Tensor
    noise: Tensor
    neighbours: Tensor


class _Round(nn.Module):
    """A round in which each point hears of its neighbours."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.here = nn.Linear(width, width)
        self.there = nn.Linear(width, width, bias=False)
        self.edge = nn.Linear(_EDGE, width, bias=False)
        self.message = nn.Linear(width, width)
        self.out = nn.Linear(width, width)

    def forward(self, features: Tensor, edges: Tensor, neighbours: Tensor) -> Tensor:
        """Return features [N, C] of features [N, C] and edges [N, K, E]."""
        normal = self.norm(features)
        heard = _of(self.there(normal), neighbours) + self.here(normal)[:, None]
        heard = (heard + self.edge(edges)).relu()
        return features + self.out(self.message(heard).amax(dim=1).relu())


class Upsampler(nn.Module):
    """A network that moves places near a cloud onto its surface."""

    def __init__(self, config: UpsamplerConfig = DEFAULT) -> None:
        super().__init__()
        self.config = config
        width = config.width
        self.enter = nn.Linear(_NODE, width)
        self.rounds = nn.ModuleList(_Round(width) for _ in range(config.rounds))
        self.norm = nn.LayerNorm(width)
        self.asked = nn.Linear(width, width)
        self.place = nn.Linear(_PLACE, width, bias=False)
        self.value = nn.Linear(width, width)
        self.weight = nn.Linear(width, config.heads)
        self.inner = nn.Linear(width, width)
        self.answer = nn.Linear(width, 6)
        nn.init.zeros_(self.answer.weight)
        nn.init.zeros_(self.answer.bias)

    def forward(self, seen: Surroundings, places: Tensor, nearest: Tensor) -> tuple[Tensor, Tensor]:
        """Return places [Q, 3] moved onto the surface, and unit normals [Q, 3] of any sign.

        `nearest` [Q] is the index of the nearest point of each.
        """
        return self.project(seen, self.encode(seen), places, nearest)

    def encode(self, seen: Surroundings) -> Tensor:
        """Return features [N, C] of the points."""
        edges = _edges(seen)
        moved = _dot(seen.frames[:, 2], seen.moved) / seen.radius
        features = self.enter(torch.stack([seen.noise / _NOISE_UNIT, moved], dim=1))
        for heard in self.rounds:
            features = heard(features, edges, seen.neighbours)
        return self.asked(self.norm(features))

    def project(
        self, seen: Surroundings, features: Tensor, places: Tensor, nearest: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return what `forward` does, from the features of `encode`."""
        parts = [
            self._project(seen, features, some, near)
            for some, near in zip(
                places.split(_PLACES_TOGETHER), nearest.split(_PLACES_TOGETHER), strict=True
            )
        ]
        moved, normals = zip(*parts, strict=True)
        return torch.cat(moved), torch.cat(normals)

    def _project(
        self, seen: Surroundings, features: Tensor, places: Tensor, nearest: Tensor
    ) -> tuple[Tensor, Tensor]:
        asked = torch.cat([nearest[:, None], seen.neighbours[nearest, : ASKED - 1]], dim=1)
        frame, radius = seen.frames[nearest], seen.radius[nearest]
        offset = places[:, None] - _of(seen.points, asked)
        normals = _of(seen.frames[:, 2], asked)
        relation = _relation(seen, frame, radius, offset, asked)
        inner = (_of(features, asked) + self.place(relation)).relu()
        weight = self.weight(inner).softmax(dim=1)  # [Q, A, heads]
        value = self.value(inner).unflatten(2, (self.config.heads, -1))
        heard = (value * weight[..., None]).sum(dim=1).flatten(1).relu()
        answer = self.answer(self.inner(heard).relu()).float()
        onto, normal = _planes(frame[:, 2], radius, offset, normals)
        move = onto + _turned_back(frame, answer[:, :3]) * radius[:, None]
        normal = normal + _turned_back(frame, answer[:, 3:])
        return places + move, nn.functional.normalize(normal, dim=1)


def _edges(seen: Surroundings) -> Tensor:
    """Return what relates each point to its neighbours, [N, K, E]."""
    near, radius = seen.neighbours, seen.radius
    offset = _of(seen.points, near) - seen.points[:, None]
    relation = _relation(seen, seen.frames, radius, offset, near)
    moved = _of(seen.moved, near) @ seen.frames.mT / radius[:, None, None]
    larger = (_of(radius, near) / radius[:, None]).log()[..., None]
    return torch.cat([relation, moved, larger], dim=2)


def _relation(
    seen: Surroundings, frames: Tensor, radius: Tensor, offset: Tensor, others: Tensor
) -> Tensor:
    """Return what relates places to points, or points to points, [Q, K, 13].

    This is the offset [Q, K, 3] in the frame of the place [Q, 3, 3], the normal and a tangent of
    the others [Q, K] in it, the offset in the frame of the other, and the distance.
    """
    offset = offset / radius[:, None, None]
    first, second, normal = (_of(axis, others) for axis in seen.frames.unbind(dim=1))
    here = [vectors @ frames.mT for vectors in (offset, normal, first)]
    there = [_dot(offset, axis) for axis in (first, second, normal)]
    distance = _dot(offset, offset).sqrt()
    return torch.cat([*here, torch.stack([*there, distance], dim=2)], dim=2)


def _of(rows: Tensor, index: Tensor) -> Tensor:
    """Return rows [M, ...] by an index of any shape; its gradient is cheaper than that of [...]."""
    return rows.index_select(0, index.flatten()).unflatten(0, index.shape)


def _dot(first: Tensor, second: Tensor) -> Tensor:
    """Return the products of vectors [..., 3]; faster than a sum over an axis of three."""
    a, b, c = (first * second).unbind(dim=-1)
    return a + b + c


def _planes(
    normal: Tensor, radius: Tensor, offset: Tensor, normals: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the way onto the average plane of points around, and its normal, [Q, 3] each."""
    squares = _dot(offset, offset) / radius[:, None].square()
    weight = (-squares).softmax(dim=1)
    height, same = _dot(offset, normals), _dot(normals, normal[:, None]).sign()
    shares = torch.stack([-weight * height, weight * same], dim=1)
    onto, average = (shares @ normals).unbind(dim=1)
    return onto, average


def _turned_back(frames: Tensor, vectors: Tensor) -> Tensor:
    """Return vectors [..., 3], which are in frames [..., 3, 3], as they are outside of them."""
    return (frames * vectors[..., None]).sum(dim=-2)
