"""Degradation of the clouds that networks are trained on: fewer points, and noise.

Random numbers are drawn from a given `torch.Generator` on the CPU. Its state is in checkpoints, so
that a resumed training continues exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

POINTS_SEEN = (2048, 2048, 1024, 512, 512)  # numbers of points, one of which a step's clouds have
# Largest standard deviation of noise, in radii of the unit sphere: a little more than the paper's
# strongest, 0.10.
MAX_NOISE = 0.12
CLEAN_SHARE = 0.4  # share of the clouds that get no noise


class Degradation(NamedTuple):
    """The degradation of clouds in a training; its defaults are those of splat-net.

    points_seen  the numbers of points of which each step has one, all equally likely
    most_noise   the largest standard deviation of the noise, in radii of the unit sphere
    clean_share  the share of the clouds that have no noise
    """

    points_seen: tuple[int, ...] = POINTS_SEEN
    most_noise: float = MAX_NOISE
    clean_share: float = CLEAN_SHARE


_OF_BASELINES = Degradation()


def degrade(
    clouds: Tensor, random: torch.Generator, how: Degradation = _OF_BASELINES
) -> tuple[Tensor, Tensor]:
    """Return fewer points of each cloud with noise, [B, N, 3], and the same points without it.

    Of clouds [B, M, 3]. N is one of `how.points_seen` for the whole batch, at most M.
    """
    which = int(torch.randint(len(how.points_seen), (), generator=random))
    clean = draw_points(clouds, how.points_seen[which], random)
    return add_noise(clean, how.most_noise, how.clean_share, random), clean


def draw_points(clouds: Tensor, count: int, random: torch.Generator) -> Tensor:
    """Return `count` different points of each cloud, in random order, [B, count, 3].

    clouds  [B, M, 3], M at least `count`
    """
    batch, available, _ = clouds.shape
    # Sorting random numbers gives a random order, a different one for each cloud.
    order = torch.rand(batch, available, generator=random).argsort(dim=1)[:, :count]
    return clouds.gather(1, order[:, :, None].expand(-1, -1, 3))


def add_noise(points: Tensor, most: float, clean_share: float, random: torch.Generator) -> Tensor:
    """Return clouds [B, N, 3] with Gaussian noise.

    most         the standard deviation of a cloud's noise is drawn uniformly from 0..most
    clean_share  probability that a cloud gets no noise
    """
    sigma = torch.rand(len(points), 1, 1, generator=random) * most
    noisy = torch.rand(len(points), 1, 1, generator=random) >= clean_share
    return points + torch.randn(points.shape, generator=random) * sigma * noisy
