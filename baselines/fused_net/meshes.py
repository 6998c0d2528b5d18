"""The meshes of a cloud that fused-net sees, and their maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.occupancy_net.renderer import OccupancyNetRenderer
from baselines.occupancy_net.weights import load_weights
from baselines.reconstruction.alpha_wrap import DenoisedWrap
from baselines.reconstruction.stages import Reconstruction, in_grey
from data_prep.failures import StageFailure
from data_prep.rendering.raycast import surface_maps
from data_prep.scene import IMAGE_SIZE, Mesh, PointCloud, View

OCCUPANCY = "all"  # the bundled weights of occupancy-net
NOTHING = in_grey(np.empty((0, 3)), np.empty((0, 3), int))


class _Reconstructor(Protocol):
    """A method that makes a mesh of a cloud."""

    def prepare(self, cloud: PointCloud) -> Reconstruction:
        """Return the mesh. Raises StageFailure."""
        ...


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

    Where a method fails its mesh has no faces, and a note says why: the points are still there.
    """
    meshes, notes = [], []
    for name, method in methods.items():
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
    meshes: Sequence[Mesh], views: Sequence[View], size: int = IMAGE_SIZE
) -> NDArray[np.float32]:
    """Return the maps of meshes from views, one mesh after the other, [V, 5 * meshes, S, S]."""
    return np.concatenate([surface_maps(mesh, views, size) for mesh in meshes], axis=1)
