"""The network: it moves places near a cloud onto the surface, and tells the normals there.

Each point has a plane, and hears of those around it in a few rounds. In a round a small perceptron
looks at each pair of neighbours, by numbers that no turn and no sign of a normal changes, and says
how much the one moves and tilts the plane of the other (edge convolutions: Wang et al., Dynamic
graph CNN for learning on point clouds, ACM TOG 38(5), 2019; vectors moved by learned multiples of
offsets: Satorras et al., E(n) equivariant graph neural networks, ICML 2021). A place is then moved
onto the planes of the points around it, each by a learned share: at a crease those of its own side.

So where an object is, how it is turned, how large it is and what it is makes no difference. Before
training all learned multiples are 0, and what is left is a classical estimate: the average of the
planes around a place, by distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

# Points that a place is moved by: its nearest point, and the first eleven in that point's
# `neighbours`, which are its 1st to 8th, 11th, 15th and 20th nearest (`surroundings.RANKS`).
ASKED = 12
_NODE = 3  # numbers that a point starts from: noise, how far it was moved, how little it was turned
_PAIR = 8  # numbers that relate two points, or a place and a point
_RAW = 1  # and one about a point as it was before it was smoothed
_PLACES_TOGETHER = 2**10  # what they take stays in a processor's cache
_NOISE_UNIT = 3.0  # spacings: noise of 10 % at 2,048 points
# In a round the absolute multiples of all neighbours of a point add up to at most so much. Without
# a bound a training diverged; with half of it it learned more slowly.
_REACH = 8.0
_BENT = 0.04  # squared spacings: products of heights below this are hardly told apart
_TINY = 1e-8  # squared spacings: a distance has a gradient at 0, too


@dataclass(frozen=True)
class UpsamplerConfig:
    """The sizes of a network.

    width   features of a point
    rounds  times that points hear of their neighbours
    """

    width: int = 48
    rounds: int = 5


DEFAULT = UpsamplerConfig()


@dataclass(frozen=True, eq=False)
class Surroundings:
    """N points and what the network sees around them.

    points      float32 [N, 3]: the cloud, smoothed where it is noisy
    normals     float32 [N, 3]: of the planes of their nearest neighbours, of any sign
    raw         float32 [N, 3]: the points before they were smoothed
    raw_normals float32 [N, 3]: of the planes of their nearest neighbours before that
    radius      float32 [N], > 0: the spacing of the points there, the unit of length
    noise       float32 [N], >= 0: standard deviation of the noise, in that unit
    neighbours  int64 [N, K], K >= ASKED - 1: indices of neighbours, by distance, as many and of the
                ranks that `surroundings.RANKS` says; the point itself is not among them
    """

    points: Tensor
    normals: Tensor
    raw: Tensor
    raw_normals: Tensor
    radius: Tensor
    noise: Tensor
    neighbours: Tensor

    def to(self, device: torch.device) -> Surroundings:
        """Return the same on a device."""
        return Surroundings(**{name: value.to(device) for name, value in vars(self).items()})


class Encoded(NamedTuple):
    """The points after all rounds: features [N, C], and their planes, by point and normal [N, 6].

    seen  what the network was shown
    """

    features: Tensor
    planes: Tensor
    seen: Surroundings


class _Pairs(NamedTuple):
    """Pairs of a plane and K others [Q, K], in units of the spacing at the one.

    offset   [Q, K, 3]: from the one to the others
    normals  [Q, K, 3]: of the others
    height   [Q, K]: of the others above the plane of the one
    back     [Q, K]: of the one above the planes of the others
    cosine   [Q, K]: between the normals
    """

    offset: Tensor
    normals: Tensor
    height: Tensor
    back: Tensor
    cosine: Tensor


class _Round(nn.Module):
    """A round in which each point hears of its neighbours."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.here = nn.Linear(width, width)
        self.there = nn.Linear(width, width, bias=False)
        self.pair = nn.Linear(_PAIR + _RAW, width, bias=False)
        self.message = nn.Linear(width, width)
        self.out = nn.Linear(width, width)
        self.multiples = _zeros(width, 7)
        self.back = _zeros(width, 2)

    def forward(
        self, features: Tensor, planes: Tensor, seen: Surroundings, also: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return features [N, C] and planes [N, 6] after this round, from those before it.

        `also` [N, K, 3]: the log ratio of the neighbour's spacing to the point's own, how far
        smoothing moved the neighbour, and the noise at the point.
        """
        place, normals, near = planes[:, :3], planes[:, 3:], seen.neighbours
        pairs = _pairs(place, normals, _of(planes, near), seen.radius)
        raw = (_of(seen.raw, near) - place[:, None]) / seen.radius[:, None, None]
        raw_height = _dot(raw, normals[:, None])
        known = torch.cat([_invariants(pairs, also), raw_height.abs()[..., None]], dim=2)
        normed = self.norm(features)
        heard = _of(self.there(normed), near) + self.here(normed)[:, None] + self.pair(known)
        message = self.message(heard.relu()).relu()
        features = features + self.out(message.amax(dim=1))
        # A neighbour's multiple is divided by 1 + its distance: one far away moves a plane little.
        far = 1 + (_dot(pairs.offset, pairs.offset) + _dot(raw, raw) + _TINY).sqrt()
        most = _REACH / (far * near.shape[1])
        multiples = most[..., None] * self.multiples(message).float().tanh()
        onto, up, along, raw_up, raw_along, beside, slope = multiples.unbind(dim=2)
        move, tilt = self._way_back(features, planes, seen)
        # Onto the planes of the others, towards them, and towards where they were before smoothing.
        move = move + _sum(onto * pairs.back, pairs.normals)
        move = move + _sum(along, pairs.offset) + _sum(raw_along, raw)
        # Along the own normal, as high as the others are and were.
        heights = up * pairs.height + raw_up * raw_height
        move = move + heights.sum(dim=1, keepdim=True) * normals
        # The normal turns towards those of the others, and with the slope that they stand on.
        tilt = tilt + _sum(beside * pairs.cosine.sign(), pairs.normals)
        tilt = tilt + _sum(slope * pairs.height, pairs.offset)
        turned = functional.normalize(normals + tilt, dim=1)
        return features, torch.cat([place + move * seen.radius[:, None], turned], dim=1)

    def _way_back(
        self, features: Tensor, planes: Tensor, seen: Surroundings
    ) -> tuple[Tensor, Tensor]:
        """Return moves and tilts [N, 3]: learned shares of the way back to the raw points.

        Smoothing sometimes flattens a thin part as if it were noise; this lets the network undo it.
        """
        place_back, normal_back = self.back(features).float().tanh().split(1, dim=1)
        way = (seen.raw - planes[:, :3]) / seen.radius[:, None]
        same = _dot(planes[:, 3:], seen.raw_normals).sign()[:, None]
        return place_back * way, normal_back * same * seen.raw_normals


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
        self.place = nn.Linear(_PAIR, width, bias=False)
        self.inner = nn.Linear(width, width)
        self.others = nn.Linear(width, width)
        self.answer = _zeros(width, 7)

    def forward(self, seen: Surroundings, places: Tensor, nearest: Tensor) -> tuple[Tensor, Tensor]:
        """Return places [Q, 3] moved onto the surface, and unit normals [Q, 3] of any sign.

        `nearest` [Q] is the index of the nearest point of each.
        """
        return self.project(self.encode(seen), places, nearest)

    def encode(self, seen: Surroundings) -> Encoded:
        """Return the points after all rounds."""
        moved = (seen.points - seen.raw).norm(dim=1) / seen.radius
        alike = _dot(seen.normals, seen.raw_normals).abs()
        noise = seen.noise / _NOISE_UNIT
        near = seen.neighbours
        larger = (_of(seen.radius, near) / seen.radius[:, None]).log()
        also = torch.stack([larger, _of(moved, near), noise[:, None].expand_as(larger)], dim=2)
        features = self.enter(torch.stack([noise, moved, alike], dim=1))
        planes = torch.cat([seen.points, seen.normals], dim=1)
        for heard in self.rounds:
            features, planes = heard(features, planes, seen, also)
        return Encoded(self.asked(self.norm(features)), planes, seen)

    def project(self, cloud: Encoded, places: Tensor, nearest: Tensor) -> tuple[Tensor, Tensor]:
        """Return what `forward` does, of points that `encode` has returned."""
        together = zip(places.split(_PLACES_TOGETHER), nearest.split(_PLACES_TOGETHER), strict=True)
        parts = [self._project(cloud, some, near) for some, near in together]
        moved, normals = zip(*parts, strict=True)
        return torch.cat(moved), torch.cat(normals)

    def _project(self, cloud: Encoded, places: Tensor, nearest: Tensor) -> tuple[Tensor, Tensor]:
        seen = cloud.seen
        asked = torch.cat([nearest[:, None], seen.neighbours[nearest, : ASKED - 1]], dim=1)
        radius, planes = seen.radius[nearest], _of(cloud.planes, asked)
        nearest_normal = planes[:, 0, 3:]
        pairs = _pairs(places, nearest_normal, planes, radius)
        larger = (_of(seen.radius, asked) / radius[:, None]).log()
        above = _dot(pairs.offset - pairs.offset[:, :1], nearest_normal[:, None]).abs()
        noise = (seen.noise[nearest] / _NOISE_UNIT)[:, None].expand_as(larger)
        known = _invariants(pairs, torch.stack([larger, above, noise], dim=2))
        inner = self.inner((_of(cloud.features, asked) + self.place(known)).relu())
        inner = (inner + self.others(inner.amax(dim=1).relu())[:, None]).relu()
        near, alike, onto, along, up, beside, slope = self.answer(inner).float().unbind(dim=2)
        squares = _dot(pairs.offset, pairs.offset)
        onto, along, up, beside, slope = (a / ASKED for a in (onto, along, up, beside, slope))
        # A height above a plane is `back`; to move onto it is to go so far against its normal.
        move = _sum((onto - (near - squares).softmax(dim=1)) * pairs.back, pairs.normals)
        move = move + _sum(along, pairs.offset)
        move = move + (up * pairs.height).sum(dim=1, keepdim=True) * nearest_normal
        share = ((alike - squares).softmax(dim=1) + beside) * pairs.cosine.sign()
        normal = _sum(share, pairs.normals) + _sum(slope * pairs.height, pairs.offset)
        return places + move * radius[:, None], functional.normalize(normal.float(), dim=1)


def _zeros(width: int, numbers: int) -> nn.Linear:
    """Return a layer that gives 0 before it is trained."""
    layer = nn.Linear(width, numbers)
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer


def _pairs(place: Tensor, normal: Tensor, others: Tensor, radius: Tensor) -> _Pairs:
    """Return the pairs of places [Q, 3] and normals [Q, 3] with planes [Q, K, 6]."""
    offset = (others[..., :3] - place[:, None]) / radius[:, None, None]
    normals, here = others[..., 3:], normal[:, None]
    return _Pairs(offset, normals, _dot(offset, here), -_dot(offset, normals), _dot(normals, here))


def _invariants(pairs: _Pairs, also: Tensor) -> Tensor:
    """Return numbers about pairs [Q, K, 8] that no turn and no sign of a normal changes.

    They are distance, both heights, cosine, three that are given, and how much the surface bends
    between the two: the product of their heights, of which the sign tells a bend from a step.
    """
    bend = pairs.cosine * pairs.height * pairs.back
    distance = (_dot(pairs.offset, pairs.offset) + _TINY).sqrt()
    numbers = [distance, pairs.height.abs(), pairs.back.abs(), pairs.cosine.abs()]
    numbers.append(bend / (bend.abs() + _BENT).sqrt())
    return torch.cat([torch.stack(numbers, dim=2), also], dim=2)


def _of(rows: Tensor, index: Tensor) -> Tensor:
    """Return rows [M, ...] by an index of any shape; its gradient is cheaper than that of [...]."""
    return rows.index_select(0, index.flatten()).unflatten(0, index.shape)


def _dot(first: Tensor, second: Tensor) -> Tensor:
    """Return the products of vectors [..., 3]; faster than a sum over an axis of three."""
    a, b, c = (first * second).unbind(dim=-1)
    return a + b + c


def _sum(multiples: Tensor, vectors: Tensor) -> Tensor:
    """Return the sums [Q, 3] of multiples [Q, K] of vectors [Q, K, 3]."""
    return (multiples[:, None] @ vectors)[:, 0]
