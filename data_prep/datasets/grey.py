"""Objects without their colours: the same shapes, all faces in neutral grey."""

from __future__ import annotations

from dataclasses import dataclass

from data_prep.datasets.objects import MeshObject, SceneObject
from data_prep.scene import NEUTRAL_GREY, Mesh, in_one_colour


def grey(mesh: Mesh) -> Mesh:
    """Return the mesh with all faces in NEUTRAL_GREY."""
    return in_one_colour(mesh, NEUTRAL_GREY)


def is_grey(mesh: Mesh) -> bool:
    """Return whether all faces of a mesh are in NEUTRAL_GREY."""
    return bool((mesh.face_colors[:, :3] == NEUTRAL_GREY).all())


@dataclass(frozen=True)
class GreyObject(MeshObject):
    """An object in neutral grey, with the names of the original.

    Equal names give the same views and, by the same random numbers, the same points.
    """

    original: SceneObject

    @property
    def class_name(self) -> str:
        """Return the class of the original."""
        return self.original.class_name

    @property
    def object_id(self) -> str:
        """Return the id of the original."""
        return self.original.object_id

    def fingerprint(self) -> str:
        """Return a text that differs from the fingerprint of the original."""
        return f"unpainted {self.original.fingerprint()}"  # part of the keys of finished work

    def load(self) -> Mesh:
        """Return the mesh of the original in grey."""
        return grey(self.original.load())
