"""occupancy-net as a method of the benchmark: an occupancy on a grid, and its level set in grey."""

from __future__ import annotations

import numpy as np
import torch

from baselines.occupancy_net.level_set import level_set, sample_grid
from baselines.occupancy_net.network import HALF_EXTENT
from baselines.reconstruction.stages import DrawsReconstruction, Reconstruction, used_points
from data_prep.scene import PointCloud
from learning.exact import exact_inference
from learning.weights import NetworkWeights

MOST_POINTS = 2048  # as many as it was shown in training
LEVEL = 0.4  # probability of being inside; chosen on validation objects


class OccupancyNetRenderer(DrawsReconstruction):
    """A `data_prep.scene.Renderer` of the surface that the network sees in a cloud.

    weights  trained network of `baselines.occupancy_net.weights.load_weights`; moved to `device`
    device   PyTorch's name of the device
    level    probability at which the surface lies, between 0 and 1
    """

    def __init__(
        self, weights: NetworkWeights, *, device: str = "cpu", level: float = LEVEL
    ) -> None:
        self.weights = weights
        self.device = torch.device(device)
        self.network = weights.network.to(self.device, memory_format=torch.channels_last)
        self.logit = float(np.log(level / (1 - level)))

    @exact_inference()
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Find the surface; no randomness, and the order of the points does not matter.

        Raises StageFailure: `input` (no point is in sight, or one is not finite), `occupancy` (a
        value is not finite) or `marching-cubes` (nothing is inside).
        """
        del rng
        points, notes = used_points(cloud, 1, MOST_POINTS, "occupancy networks")
        seen = torch.from_numpy(points)
        occupancy = self.network.on_grid(self.network.encode(seen[None].to(self.device)))
        values = sample_grid(occupancy, seen, HALF_EXTENT, self.logit)
        return Reconstruction(level_set(values.numpy(), self.logit, HALF_EXTENT), notes)
