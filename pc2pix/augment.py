"""Augmentation of the training data of pc2pix: fewer points, noise, and mirrored scenes.

A network that was trained with noise and fewer points is expected to be robust against them, so its
model card says whether it was. Random numbers come from a `torch.Generator` on the CPU, whose state
is in checkpoints, so that a resumed training continues exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from data_prep.clouds.sampling import even_rows
from learning.clouds import Degradation

# Up to the paper's strongest noise, and down to half of its sparsest clouds.
DEGRADATION = Degradation(points_seen=(256, 512, 1024), most_noise=0.1, clean_share=0.5)
PLAIN_POINTS = 1024  # points of a cloud without augmentation, for an encoder that takes any number


def take_evenly(points: Tensor, count: int) -> Tensor:
    """Return `count` points of clouds [B, N, 3], in their order: row i is floor(i N / count).

    So points are repeated or left out evenly.
    """
    return points[:, torch.from_numpy(even_rows(points.shape[1], count))]


class Scene(NamedTuple):
    """A batch of B clouds with an image of each, and the directions that the images are seen from.

    points       [B, N, 3]
    images       [B, 3, H, W]
    elevation01  [B, 1], elevation_deg / 80 + 0.5
    azimuth01    [B, 1], azimuth_deg / 360 + 0.5
    """

    points: Tensor
    images: Tensor
    elevation01: Tensor
    azimuth01: Tensor


def mirror(scene: Scene, which: Tensor) -> Scene:
    """Return a batch in which the scenes marked in `which`, bool [B], are mirrored left to right.

    This is exact: because the light is at the camera, a mirrored shape seen from the opposite
    azimuth gives the mirrored image.
    """
    sign = torch.where(which, -1.0, 1.0)[:, None].to(scene.points)
    x, rest = scene.points[:, :, :1], scene.points[:, :, 1:]
    of_images = which[:, None, None, None].to(scene.images.device)
    return Scene(
        points=torch.cat([x * sign[:, :, None], rest], dim=2),
        images=torch.where(of_images, scene.images.flip(3), scene.images),
        elevation01=scene.elevation01,
        azimuth01=torch.where(which[:, None], 1 - scene.azimuth01, scene.azimuth01),
    )
