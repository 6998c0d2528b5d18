"""fused-net as a method of the benchmark: surfels and meshes once per cloud, views in groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from baselines.fused_net.meshes import maps_of, reconstruct, reconstructors
from baselines.splat_net.engine import Precision
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.renderer import SplatNetRenderer, views_at_once
from baselines.splat_net.surfels import Surfels
from data_prep.scene import IMAGE_SIZE, Images, Mesh, PointCloud, View
from learning.weights import NetworkWeights


@dataclass(frozen=True, eq=False)
class _FusedState:
    """The surfels of a cloud, its meshes in the order of the network's inputs, and notes.

    A mesh that could not be made has no faces.
    """

    surfels: Surfels
    meshes: tuple[Mesh, ...]
    notes: tuple[str, ...]


class FusedNetRenderer:
    """A `data_prep.scene.Renderer` by `SplatNetRenderer`, to which the meshes are shown as well.

    Parameters
    ----------
    weights : NetworkWeights
        Trained network of `baselines.fused_net.weights.load_weights`; moved to `device`.
    device : str
        PyTorch's name of the device.
    precision : {"float32", "bfloat16"}
        Precision of the network that draws; all before it is float32.
    size : int
        Side of the images in pixels, a multiple of 16. The network was trained for 128.

    Raises
    ------
    ValueError
        For another precision or size.
    """

    def __init__(
        self,
        weights: NetworkWeights,
        *,
        device: str = "cpu",
        precision: Precision = "float32",
        size: int = IMAGE_SIZE,
    ) -> None:
        self.weights = weights
        self.splats = SplatNetRenderer(weights, device=device, precision=precision, size=size)
        self.methods = reconstructors(self.splats.inputs.meshes, device)

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> _FusedState:
        """Return the surfels and meshes of a cloud; no randomness.

        A method that fails to make a mesh is left out, and a note says so.

        Raises StageFailure at the stage "input", for an empty or non-finite cloud.
        """
        del rng
        surfels = self.splats.prepare(cloud)
        return _FusedState(surfels, *reconstruct(cloud, self.methods))

    def draw(
        self, state: _FusedState, views: Sequence[View], rng: np.random.Generator | None = None
    ) -> Images:
        """Return images of a cloud, float32 [V, size, size, 3] in [0, 1]; no randomness.

        Raises StageFailure at the stage "draw", where the network gives NaN or infinity.
        """
        del rng
        splats = self.splats

        def project(some: Sequence[View]) -> Projection:
            maps = torch.from_numpy(maps_of(state.meshes, some, splats.size))
            at, maps = cameras(some).to(splats.device), maps.to(splats.device)
            return Projection(state.surfels, at, splats.inputs, splats.size, maps)

        return splats.draw_projected(project, views, views_at_once(len(state.surfels)))
