"""Training of the network: degraded clouds, and labels of places near their surface and elsewhere.

Clouds, noise and the course of the learning rate are those of splat-net. The loss is the cross
entropy of the labels.
"""

from __future__ import annotations

import copy
import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from baselines.occupancy_net.network import (
    DEFAULT,
    HALF_EXTENT,
    OccupancyConfig,
    OccupancyNet,
)
from baselines.occupancy_net.weights import KIND
from data_prep.datasets.occupancy_set import OccupancySet
from learning import training_loop
from learning.averaging import update
from learning.clouds import degrade
from learning.processes import ONE, Processes
from learning.trainer import CooledTrainer, Part

PLACES = 2048  # of an object in a step
SHEET_CLOUDS, SHEET_CELLS = 8, 64


@dataclass(frozen=True)
class OccupancyNetConfig:
    """The configuration of a training.

    cool_down  last steps, over which the learning rate falls to nothing
    batch      clouds a step
    augment    fewer points and noise; without it every cloud is seen whole and clean
    """

    network: OccupancyConfig = DEFAULT
    steps: int = 8000
    cool_down: int = 3000
    batch: int = 6
    augment: bool = True
    learning_rate: float = 1e-3
    ema_decay: float = 0.998
    precision: training_loop.Precision = "float32"
    seed: int = 0
    cadence: training_loop.Cadence = training_loop.DEFAULT_CADENCE


def train_occupancy_net(
    data: OccupancySet,
    config: OccupancyNetConfig,
    out_dir: Path,
    *,
    device: str = "cpu",
    on_progress: training_loop.OnProgress = lambda report: None,
) -> Path:
    """Train to `config.steps`, continuing a run in `out_dir`, and return the checkpoint's path.

    Raises BadInput where `out_dir` holds a run of another configuration or other data;
    TrainingDiverged where a loss stops being finite.
    """
    build = functools.partial(_OccupancyTrainer, data, config)
    arrays = [data.clouds, data.queries, data.inside]
    return training_loop.train(build, config, arrays, out_dir, device, on_progress)


class _OccupancyTrainer(CooledTrainer):
    kind = KIND
    config: OccupancyNetConfig

    def __init__(
        self,
        data: OccupancySet,
        config: OccupancyNetConfig,
        device: torch.device,
        processes: Processes = ONE,
    ) -> None:
        super().__init__(config, device, processes)
        self.batch = config.batch
        self.clouds = torch.from_numpy(data.clouds)
        self.queries = torch.from_numpy(data.queries)
        self.inside = torch.from_numpy(data.inside)
        network = training_loop.seeded(config.seed, lambda: OccupancyNet(config.network))
        self.network = network.to(device)
        self.average = copy.deepcopy(self.network).eval().requires_grad_(False)
        self.adam = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate, fused=True)

    def parts(self) -> dict[str, Part]:
        return {
            "network": self.network,
            "average": self.average,
            "adam": self.adam,
            "random": self.random,
        }

    def take_step(self) -> dict[str, Tensor]:
        points, places, inside = self._draw_batch()
        with self.autocast():
            logits = self.network(points, places)
        loss = functional.binary_cross_entropy_with_logits(logits.float(), inside)
        wrong = ((logits > 0) != (inside > 0)).float().mean()
        self.minimise(loss, self.adam, self.rate(int(self.steps_done)))
        self.steps_done += 1
        update(self.average, self.network, self.config.ema_decay, int(self.steps_done))
        return {"occupancy": loss.detach(), "wrong": wrong}

    @torch.no_grad()
    def sheet(self) -> NDArray[np.uint8]:
        """Return columns of objects: their points from the front, and the averaged network's shape.

        The shape is the highest probability along the depth; clouds are whole and without noise.
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
        """Return points [B, N, 3] of objects, places [B, Q, 3], and 1 for those inside [B, Q]."""
        count, queries = self.inside.shape
        objects = torch.randint(count, (self.config.batch,), generator=self.random)
        mirrored = torch.rand(self.config.batch, generator=self.random) < 0.5
        # the places of an object are in random order: any run of them is a random choice
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
