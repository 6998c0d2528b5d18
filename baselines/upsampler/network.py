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
# Numbers that the features of a point are computed from at first: its noise, how far smoothing
# moved it, and how little smoothing turned its normal.
_NODE = 3
_PAIR = 8  # numbers that describe a pair of two points, or of a place and a point
_RAW = 1  # a further number of a pair of points, about the second one before smoothing
_PLACES_TOGETHER = 2**10  # places computed at a time: their features fit into a processor's cache
_NOISE_UNIT = 3.0  # spacings that noise is divided by: a noise of 10 % with 2,048 points
# In a round the absolute multiples of all neighbours of a point add up to at most this. Without a
# bound a training diverged, and with half of this bound it learned more slowly.
_REACH = 8.0
# Squared spacings. A product of heights, whose root tells how much a surface bends, is hardly
# distinguished from 0 below this.
_BENT = 0.04
_TINY = 1e-8  # squared spacings, added before a root is taken, whose slope at 0 is infinite


@dataclass(frozen=True)
class UpsamplerConfig:
    """The sizes of a network.

    width   number of features of a point
    rounds  number of rounds in which points take up features of their neighbours
    """

    width: int = 48
    rounds: int = 5


DEFAULT = UpsamplerConfig()


@dataclass(frozen=True, eq=False)
class Surroundings:
    """N points and what the network sees around each.

    points      float32 [N, 3], smoothed where the cloud is noisy
    normals     float32 [N, 3], of the planes of their nearest neighbours, of either sign
    raw         float32 [N, 3], the points before smoothing
    raw_normals float32 [N, 3], the normals before smoothing
    radius      float32 [N], > 0: the spacing around each point, in which lengths are measured
    noise       float32 [N], >= 0: standard deviation of the noise, in these spacings
    neighbours  int64 [N, K], K >= ASKED - 1: indices of neighbours whose ranks by distance are
                `surroundings.RANKS`; the point itself is not among them
    """

    points: Tensor
    normals: Tensor
    raw: Tensor
    raw_normals: Tensor
    radius: Tensor
    noise: Tensor
    neighbours: Tensor

    def to(self, device: torch.device) -> Surroundings:
        """Return a copy with all tensors on a device."""
        return Surroundings(**{name: value.to(device) for name, value in vars(self).items()})


class Encoded(NamedTuple):
    """A cloud after all rounds.

    features  [N, C], of its points
    planes    [N, 6], of its points: a place on the plane, and the unit normal
    seen      what the network was shown
    """

    features: Tensor
    planes: Tensor
    seen: Surroundings


class _Pairs(NamedTuple):
    """Pairs of each of Q planes with K others. Lengths are in spacings at the first plane.

    A plane is given by a place on it and a normal.

    offset   [Q, K, 3], from the place of the first plane to those of the others
    normals  [Q, K, 3], of the others
    height   [Q, K], of the others' places above the first plane
    back     [Q, K], of the first one's place above the others' planes
    cosine   [Q, K], of the angle between the normals
    """

    offset: Tensor
    normals: Tensor
    height: Tensor
    back: Tensor
    cosine: Tensor


