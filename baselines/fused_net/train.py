"""Training of fused-net: it is that of splat-net, with clouds whose meshes are known.

Each object has one cloud (`baselines.fused_net.data`). A batch has clouds of one number of points,
as in the training of splat-net. Otherwise smaller clouds would have to be filled up by repeating
points, which would change their densities. Now and then a mesh is hidden, so that the network draws
what it can where a mesh could not be made.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.fused_net.config import FusedNetConfig
from baselines.fused_net.data import FusedSet, decode, mirror
from baselines.splat_net.losses import Truth
from baselines.splat_net.train import (
    VIEWS_TOGETHER,
    Seen,
    SplatNetTrainer,
)
from data_prep.datasets.training_set import SurfaceSet
from data_prep.rendering.raycast import MAPS

_HIDES = 0.2  # share of the clouds in a step of which one mesh is hidden


class FusedNetTrainer(SplatNetTrainer):
    """The trainer of fused-net, on a `FusedSet`."""

    kind = "fused-net"

    def __init__(self, learned: FusedSet, config: FusedNetConfig, *place: Any, **more: Any) -> None:
        super().__init__(learned, config, *place, **more)
        data = learned
        self.maps = data.maps
        self.counts = torch.from_numpy(data.counts)
        self.noise = torch.from_numpy(data.noise)
        # Sheets show objects whose clouds have all their points.
        most = (self.counts == self.counts.max()).nonzero()[:, 0]
        count = min(len(self.shown), len(most))
        self.shown = most[torch.arange(count) * len(most) // count]

    def surfaces(self) -> SurfaceSet:
        """Return the images of the objects, and their clouds."""
        return self.learned.surfaces

    def _draw_batch(self) -> tuple[Seen, Truth, Tensor]:
        """Return the network's input of B views, the true images, and the noise of clouds [B]."""
        views = self.data.seen.azimuth_deg.shape[1]
        clouds = self.batch // VIEWS_TOGETHER
        # The number of points of a random object: it is as likely as objects with it are frequent.
        points = self.counts[torch.randint(len(self.counts), (), generator=self.random)]
        like = (self.counts == points).nonzero()[:, 0]
        objects = like[torch.randint(len(like), (clouds,), generator=self.random)]
        order = torch.rand(clouds, views, generator=self.random).argsort(dim=1)
        mirrored = torch.rand(clouds, generator=self.random) < 0.5
        taken = self.clouds[objects, : int(points)]
        seen, truth = self._scene(taken, objects, order[:, :VIEWS_TOGETHER], mirrored)
        self._hide_meshes(seen[0])
        return seen, truth, self.noise[objects].repeat_interleave(VIEWS_TOGETHER)

    def _hide_meshes(self, channels: Tensor) -> None:
        """Set the maps of one mesh to 0, in all views of a few clouds, as if it had failed.

        channels  [B, C, S, S], with the views of a cloud one after the other
        """
        inputs = self.config.network.inputs
        clouds, count = len(channels) // VIEWS_TOGETHER, len(inputs.meshes)
        hides = torch.rand(clouds, 1, generator=self.random) < _HIDES
        which = torch.randint(count, (clouds, 1), generator=self.random)
        hidden = hides & (torch.arange(count) == which)  # [clouds, meshes]
        shown = (
            (~hidden).repeat_interleave(len(MAPS), dim=1).repeat_interleave(VIEWS_TOGETHER, dim=0)
        )
        channels[:, inputs.of_points :] *= shown[..., None, None].to(channels)

    def _maps(
        self, objects: NDArray[np.int64], views: NDArray[np.int64], mirrored: Tensor
    ) -> Tensor:
        """Return the maps [B, 5 * meshes, S, S] of B objects, each from one view.

        mirrored  bool [B, 1, 1, 1]: which ones are those of the mirrored object
        """
        maps = decode(torch.from_numpy(self.maps[objects, views]).to(self.device))
        return torch.where(mirrored, mirror(maps), maps)
