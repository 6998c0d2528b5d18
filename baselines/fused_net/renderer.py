"""fused-net as a method of the benchmark: surfels and meshes once per cloud, and their maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.occupancy_net.renderer import OccupancyNetRenderer
from baselines.occupancy_net.weights import load_weights
from baselines.reconstruction.alpha_wrap import DenoisedWrap
from baselines.reconstruction.stages import Reconstruction, in_grey
from baselines.splat_net.engine import Precision
from baselines.splat_net.projection import Projection, cameras
from baselines.splat_net.renderer import SplatNetRenderer, views_at_once
from baselines.splat_net.surfels import Surfels
from data_prep.failures import StageFailure
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import IMAGE_SIZE, Images, Mesh, PointCloud, View
from learning.weights import NetworkWeights

OCCUPANCY = "all"  # the bundled weights of occupancy-net
WHOLE = 2048  # points; of fewer, or under noise, the second mesh tells what the first does not
NOTHING = in_grey(np.empty((0, 3)), np.empty((0, 3), int))


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

    It takes what that takes, and weights of `baselines.fused_net.weights.load_weights`.
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

        A method that fails to make a mesh is left out, and a note says so, as is occupancy-net for
        a cloud that does not need it: one of WHOLE different points or more that denoised-wrap
        takes as they are.

        Raises StageFailure at the stage "input", for an empty or non-finite cloud.
        """
        del rng
        surfels = self.splats.prepare(cloud)
        return _FusedState(
            surfels, *reconstruct(cloud, self.methods, sparing=len(surfels) >= WHOLE)
        )

    def draw(
        self,
        state: _FusedState,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
        size: int | None = None,
    ) -> Images:
        """Return images of a cloud, float32 [V, size, size, 3] in [0, 1]; no randomness.

        Images of 256 pixels are nearer to the truth than those of 128 resampled: LPIPS .119 in
        place of .145, mean of 30 real objects. Those of splat-net are not (.161, .156).

        Raises StageFailure at the stage "draw", where the network gives NaN or infinity.
        """
        del rng
        splats = self.splats.at_size(size or self.splats.size)

        def project(some: Sequence[View]) -> Projection:
            maps = torch.from_numpy(maps_of(state.meshes, some, splats.size))
            at, maps = cameras(some).to(splats.device), maps.to(splats.device)
            return Projection(state.surfels, at, splats.inputs, splats.size, maps)

        return splats.draw_projected(project, views, views_at_once(len(state.surfels)))


class _Reconstructor(Protocol):
    """A method that makes a mesh of a cloud."""

    def prepare(self, cloud: PointCloud) -> Reconstruction: ...


def reconstructors(names: Sequence[str], device: str = "cpu") -> dict[str, _Reconstructor]:
    """Return the methods of `baselines.fused_net.weights.MESHES` with these names."""
    return {
        name: OccupancyNetRenderer(load_weights(OCCUPANCY), device=device)
        if name == "occupancy-net"
        else DenoisedWrap()
        for name in names
    }


def reconstruct(
    cloud: PointCloud, methods: Mapping[str, _Reconstructor], *, sparing: bool = False
) -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """Return the mesh of each method, and notes.

    Where a method fails its mesh has no faces, and a note says why: the points are still there.
    `sparing` leaves out methods after one that takes the points as they are.
    """
    meshes, notes, enough = [], [], False
    for name, method in methods.items():
        if enough:
            meshes.append(NOTHING)
            notes.append(f"{name}: not needed, the points are many and without noise")
            continue
        try:
            result = method.prepare(cloud)
        except StageFailure as failure:
            meshes.append(NOTHING)
            notes.append(f"{name}: no mesh, {failure}")
        else:
            meshes.append(result.mesh)
            notes += [f"{name}: {note}" for note in result.notes]
            enough = sparing and result.noise == 0
    return tuple(meshes), tuple(notes)


def maps_of(
    meshes: Sequence[Mesh], views: Sequence[View], size: int = IMAGE_SIZE
) -> NDArray[np.float32]:
    """Return the maps of meshes from views, one mesh after the other, [V, 5 * meshes, S, S]."""
    return np.concatenate([surface_maps(mesh, views, size) for mesh in meshes], axis=1)