class _Round(nn.Module):
    """A round in which each point takes up features of its neighbours, and moves its plane."""

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
        """Return the features [N, C] and planes [N, 6] of points after this round.

        features, planes  those before the round
        seen              the surroundings of the points
        also              [N, K, 3], of each neighbour: the logarithm of its spacing over the
                          point's, how far smoothing moved it, and the noise of the point
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
        # Multiples are divided by 1 + the distance, so that far neighbours move a plane little.
        far = 1 + (_dot(pairs.offset, pairs.offset) + _dot(raw, raw) + _TINY).sqrt()
        most = _REACH / (far * near.shape[1])
        multiples = most[..., None] * self.multiples(message).float().tanh()
        onto, up, along, raw_up, raw_along, beside, slope = multiples.unbind(dim=2)
        move, tilt = self._way_back(features, planes, seen)
        # The place moves onto the planes of the neighbours, towards the neighbours, and towards
        # where they were before smoothing.
        move = move + _sum(onto * pairs.back, pairs.normals)
        move = move + _sum(along, pairs.offset) + _sum(raw_along, raw)
        # It also moves along its own normal, by multiples of the heights of the neighbours and of
        # those that they had before smoothing.
        heights = up * pairs.height + raw_up * raw_height
        move = move + heights.sum(dim=1, keepdim=True) * normals
        # The normal turns towards those of the neighbours, and by the slope of the surface that
        # their heights show.
        tilt = tilt + _sum(beside * pairs.cosine.sign(), pairs.normals)
        tilt = tilt + _sum(slope * pairs.height, pairs.offset)
        turned = functional.normalize(normals + tilt, dim=1)
        return features, torch.cat([place + move * seen.radius[:, None], turned], dim=1)

    def _way_back(
        self, features: Tensor, planes: Tensor, seen: Surroundings
    ) -> tuple[Tensor, Tensor]:
        """Return changes of places [N, 3] and normals [N, 3] towards those before smoothing.

        They are learned shares of the whole way back. Smoothing sometimes flattens a thin part as
        if it were noise, and this lets the network undo it.
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
        """Return places [Q, 3] moved onto the surface, and unit normals there, of either sign.

        seen     the surroundings of the points
        places   [Q, 3]
        nearest  [Q], the index of the point nearest to each place
        """
        return self.project(self.encode(seen), places, nearest)

    def encode(self, seen: Surroundings) -> Encoded:
        """Return features and planes of the points after all rounds."""
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
        """Return what `forward` returns, for points that `encode` has returned."""
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
        near, alike, *others = self.answer(inner).float().unbind(dim=2)
        squares = _dot(pairs.offset, pairs.offset)
        onto, along, up, beside, slope = (multiples / ASKED for multiples in others)
        # `back` is the height of the place above a plane. To move onto it, the place goes as far
        # against the plane's normal.
        move = _sum((onto - (near - squares).softmax(dim=1)) * pairs.back, pairs.normals)
        move = move + _sum(along, pairs.offset)
        move = move + (up * pairs.height).sum(dim=1, keepdim=True) * nearest_normal
        share = ((alike - squares).softmax(dim=1) + beside) * pairs.cosine.sign()
        normal = _sum(share, pairs.normals) + _sum(slope * pairs.height, pairs.offset)
        return places + move * radius[:, None], functional.normalize(normal.float(), dim=1)


def _zeros(width: int, numbers: int) -> nn.Linear:
    """Return a layer whose outputs, `numbers` of them, are 0 before it is trained."""
    layer = nn.Linear(width, numbers)
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer


def _pairs(place: Tensor, normal: Tensor, others: Tensor, radius: Tensor) -> _Pairs:
    """Return pairs of planes, by their places [Q, 3] and normals [Q, 3], with others [Q, K, 6].

    radius  [Q], > 0, the spacing at each of the first planes
    """
    offset = (others[..., :3] - place[:, None]) / radius[:, None, None]
    normals, here = others[..., 3:], normal[:, None]
    return _Pairs(offset, normals, _dot(offset, here), -_dot(offset, normals), _dot(normals, here))


def _invariants(pairs: _Pairs, also: Tensor) -> Tensor:
    """Return numbers that describe pairs, [Q, K, 8], and that no rotation and no sign changes.

    They are the distance, both heights, the cosine, how much the surface bends between the two, and
    three given ones, `also` [Q, K, 3]. The bend is computed from the product of both heights, whose
    sign distinguishes a bend from a step. The sign of a normal changes none of these numbers.
    """
    bend = pairs.cosine * pairs.height * pairs.back
    distance = (_dot(pairs.offset, pairs.offset) + _TINY).sqrt()
    numbers = [distance, pairs.height.abs(), pairs.back.abs(), pairs.cosine.abs()]
    numbers.append(bend / (bend.abs() + _BENT).sqrt())
    return torch.cat([torch.stack(numbers, dim=2), also], dim=2)


def _of(rows: Tensor, index: Tensor) -> Tensor:
    """Return rows of a tensor [M, ...] by an index of any shape.

    Its gradient takes less time than that of `rows[index]`.
    """
    return rows.index_select(0, index.flatten()).unflatten(0, index.shape)


def _dot(first: Tensor, second: Tensor) -> Tensor:
    """Return the dot products of vectors [..., 3]; a sum over an axis of three would be slower."""
    a, b, c = (first * second).unbind(dim=-1)
    return a + b + c


def _sum(multiples: Tensor, vectors: Tensor) -> Tensor:
    """Return the sums [Q, 3] over K of multiples [Q, K] of vectors [Q, K, 3]."""
    return (multiples[:, None] @ vectors)[:, 0]
