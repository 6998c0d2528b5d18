"""What an object of a dataset gives: a cloud, the views it is seen from, and its true images.

Most objects are meshes, from which all three are made. One that comes with clouds and images
(`paper:PATH`) gives its own; a bare cloud has no true images, so it can be drawn but not scored.
An object is a small value that crosses process boundaries; files are read where they are needed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import random_views, sample_surface
from data_prep.scene import CLOUD_SIZE, Mesh, PointCloud, View

Split = Literal["train", "validation", "test", "sealed", "novel-families"]


class SceneObject(Protocol):
    """One object of a dataset."""

    @property
    def class_name(self) -> str:
        """The class it belongs to."""
        ...

    @property
    def object_id(self) -> str:
        """Unique within its class."""
        ...

    @property
    def has_truth(self) -> bool:
        """Whether there is anything that images of it can be scored against."""
        ...

    def fingerprint(self) -> str:
        """Changes whenever what it gives does."""
        ...

    def load(self) -> Mesh:
        """The normalised mesh. Raises BadInput where there is none to be had."""
        ...

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """`count` points; an object that comes with a cloud gives no more than there are.

        Raises BadInput where there is no cloud to be had.
        """
        ...

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """`count` cameras: drawn at random, or the object's own, which need no random numbers.

        Raises BadInput where more are asked for than the kind of object can have. An object whose
        own views cannot be read gives stand-ins here, and the reason in `truth`.
        """
        ...

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """True images [V, IMAGE_SIZE, IMAGE_SIZE, 3] from views that `views` gave.

        Raises BadInput where there are none to be had.
        """
        ...

    def cloud_and_truth(
        self, rng: np.random.Generator, views: Sequence[View]
    ) -> tuple[PointCloud, NDArray[np.uint8]]:
        """What `cloud` and `truth` give, bit for bit, for who needs both: files are read once.

        Raises BadInput where one of them is not to be had.
        """
        ...


class MeshObject(ABC):
    """An object with a mesh: sampled, seen from random views, and rendered."""

    @property
    def has_truth(self) -> bool:
        """Yes: its mesh, rendered."""
        return True

    @abstractmethod
    def load(self) -> Mesh:
        """The normalised mesh. Raises BadInput where there is none to be had."""

    def cloud(self, rng: np.random.Generator, count: int = CLOUD_SIZE) -> PointCloud:
        """Points drawn uniformly by area."""
        return sample_surface(self.load(), rng, count)

    def views(self, count: int, rng: np.random.Generator) -> tuple[View, ...]:
        """Views drawn at random."""
        return random_views(count, rng)

    def truth(self, views: Sequence[View]) -> NDArray[np.uint8]:
        """The mesh, rendered."""
        from data_prep.rendering.opengl import render

        return render(self.load(), views)

    def cloud_and_truth(
        self, rng: np.random.Generator, views: Sequence[View]
    ) -> tuple[PointCloud, NDArray[np.uint8]]:
        """The mesh, loaded once, sampled and rendered."""
        from data_prep.rendering.opengl import render

        mesh = self.load()
        return sample_surface(mesh, rng), render(mesh, views)
