"""Augmentation of clouds, batch by batch: points drawn from them, noise added.

All randomness is a `torch.Generator` on the CPU, so that a resumed run goes on exactly.
"""

from __future__ import annotations

import torch
from torch import Tensor

POINTS_SEEN = (2048, 2048, 1024, 512, 512)  # one of these for all clouds of a step
MAX_NOISE = 0.12  # standard deviation, in radii of the unit sphere: a little beyond the paper's
CLEAN_SHARE = 0.4


def degrade(clouds: Tensor, random: torch.Generator) -> tuple[Tensor, Tensor]:
    """Return clouds [B, N, 3] of fewer points with noise, of clouds [B, M, 3], and without it.

    N is one of POINTS_SEEN, at most M. This is what splat-net and its opponent in 3D are shown.
    """
    which = int(torch.randint(len(POINTS_SEEN), (), generator=random))
    clean = draw_points(clouds, POINTS_SEEN[which], random)
    return add_noise(clean, MAX_NOISE, CLEAN_SHARE, random), clean


def draw_points(clouds: Tensor, count: int, random: torch.Generator) -> Tensor:
    """Return [B, count, 3]: points of clouds [B, M, 3] in random order, none twice.

    count <= M.
    """
    batch, available, _ = clouds.shape
    # the order of random numbers is a random order, another one for each cloud
    order = torch.rand(batch, available, generator=random).argsort(dim=1)[:, :count]
    return clouds.gather(1, order[:, :, None].expand(-1, -1, 3))


def add_noise(points: Tensor, most: float, clean_share: float, random: torch.Generator) -> Tensor:
    """Return clouds [B, N, 3] with Gaussian noise on all but about `clean_share` of them.

    The standard deviation of a cloud's noise is drawn from 0..most.
    """
    sigma = torch.rand(len(points), 1, 1, generator=random) * most
    noisy = torch.rand(len(points), 1, 1, generator=random) >= clean_share
    return points + torch.randn(points.shape, generator=random) * sigma * noisy
