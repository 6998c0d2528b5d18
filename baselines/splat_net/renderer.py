"""splat-net as a method of the benchmark: surfels once per cloud, all views in groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from baselines.splat_net.engine import GROUP, FoldedSplatNet, Precision
from baselines.splat_net.network import SMALLEST, camera_numbers, code_rows
from baselines.splat_net.projection import cameras, project
from baselines.splat_net.surfels import Surfels, find_surfels, stack
from baselines.splat_net.weights import Weights
from data_prep.failures import StageFailure
from data_prep.scene import IMAGE_SIZE, Images, PointCloud, View

POINTS_TOGETHER = 2**19  # of all pictures of a group: a bound on memory for large clouds


@dataclass(frozen=True, eq=False)
class Prepared:
    """A cloud's surfels, one leading dimension, and its code [1, code] if the network has one."""

    surfels: Surfels
    code: Tensor | None


class SplatNetRenderer:
    """`data_prep.scene.Renderer` by projection and network.

    precision  of the network: "float32" (default), or "bfloat16", twice as fast where the processor
               has it; points and their projection are float32 always. ValueError for another
    size       of the pictures, a multiple of 16. ValueError for another. The network was trained
               for 128

    The order of the points does not matter: the same picture, bit for bit. Results do not depend on
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
    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Prepared:
        """Neighbours and normals of all points, and the code; `rng` is not used.

        Raises StageFailure("input") for an empty or non-finite cloud, and StageFailure("encode")
        for one so large that its code is not finite. A single point, or points that all coincide,
        are drawn like any others.
        """
        del rng
        if not len(cloud):
            raise StageFailure("input", "no points")
        bad = int((~np.isfinite(cloud.points)).any(axis=1).sum())
        if bad:
            raise StageFailure("input", f"{bad} of {len(cloud)} points are not finite")
        workers = torch.get_num_threads()
        surfels = stack([find_surfels(cloud.points, workers, surfaces=self.inputs.surfaces)])
        surfels = Surfels(*(value.to(self.device) for value in vars(surfels).values()))
        if not self.network.config.code:
            return Prepared(surfels, None)
        code = self.network.code(surfels.points[:, code_rows(len(surfels))])
        if not code.isfinite().all():
            raise StageFailure("encode", "the cloud is too large for its code to be finite")
        return Prepared(surfels, code)

    @torch.inference_mode()
    def draw(
        self, state: Prepared, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Pictures float32 [V, size, size, 3] in 0..1; no randomness. No views: an empty array."""
        del rng
        images = np.empty((len(views), self.size, self.size, 3), np.float32)
        group = max(1, min(GROUP, POINTS_TOGETHER // len(state.surfels)))
        for start in range(0, len(views), group):
            seen = views[start : start + group]
            at = cameras(seen).to(self.device)
            channels = project(state.surfels, at, self.inputs, self.size, self.folded.dtype)
            code = None if state.code is None else state.code.expand(len(seen), -1)
            drawn = self.folded(channels, code, camera_numbers(seen).to(self.device))
            if not drawn.isfinite().all():
                raise StageFailure("draw", "the picture is not finite")
            images[start : start + group] = drawn.cpu().numpy()
        return images
