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
from baselines.splat_net.renderer import Projector, SplatNetRenderer, views_at_once
from baselines.splat_net.surfels import Surfels
from data_prep.failures import StageFailure
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import IMAGE_SIZE, Images, Mesh, PointCloud, View
from learning.weights import NetworkWeights

OCCUPANCY = "all"  # the bundled weights of occupancy-net
# Points: of more, with noise or without, LPIPS on validation objects is the same to .001 without
# the mesh of denoised-wrap, and .008 to .036 higher without that of occupancy-net.
ENOUGH = 1024
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

        A method that fails to make a mesh is left out, and a note says so. For ENOUGH different
        points denoised-wrap is left out, too, unless occupancy-net has failed.

        Raises StageFailure at the stage "input", for an empty or non-finite cloud.
        """
        del rng
        surfels = self.splats.prepare(cloud)
        return _FusedState(surfels, *reconstruct(cloud, self.methods))

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
        most = views_at_once(len(state.surfels))
        return splats.draw_projected(_projector(state, splats), views, most)

    def coverage(
        self, state: _FusedState, views: Sequence[View], size: int | None = None
    ) -> NDArray[np.float32]:
        """Return the share of each pixel that is covered, float32 [V, size, size] in 0..1."""
        splats = self.splats.at_size(size or self.splats.size)
        most = views_at_once(len(state.surfels))
        return splats.projected_coverage(_projector(state, splats), views, most)


def _projector(state: _FusedState, splats: SplatNetRenderer) -> Projector:
    def project(some: Sequence[View]) -> Projection:
        maps = torch.from_numpy(maps_of(state.meshes, some, splats.size))
        at, maps = cameras(some).to(splats.device), maps.to(splats.device)
        return Projection(state.surfels, at, splats.inputs, splats.size, maps)

    return project


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
    cloud: PointCloud, methods: Mapping[str, _Reconstructor]
) -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """Return the mesh of each method, and notes.

    Where a method fails its mesh has no faces, and a note says why: the points are still there. Of
    ENOUGH different points only the last method that does not fail makes a mesh.
    """
    meshes = dict.fromkeys(methods, NOTHING)
    notes = {name: list[str]() for name in methods}
    enough = len(np.unique(cloud.points, axis=0)) >= ENOUGH
    for name in reversed([*methods]):
        if enough and any(len(mesh.faces) for mesh in meshes.values()):
            break
        try:
            result = methods[name].prepare(cloud)
        except StageFailure as failure:
            notes[name] = [f"no mesh, {failure}"]
        else:
            meshes[name], notes[name] = result.mesh, [*result.notes]
    return (*meshes.values(),), tuple(f"{name}: {n}" for name in methods for n in notes[name])


def maps_of(
    meshes: Sequence[Mesh], views: Sequence[View], size: int = IMAGE_SIZE
) -> NDArray[np.float32]:
    """Return the maps of meshes from views, one mesh after the other, [V, 5 * meshes, S, S]."""
    return np.concatenate([surface_maps(mesh, views, size) for mesh in meshes], axis=1)
