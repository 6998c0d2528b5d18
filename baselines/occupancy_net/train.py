"""Training of occupancy-net: it learns to tell whether places are inside the object of a cloud.

The places are near the surface and elsewhere in the box, and their labels are known. The loss is
the cross entropy of the labels. Clouds are degraded, and the learning rate falls, as in the
training of splat-net.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.occupancy_net.config import OccupancyNetConfig
from baselines.occupancy_net.network import (
    HALF_EXTENT,
    OccupancyNet,
)
from data_prep.datasets.occupancy_set import OccupancySet
from learning import training_loop
from learning.clouds import degrade
from learning.trainer import CooledTrainer

PLACES = 2048  # places of each object that a step learns from
SHEET_CLOUDS = 8  # objects on a sheet of progress, at most
SHEET_CELLS = 64  # cells along a side of the grid that shows an object there


class OccupancyNetTrainer(CooledTrainer):
    """The trainer of occupancy-net, on an `OccupancySet`."""

    kind = "occupancy-net"
    parts = ("network", "average", "adam", "random")
    config: OccupancyNetConfig

    def __init__(self, data: OccupancySet, config: OccupancyNetConfig, *place: Any) -> None:
        super().__init__(data, config, *place)
        self.clouds = torch.from_numpy(data.clouds)
        self.queries = torch.from_numpy(data.queries)
        self.inside = torch.from_numpy(data.inside)
        self.build(training_loop.seeded(config.seed, lambda: OccupancyNet(config.network)))

    def take_step(self) -> dict[str, Tensor]:
        """Take a step and return the loss, and the share of places that got the wrong answer."""
        points, places, inside = self._draw_batch()
        with self.autocast():
            logits = self.network(points, places)
        loss = functional.binary_cross_entropy_with_logits(logits.float(), inside)
        wrong = ((logits > 0) != (inside > 0)).float().mean()
        self.learn(loss)
        return {"occupancy": loss.detach(), "wrong": wrong}

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return an image with a column for each object: its points, and the predicted shape.

        Both are seen from the front. A pixel of the shape is as dark as the highest probability of
        being inside along the depth. Clouds are whole and without noise, the network is the
        averaged one.
        """
        count = min(SHEET_CLOUDS, len(self.clouds))
        points = self.clouds[torch.arange(count) * len(self.clouds) // count].to(self.device)
        side = (torch.arange(SHEET_CELLS, device=self.device) + 0.5) * (2 / SHEET_CELLS) - 1
        place = torch.cartesian_prod(-side, side, side[::2]) * HALF_EXTENT  # rows from the top
        places = place[:, [1, 0, 2]].expand(count, -1, -1)
        shape = self.average(points, places).sigmoid()
        dark = shape.view(count, SHEET_CELLS, SHEET_CELLS, -1).amax(dim=3)
        dots = torch.zeros_like(dark)
        cell = ((points / HALF_EXTENT + 1) * (SHEET_CELLS / 2)).clamp(0, SHEET_CELLS - 1).long()
        objects = torch.arange(count, device=self.device)[:, None]
        dots[objects, SHEET_CELLS - 1 - cell[..., 1], cell[..., 0]] = 1.0
        rows = torch.stack([dots, dark]).transpose(1, 2).flatten(2).flatten(0, 1)
        rows = (1 - rows).repeat_interleave(2, 0).repeat_interleave(2, 1)
        return (rows * 255).round().byte()[..., None].expand(-1, -1, 3).cpu().numpy()

    def _draw_batch(self) -> tuple[Tensor, Tensor, Tensor]:
        """Return clouds [B, N, 3], places [B, Q, 3], and labels [B, Q]: 1 inside, 0 outside."""
        count, queries = self.inside.shape
        objects = torch.randint(count, (self.config.batch,), generator=self.random)
        mirrored = torch.rand(self.config.batch, generator=self.random) < 0.5
        # An object's places are in random order, so any sequence of them is a random choice.
        taken = min(PLACES, queries)
        first = int(torch.randint(queries - taken + 1, (), generator=self.random))
        places = self.queries[objects, first : first + taken]
        inside = self.inside[objects, first : first + taken].float()
        points = self.clouds[objects]
        if self.config.augment:
            points, _ = degrade(points, self.random)
        signs = torch.ones(self.config.batch, 1, 3)
        signs[mirrored, :, 0] = -1.0
        points, places = points * signs, places * signs
        return points.to(self.device), places.to(self.device), inside.to(self.device)
