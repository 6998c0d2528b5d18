"""Training of the network: that of splat-net, on clouds whose meshes are known.

Each object has one cloud (`baselines.fused_net.data`). Clouds of a batch have the same number of
points, as in the training of splat-net: a cloud that is filled up would have other densities.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.fused_net.data import FusedSet, decode, mirror
from baselines.fused_net.weights import KIND, check_meshes
from baselines.splat_net.losses import FeatureMaps, Truth
from baselines.splat_net.points2pix import Network
from baselines.splat_net.train import (
    VIEWS_TOGETHER,
    Seen,
    SplatNetConfig,
    SplatNetTrainer,
    surface_arrays,
)
from learning import training_loop
from learning.processes import ONE, Processes


@dataclass(frozen=True)
class FusedNetConfig(SplatNetConfig):
    """The configuration of a training; the meshes are among the inputs of the network.

    occupancy  checksum of the weights of occupancy-net that make its meshes; "" without these
    """

    steps: int = 4000
    learning_rate: float = 1e-3
    occupancy: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_meshes(self.network.inputs.meshes, "meshes")


def train_fused_net(
    data: FusedSet,
    config: FusedNetConfig,
    out_dir: Path,
    *,
    start: Network | None = None,
    features: FeatureMaps | None = None,
    device: str = "cpu",
    on_progress: training_loop.OnProgress = lambda report: None,
) -> Path:
    """Train to `config.steps`, continuing a run in `out_dir`, and return the checkpoint's path.

    Arguments and errors are those of `baselines.splat_net.train.train_splat_net`.
    """
    arrays = [*surface_arrays(data.surfaces), data.counts, data.noise, data.maps]
    build = functools.partial(_FusedNetTrainer, data, config, start=start, features=features)
    return training_loop.train(build, config, arrays, out_dir, device, on_progress)


class _FusedNetTrainer(SplatNetTrainer):
    kind = KIND

    def __init__(
        self,
        data: FusedSet,
        config: FusedNetConfig,
        device: torch.device,
        processes: Processes = ONE,
        start: Network | None = None,
        features: FeatureMaps | None = None,
    ) -> None:
        super().__init__(data.surfaces, config, device, processes, start, features)
        self.maps = data.maps
        self.counts = torch.from_numpy(data.counts)
        self.noise = torch.from_numpy(data.noise)
        most = (self.counts == self.counts.max()).nonzero()[:, 0]
        count = min(len(self.shown), len(most))
        self.shown = most[torch.arange(count) * len(most) // count]

    def _draw_batch(self) -> tuple[Seen, Truth, Tensor]:
        """Return the network's input, the truth, and the noise of the clouds [B], for B views."""
        views = self.data.seen.azimuth_deg.shape[1]
        clouds = self.batch // VIEWS_TOGETHER
        # a number of points is as likely as its share of the objects
        points = self.counts[torch.randint(len(self.counts), (), generator=self.random)]
        like = (self.counts == points).nonzero()[:, 0]
        objects = like[torch.randint(len(like), (clouds,), generator=self.random)]
        order = torch.rand(clouds, views, generator=self.random).argsort(dim=1)
        mirrored = torch.rand(clouds, generator=self.random) < 0.5
        taken = self.clouds[objects, : int(points)]
        scene = self._scene(taken, objects, order[:, :VIEWS_TOGETHER], mirrored)
        return *scene, self.noise[objects].repeat_interleave(VIEWS_TOGETHER)

    def _maps(
        self, objects: NDArray[np.int64], views: NDArray[np.int64], mirrored: Tensor
    ) -> Tensor:
        """Return the maps [B, 5 * meshes, S, S] of objects from views, some of them mirrored."""
        maps = decode(torch.from_numpy(self.maps[objects, views]).to(self.device))
        return torch.where(mirrored, mirror(maps), maps)
