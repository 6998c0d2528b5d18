"""Augmentation of clouds, batch by batch: points drawn from them, noise added.

All randomness is a `torch.Generator` on the CPU, so that a resumed run goes on exactly.
"""

from __future__ import annotations

import torch
from torch import Tensor


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
