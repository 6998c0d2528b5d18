"""Objects without their colours: the same shapes, all faces in neutral grey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_prep.mesh_files import NEUTRAL_GREY
from data_prep.scene import Mesh
from data_prep.scene_objects import MeshObject, SceneObject


def unpainted(mesh: Mesh) -> Mesh:
    """The mesh with all faces in NEUTRAL_GREY."""
    return in_one_colour(mesh, NEUTRAL_GREY)


def is_unpainted(mesh: Mesh) -> bool:
    """Return whether all faces of a mesh are in NEUTRAL_GREY."""
    return bool((mesh.face_colors[:, :3] == NEUTRAL_GREY).all())


def in_one_colour(mesh: Mesh, color: tuple[int, int, int]) -> Mesh:
    """The mesh with all faces in a colour, red, green and blue in 0..255."""
    every = np.broadcast_to(np.array(color, np.uint8), mesh.face_colors.shape)
    return Mesh(mesh.vertices, mesh.faces, every)


@dataclass(frozen=True)
class Unpainted(MeshObject):
    """An object in neutral grey, with the name of the original.

    Hence the same views and, by the same random numbers, the same points.
    """

    original: SceneObject

    @property
    def class_name(self) -> str:
        """The original's."""
        return self.original.class_name

    @property
    def object_id(self) -> str:
        """The original's."""
        return self.original.object_id

    def fingerprint(self) -> str:
        """Differs from the original's."""
        return f"unpainted {self.original.fingerprint()}"

    def load(self) -> Mesh:
        """The original's mesh without its colours."""
        return unpainted(self.original.load())
