"""The embedded default dataset: parametric shapes, seeded and unlimited in number."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import ClassVar

import numpy as np

from data_prep.clouds.orientations import OURS
from data_prep.datasets.dataset import Dataset
from data_prep.datasets.objects import MeshObject, Split
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES, NOVEL_CLASSES

# A part of the keys of finished work. Raise it when a shape changes, so that work is done again.
PROCEDURAL_VERSION = 1
# A part of the seed of the sealed split, so that nobody comes across its objects by chance.
_SALT = "41ec20ecc29a5c5a3390005bfa849f81"


@dataclass(frozen=True)
class ProceduralObject(MeshObject):
    """Object number `index` of a split.

    The splits share no random numbers, and so no object. The sealed split has other objects in each
    version of the protocol. The objects of `novel-families` are of structural families that no
    other split has.
    """

    class_name: str
    split: Split
    index: int

    @property
    def object_id(self) -> str:
        """Return an id such as "test-0007", or "sealed-1-0007" with the version of the protocol."""
        version = f"{PROTOCOL_VERSION}-" if self.split == "sealed" else ""
        return f"{self.split}-{version}{self.index:04d}"

    def fingerprint(self) -> str:
        """Return class, number and version of the procedure."""
        return f"procedural-{PROCEDURAL_VERSION}/{self.class_name}/{self.object_id}"

    def random_numbers(self) -> np.random.Generator:
        """Return a new stream of the random numbers that decide the object."""
        seal = (PROTOCOL_VERSION, _SALT) if self.split == "sealed" else ()
        return generator("procedural", self.class_name, self.split, self.index, *seal)

    def load(self) -> Mesh:
        """Draw the object."""
        shapes = NOVEL_CLASSES if self.split == "novel-families" else CLASSES
        return shapes[self.class_name].draw(self.random_numbers()).mesh()


@dataclass(frozen=True)
class _ForTraining(MeshObject):
    """Object number `index` of shapes that only trainings see."""

    class_name: str
    index: int
    kind: ClassVar[str]
    # The module in data_prep.shapes and its function; they are imported where an object is drawn.
    draw: ClassVar[str]

    @property
    def object_id(self) -> str:
        """Return an id such as "widened-00007"."""
        return f"{self.kind}-{self.index:05d}"

    def fingerprint(self) -> str:
        """Return class, number and version of the procedure."""
        return f"procedural-{PROCEDURAL_VERSION}/{self.class_name}/{self.object_id}"

    def random_numbers(self) -> np.random.Generator:
        """Return a new stream of the random numbers that decide the object."""
        return generator("procedural", self.class_name, self.kind, self.index)

    def load(self) -> Mesh:
        """Draw the object."""
        module, _, function = self.draw.partition(".")
        draw = getattr(import_module(f"data_prep.shapes.{module}"), function)
        return draw(CLASSES[self.class_name], self.random_numbers())[0]


class WidenedObject(_ForTraining):
    """An object of the shapes that vary more than a class (`data_prep.shapes.augmentation`)."""

    kind, draw = "widened", "augmentation.draw_widened"


class ReliefObject(_ForTraining):
    """An object of the shapes that have relief (`data_prep.shapes.relief`)."""

    kind, draw = "relief", "relief.draw_relief"


def _drawn(of_train: type[_ForTraining], class_name: str, split: Split, index: int) -> MeshObject:
    if split == "train":
        return of_train(class_name, index)
    return ProceduralObject(class_name, split, index)


def training_dataset(spec: str, of_train: type[_ForTraining]) -> Dataset:
    """Return all classes of the catalogue with the shapes of `of_train` as their train split.

    That split is also the one that is taken by default.
    """
    return replace(procedural_dataset(spec, "train"), infinite=partial(_drawn, of_train))


def procedural_dataset(spec: str, measured: Split) -> Dataset:
    """Return all classes of the catalogue; for the split of novel families, the classes with any.

    measured  the split that is taken by default
    """
    return Dataset(
        spec,
        tuple(NOVEL_CLASSES if measured == "novel-families" else CLASSES),
        None,
        measured=measured,
        layout="parametric shapes, as many as one asks for",
        orientation=OURS.message,
        infinite=ProceduralObject,
    )
