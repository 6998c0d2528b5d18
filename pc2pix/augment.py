"""Augmentation of training: fewer points, noise, mirrored scenes.

Whether noise and missing points were shown decides what robustness means afterwards; the model card
says so. All randomness is a `torch.Generator` on the CPU, so that a resumed run goes on exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from data_prep.clouds.sampling import even_rows
from learning.clouds import Degradation

# Up to the paper's strongest noise, and down to half of its sparsest clouds.
DEGRADATION = Degradation(points_seen=(256, 512, 1024), most_noise=0.1, clean_share=0.5)
PLAIN_POINTS = 1024  # what an encoder that takes any number is fed while training


def take_evenly(points: Tensor, count: int) -> Tensor:
    """Return rows floor(i N / count) of clouds [B, N, 3]: repeated or omitted evenly."""
    return points[:, torch.from_numpy(even_rows(points.shape[1], count))]


class Scene(NamedTuple):
    """A batch of B clouds, their images and the directions that these are seen from.

    points       [B, N, 3]
    images       [B, 3, H, W]
    elevation01  [B, 1], as the generator takes it
    azimuth01    [B, 1], as the generator takes it
    """

    points: Tensor
    images: Tensor
    elevation01: Tensor
    azimuth01: Tensor


def mirror(scene: Scene, which: Tensor) -> Scene:
    """Return the scenes marked in `which` (bool [B]) mirrored left to right.

    Exact for a light at the camera: a mirrored shape seen from the opposite azimuth gives the
    mirrored image.
    """
    sign = torch.where(which, -1.0, 1.0)[:, None].to(scene.points)
    x, rest = scene.points[:, :, :1], scene.points[:, :, 1:]
    images = torch.where(which[:, None, None, None].to(scene.images.device),
                         scene.images.flip(3), scene.images)  # fmt: skip
    azimuth01 = torch.where(which[:, None], 1 - scene.azimuth01, scene.azimuth01)
    return Scene(
        torch.cat([x * sign[:, :, None], rest], dim=2), images, scene.elevation01, azimuth01
    )
