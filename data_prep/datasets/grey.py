"""Objects without their colours: the same shapes, all faces in neutral grey."""

from __future__ import annotations

from dataclasses import dataclass

from data_prep.datasets.objects import MeshObject, SceneObject
from data_prep.scene import NEUTRAL_GREY, Mesh, in_one_colour


def unpainted(mesh: Mesh) -> Mesh:
    """The mesh with all faces in NEUTRAL_GREY."""
    return in_one_colour(mesh, NEUTRAL_GREY)


def is_unpainted(mesh: Mesh) -> bool:
    """Return whether all faces of a mesh are in NEUTRAL_GREY."""
    return bool((mesh.face_colors[:, :3] == NEUTRAL_GREY).all())


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
