"""splat-net as a method of the benchmark: surfels once per cloud, all views in groups."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from baselines.splat_net.engine import GROUP, FoldedSplatNet, Precision
from baselines.splat_net.network import SMALLEST
from baselines.splat_net.projection import cameras, project
from baselines.splat_net.surfels import Surfels, find_surfels, stack
from baselines.splat_net.weights import Weights
from data_prep.failures import StageFailure
from data_prep.scene import IMAGE_SIZE, Images, PointCloud, View

POINTS_TOGETHER = 2**19  # of all images of a group: a bound on memory for large clouds


class SplatNetRenderer:
    """`data_prep.scene.Renderer` by projection and network.

    precision  of the network: "float32" (default), or "bfloat16", twice as fast where the processor
               has it; points and their projection are float32 always. ValueError for another
    size       of the images, a multiple of 16. ValueError for another. The network was trained
               for 128

    The order of the points does not matter: the same image, bit for bit. Results do not depend on
    the other views of a call, or the number of threads, beyond the rounding of the precision.
    """

    def __init__(
        self,
        weights: Weights,
        *,
        device: str = "cpu",
        precision: Precision = "float32",
        size: int = IMAGE_SIZE,
    ) -> None:
        if size < SMALLEST or size % SMALLEST:
            raise ValueError(f"size {size}: expected a multiple of {SMALLEST}")
        self.weights = weights
        self.device = torch.device(device)
        self.network = weights.network.to(self.device)
        self.inputs = self.network.config.inputs
        self.size = size
        self.folded = FoldedSplatNet(self.network, precision, size)

    @torch.inference_mode()
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Surfels:
        """Neighbours and normals of all points, with one leading dimension; `rng` is not used.

        Raises StageFailure("input") for an empty or non-finite cloud. A single point, or points
        that all coincide, are drawn like any others.
        """
        del rng
        if not len(cloud):
            raise StageFailure("input", "no points")
        bad = int((~np.isfinite(cloud.points)).any(axis=1).sum())
        if bad:
            raise StageFailure("input", f"{bad} of {len(cloud)} points are not finite")
        workers = torch.get_num_threads()
        surfels = stack([find_surfels(cloud.points, workers, surfaces=self.inputs.surfaces)])
        return Surfels(*(value.to(self.device) for value in vars(surfels).values()))

    @torch.inference_mode()
    def draw(
        self, state: Surfels, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Images float32 [V, size, size, 3] in 0..1; no randomness. No views: an empty array."""
        del rng
        images = np.empty((len(views), self.size, self.size, 3), np.float32)
        group = max(1, min(GROUP, POINTS_TOGETHER // len(state)))
        for start in range(0, len(views), group):
            seen = views[start : start + group]
            at = cameras(seen).to(self.device)
            channels = project(state, at, self.inputs, self.size, self.folded.dtype)
            drawn = self.folded(channels)
            if not drawn.isfinite().all():
                raise StageFailure("draw", "the picture is not finite")
            images[start : start + group] = drawn.cpu().numpy()
        return images
