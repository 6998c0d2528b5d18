"""occupancy-net as a method of the benchmark: its mesh is a level set of an occupancy."""

from __future__ import annotations

import numpy as np
import torch

from baselines.occupancy_net.level_set import level_set, sample_grid
from baselines.occupancy_net.network import HALF_EXTENT
from baselines.reconstruction.stages import DrawsReconstruction, Reconstruction, used_points
from data_prep.scene import PointCloud
from learning.exact import exact_inference
from learning.weights import NetworkWeights

MOST_POINTS = 2048  # points that the network is shown: the most that it saw in training
LEVEL = 0.4  # probability of being inside at which the surface lies; best on validation objects


class OccupancyNetRenderer(DrawsReconstruction):
    """A `data_prep.scene.Renderer` of the surface that the network predicts for a cloud.

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
        """Return the surface of a cloud; `rng` is not used, nor does the points' order matter.

        Raises StageFailure at the stage `input` (no point is nearer to the origin than the camera,
        or one is not finite), `occupancy` (the network gives a value that is not finite) or
        `marching-cubes` (no place is likely enough to be inside).
        """
        del rng
        points, notes = used_points(cloud, 1, MOST_POINTS, "occupancy networks")
        seen = torch.from_numpy(points)
        occupancy = self.network.on_grid(self.network.encode(seen[None].to(self.device)))
        values = sample_grid(occupancy, seen, HALF_EXTENT, self.logit)
        return Reconstruction(level_set(values.numpy(), self.logit, HALF_EXTENT), notes)
