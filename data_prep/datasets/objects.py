"""Objects of datasets: clouds, the views they are seen from, and their true images.

An object is a small value that crosses process boundaries; files are read where they are needed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, NEUTRAL_GREY, Mesh, PointCloud, View, in_one_colour

Split = Literal["train", "validation", "test", "sealed", "novel-families"]


class SceneObject(Protocol):
    """One object of a dataset.

    Most objects are meshes (`MeshObject`), from which cloud, views and images are made. An object
    with clouds and images of its own (`paper:PATH`) returns these. A bare cloud has no true images:
    it can be drawn but not scored.
    """

    @property
    def class_name(self) -> str:
        """Return the class of the object."""
        ...

    @property
    def object_id(self) -> str:
        """Return an id that is unique within the class."""
        ...

    @property
    def has_truth(self) -> bool:
        """Return whether the object has true images that methods can be scored against."""
        ...

    def fingerprint(self) -> str:
        """Return a text that changes whenever the cloud, the views or the images do."""
        ...

    def load(self) -> Mesh:
        """Return the normalised mesh. Raises BadInput where the object has none."""
        ...

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Return `count` points, or all points of an object whose own cloud has fewer.

        Raises BadInput where no cloud can be had.
        """
        ...

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Return `count` views: drawn at random, or the object's own, which ignore `rng`.

        Raises BadInput for more views than an object of this kind can have. An object whose own
        views cannot be read returns stand-ins here and raises the reason in `truth`.
        """
        ...

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return true images [V, IMAGE_SIZE, IMAGE_SIZE, 3] from views that `views` returned.

        Raises BadInput where they cannot be had.
        """
        ...

    def cloud_and_truth(
        self, rng: np.random.Generator, views: Sequence[View]
    ) -> tuple[PointCloud, NDArray[np.uint8]]:
        """Return the results of `cloud` and `truth`, bit for bit, reading files once.

        Raises BadInput where one of them cannot be had.
        """
        ...


class MeshObject(ABC):
    """An object with a mesh: sampled, seen from random views, and rendered."""

    coloured_points: ClassVar[bool] = False  # whether points have the colours of their faces

    @property
    def has_truth(self) -> bool:
        """Return True: the mesh can be rendered."""
        return True

    @abstractmethod
    def load(self) -> Mesh:
        """Return the normalised mesh. Raises BadInput where it cannot be had."""

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Return points drawn uniformly by area."""
        return sample_surface(self.load(), rng, count, coloured=self.coloured_points)

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Return views drawn at random."""
        return random_views(count, rng)

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Render the mesh."""
        from data_prep.rendering.opengl import render

        return render(self.load(), views)

    def cloud_and_truth(
        self, rng: np.random.Generator, views: Sequence[View]
    ) -> tuple[PointCloud, NDArray[np.uint8]]:
        """Load the mesh once, sample and render it."""
        from data_prep.rendering.opengl import render

        mesh = self.load()
        return sample_surface(mesh, rng, coloured=self.coloured_points), render(mesh, views)


class StoredCloud(ABC):
    """An object with a cloud of its own, in a file."""

    @property
    def has_truth(self) -> bool:
        """Return True: the object has images, too."""
        return True

    @abstractmethod
    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Return the cloud, or a random subset of `count` of its points."""

    @abstractmethod
    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return the images of these views. Raises BadInput where one cannot be read."""

    def cloud_and_truth(
        self, rng: np.random.Generator, views: Sequence[View]
    ) -> tuple[PointCloud, NDArray[np.uint8]]:
        """Return the results of both."""
        return self.cloud(rng), self.truth(views)


def grey(mesh: Mesh) -> Mesh:
    """Return the mesh with all faces in NEUTRAL_GREY."""
    return in_one_colour(mesh, NEUTRAL_GREY)


def is_grey(mesh: Mesh) -> bool:
    """Return whether all faces of a mesh are in NEUTRAL_GREY."""
    return bool((mesh.face_colors[:, :3] == NEUTRAL_GREY).all())


@dataclass(frozen=True)
class RemadeObject(MeshObject):
    """An object whose mesh or cloud is made anew, with the names of the original.

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


class GreyObject(RemadeObject):
    """An object in neutral grey."""

    def fingerprint(self) -> str:
        """Return a text that differs from the fingerprint of the original."""
        return f"unpainted {self.original.fingerprint()}"  # part of the keys of finished work

    def load(self) -> Mesh:
        """Return the mesh of the original in grey."""
        return grey(self.original.load())


class TurnedObject(RemadeObject):
    """An object that is turned about the origin at random: it may stand on its head, or lie."""

    def fingerprint(self) -> str:
        """Return a text that differs from the fingerprint of the original."""
        return f"turned {self.original.fingerprint()}"  # part of the keys of finished work

    def load(self) -> Mesh:
        """Return the turned mesh of the original; any rotation is as likely as any other."""
        from scipy.spatial.transform import Rotation

        mesh = self.original.load()
        random = generator("turned", self.class_name, self.object_id)
        turn = Rotation.random(random_state=random).as_matrix()
        return replace(mesh, vertices=(mesh.vertices @ turn.T).astype(mesh.vertices.dtype))


class ColouredCloudObject(RemadeObject):
    """An object whose points have the colours of its faces."""

    coloured_points = True

    def fingerprint(self) -> str:
        """Return a text that differs from the fingerprint of the original."""
        return f"coloured cloud {self.original.fingerprint()}"  # part of the keys of finished work

    def load(self) -> Mesh:
        """Return the mesh of the original."""
        return self.original.load()

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Return the views of the original."""
        return self.original.views(count, rng)

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """Return the true images of the original."""
        return self.original.truth(views)
