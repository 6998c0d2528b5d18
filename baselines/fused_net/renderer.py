"""fused-net as a method of the benchmark.

A cloud is prepared once: its surfels, and its meshes. Of each view the network then sees the
projected surfels, and maps of the meshes. `many_points` says what is prepared of a cloud with more
points than the network knows, and `enlarging` how images larger than the network's are drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.fused_net.enlarging import up, with_detail
from baselines.fused_net.many_points import shown_to_network
from baselines.occupancy_net.renderer import OccupancyNetRenderer
from baselines.occupancy_net.weights import load_weights
from baselines.reconstruction.denoised import is_noisy
from baselines.reconstruction.stages import Reconstruction, in_grey
from baselines.splat_net.engine import FoldedSplatNet, Precision
from baselines.splat_net.projection import Projection, cameras, lenses
from baselines.splat_net.renderer import Projector, SplatNetRenderer, views_at_once
from baselines.splat_net.sharpening import planes_of_mesh
from baselines.splat_net.surfels import Surfels
from baselines.upsampler.renderer import UpsampledWrapRenderer
from baselines.upsampler.weights import load_weights as upsampler_weights
from data_prep.clouds.sorting import different_points
from data_prep.failures import StageFailure
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import IMAGE_SIZE, AnyView, Images, Mesh, PointCloud
from learning.exact import exact_inference
from learning.weights import NetworkWeights

OCCUPANCY = "all"  # name of the bundled weights of occupancy-net that make its mesh
UPSAMPLER = "all"  # name of those that make the mesh of upsampled-wrap
NOTHING = in_grey(np.empty((0, 3)), np.empty((0, 3), int))  # a mesh without faces


@dataclass(frozen=True, eq=False)
class _FusedState:
    """The prepared state of a cloud.

    surfels  the points with their normals
    meshes   in the order of the network's inputs; those that were not made have no faces
    exact    whether the last mesh is that of a clean cloud with many points
    notes    what was done to the points, and what went wrong, for the user
    """

    surfels: Surfels
    meshes: tuple[Mesh, ...]
    exact: bool
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
        self.methods = reconstructors(device)

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> _FusedState:
        """Return the surfels and meshes of a cloud; `rng` is not used.

        Where a method fails to make its mesh, the network draws without it, and a note says so. A
        cloud with more points than the network knows has only the mesh of upsampled-wrap, unless it
        is very noisy.

        Raises StageFailure at the stage "input", for an empty or non-finite cloud.
        """
        del rng
        shown = shown_to_network(cloud)
        surfels = self.splats.prepare(shown.cloud)
        meshes: tuple[Mesh, ...] = ()
        notes: tuple[str, ...] = ()
        if shown.source is not None:
            try:
                result = self.methods["upsampled-wrap"].prepare(PointCloud(shown.source))
            except StageFailure as failure:
                notes = (f"upsampled-wrap: no mesh, {failure}",)
            else:
                meshes = (*[NOTHING] * (len(self.methods) - 1), result.mesh)
                notes = tuple(f"upsampled-wrap: {note}" for note in result.notes)
        exact = bool(meshes) and shown.noise == 0
        if not meshes:
            meshes, further = reconstruct(shown.cloud, self.methods)
            notes += further
        return _FusedState(
            surfels=surfels, meshes=meshes, exact=exact, notes=(*shown.notes, *notes)
        )

    def draw(
        self,
        state: _FusedState,
        views: Sequence[AnyView],
        rng: np.random.Generator | None = None,
        size: int | None = None,
    ) -> Images:
        """Return images of a cloud, float32 [V, size, size, 3] in [0, 1]; `rng` is not used.

        size  of the images in pixels; None for that of the renderer, and a multiple of 16 below it

        Raises StageFailure at the stage "draw", where the network gives NaN or infinity.
        """
        del rng
        size = size or self.splats.size
        if self._takes_mesh(state, size):
            images = np.empty((len(views), size, size, 3), np.float32)
            for image, view in zip(images, views, strict=True):
                planes, albedo = self._with_mesh(state, view, size)
                image[...] = FoldedSplatNet.images_of(planes, albedo)[0].cpu().numpy()
            return images
        splats = self.splats.at_size(size)
        most = views_at_once(len(state.surfels))
        return splats.draw_projected(_projector(state, splats), views, most)

    def coverage(
        self, state: _FusedState, views: Sequence[AnyView], size: int | None = None
    ) -> NDArray[np.float32]:
        """Return the share of each pixel that is covered, float32 [V, size, size] in 0..1."""
        size = size or self.splats.size
        if self._takes_mesh(state, size):
            shares = np.empty((len(views), size, size), np.float32)
            for share, view in zip(shares, views, strict=True):
                planes, _ = self._with_mesh(state, view, size)
                share[...] = self._engine.coverage_of(planes)[0, ..., 0].cpu().numpy()
            return shares
        splats = self.splats.at_size(size)
        most = views_at_once(len(state.surfels))
        return splats.projected_coverage(_projector(state, splats), views, most)

    @property
    def _engine(self) -> FoldedSplatNet:
        engine = self.splats.engine
        assert isinstance(engine, FoldedSplatNet)  # points2pix sees no meshes
        return engine

    def _draws_mesh(self, state: _FusedState) -> bool:
        """Return whether the mesh is drawn alone, to which a network may add an albedo."""
        return state.exact and self._engine.network.config.heads[0] == "grey"

    def _takes_mesh(self, state: _FusedState, size: int) -> bool:
        """Return whether images of this size show the mesh, or have detail of it."""
        return size > self.splats.size or self._draws_mesh(state)

    @exact_inference()
    def _with_mesh(
        self, state: _FusedState, view: AnyView, size: int
    ) -> tuple[Tensor, Tensor | None]:
        """Return what `FoldedSplatNet.planes` does of a view, with the mesh or its detail.

        Raises StageFailure("draw", ...) where the network gives NaN or infinity.
        """
        engine, alone = self._engine, self._draws_mesh(state)
        with_faces = [mesh for mesh in state.meshes if len(mesh.faces)]
        mesh = with_faces[-1] if with_faces else NOTHING
        maps = torch.from_numpy(surface_maps(mesh, [view], size)).to(self.splats.device)
        of_mesh = planes_of_mesh(maps)
        if alone and "albedo" not in engine.network.config.heads:
            return of_mesh, None
        seen = _projector(state, self.splats)([view])
        drawn, albedo = engine.planes(seen.channels(slice(None), engine.dtype))
        if not drawn.sum().isfinite():
            raise StageFailure("draw", "the network gives an image that is not finite")
        colour = None if albedo is None else up(albedo, size).clamp(0, 1)
        return of_mesh if alone else with_detail(drawn, of_mesh), colour


def _projector(state: _FusedState, splats: SplatNetRenderer) -> Projector:
    """Return the function that makes of some views what the network sees from them."""

    def project(some: Sequence[AnyView]) -> Projection:
        maps = torch.from_numpy(maps_of(state.meshes, some, splats.size))
        at, maps = cameras(some).to(splats.device), maps.to(splats.device)
        lens = lenses(some).to(splats.device)
        return Projection(state.surfels, at, splats.inputs, splats.size, maps, lens)

    return project


class _Reconstructor(Protocol):
    """A method that makes a mesh of a cloud."""

    def prepare(self, cloud: PointCloud) -> Reconstruction: ...


def reconstructors(device: str = "cpu") -> dict[str, _Reconstructor]:
    """Return the methods that make meshes, by their names, in the order of `weights.MESHES`."""
    return {
        "occupancy-net": OccupancyNetRenderer(load_weights(OCCUPANCY), device=device),
        "upsampled-wrap": UpsampledWrapRenderer(upsampler_weights(UPSAMPLER), device=device),
    }


def reconstruct(
    cloud: PointCloud, methods: Mapping[str, _Reconstructor]
) -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """Return the meshes of a cloud in the order of `methods`, and notes.

    Where a method fails, its mesh has no faces and a note says why: the network still sees the
    points. Of a noisy cloud the mesh of upsampled-wrap is not made: with it LPIPS of validation
    objects is lower by .001 at most, and it would take most of the time.
    """
    noisy = is_noisy(different_points(cloud.points))
    meshes: list[Mesh] = []
    notes: list[str] = []
    for name, method in methods.items():
        if noisy and name == "upsampled-wrap":
            meshes.append(NOTHING)
            continue
        try:
            result = method.prepare(cloud)
        except StageFailure as failure:
            meshes.append(NOTHING)
            notes.append(f"{name}: no mesh, {failure}")
        else:
            meshes.append(result.mesh)
            notes += [f"{name}: {note}" for note in result.notes]
    return tuple(meshes), tuple(notes)


def maps_of(
    meshes: Sequence[Mesh], views: Sequence[AnyView], size: int = IMAGE_SIZE
) -> NDArray[np.float32]:
    """Return the maps of meshes from views, one mesh after the other, [V, 5 * meshes, S, S]."""
    return np.concatenate([surface_maps(mesh, views, size) for mesh in meshes], axis=1)
