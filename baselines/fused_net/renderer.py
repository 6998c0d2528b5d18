"""fused-net as a method of the benchmark.

A cloud is prepared once: its surfels, and its meshes. Of each view the network then sees the
projected surfels, and maps of the meshes.
"""

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

OCCUPANCY = "all"  # name of the bundled weights of occupancy-net that make its mesh
# Number of different points from which on one mesh is enough, that of occupancy-net. On validation
# objects with so many points, noisy or not, leaving out the mesh of denoised-wrap changes LPIPS by
# .001 or less; leaving out that of occupancy-net raises it by .008 to .036.
ENOUGH = 1024
NOTHING = in_grey(np.empty((0, 3)), np.empty((0, 3), int))  # a mesh without faces


@dataclass(frozen=True, eq=False)
class _FusedState:
    """The prepared state of a cloud.

    surfels  the points with their normals
    meshes   in the order of the network's inputs; those that were not made have no faces
    notes    what went wrong, for the user
    """

    surfels: Surfels
    meshes: tuple[Mesh, ...]
    notes: tuple[str, ...]


class FusedNetRenderer:
    """A `data_prep.scene.Renderer` that draws as `SplatNetRenderer`, and shows the network meshes.

    weights    of `baselines.fused_net.weights.load_weights`
    device, precision, size
               as for `baselines.splat_net.renderer.SplatNetRenderer`

    Raises ValueError for another precision or size.
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
        """Return the surfels and meshes of a cloud; `rng` is not used.

        Where a method fails to make its mesh, the network draws without it, and a note says so. A
        cloud of ENOUGH different points has only the mesh of occupancy-net, or that of
        denoised-wrap where occupancy-net fails.

        Raises StageFailure at the stage "input", for an empty or non-finite cloud.
        """
        del rng
        surfels = self.splats.prepare(cloud)
        meshes, notes = reconstruct(cloud, self.methods)
        return _FusedState(surfels=surfels, meshes=meshes, notes=notes)

    def draw(
        self,
        state: _FusedState,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
        size: int | None = None,
    ) -> Images:
        """Return images of a cloud, float32 [V, size, size, 3] in [0, 1]; `rng` is not used.

        size  of the images in pixels, a multiple of 16; None for that of the renderer. Drawing at
              256 pixels is better than enlarging images of 128: mean LPIPS of 30 real objects is
              .119 in place of .145. For splat-net, without meshes, it is not (.161 and .156)

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
    """Return the function that makes of some views what the network sees from them."""

    def project(some: Sequence[View]) -> Projection:
        maps = torch.from_numpy(maps_of(state.meshes, some, splats.size))
        at, maps = cameras(some).to(splats.device), maps.to(splats.device)
        return Projection(state.surfels, at, splats.inputs, splats.size, maps)

    return project


class _Reconstructor(Protocol):
    """A method that makes a mesh of a cloud."""

    def prepare(self, cloud: PointCloud) -> Reconstruction: ...


def reconstructors(names: Sequence[str], device: str = "cpu") -> dict[str, _Reconstructor]:
    """Return the methods that make meshes, by their `names`, which are of `weights.MESHES`."""
    methods: dict[str, _Reconstructor] = {}
    for name in names:
        if name == "occupancy-net":
            methods[name] = OccupancyNetRenderer(load_weights(OCCUPANCY), device=device)
        else:
            methods[name] = DenoisedWrap()
    return methods


def reconstruct(
    cloud: PointCloud, methods: Mapping[str, _Reconstructor]
) -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """Return the meshes of a cloud in the order of `methods`, and notes.

    Where a method fails, its mesh has no faces and a note says why: the network still sees the
    points. For ENOUGH different points only one mesh is made, by the last method that does not
    fail; the others have no faces.
    """
    meshes = dict.fromkeys(methods, NOTHING)
    notes = {name: list[str]() for name in methods}
    enough = len(np.unique(cloud.points, axis=0)) >= ENOUGH
    for name in reversed(list(methods)):
        if enough and any(len(mesh.faces) for mesh in meshes.values()):
            break
        try:
            result = methods[name].prepare(cloud)
        except StageFailure as failure:
            notes[name] = [f"no mesh, {failure}"]
        else:
            meshes[name], notes[name] = result.mesh, list(result.notes)
    named = [f"{name}: {note}" for name in methods for note in notes[name]]
    return tuple(meshes.values()), tuple(named)


def maps_of(
    meshes: Sequence[Mesh], views: Sequence[View], size: int = IMAGE_SIZE
) -> NDArray[np.float32]:
    """Return the maps of meshes from views, one mesh after the other, [V, 5 * meshes, S, S]."""
    return np.concatenate([surface_maps(mesh, views, size) for mesh in meshes], axis=1)
