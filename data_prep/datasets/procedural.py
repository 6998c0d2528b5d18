"""The embedded default dataset: parametric shapes, seeded and unlimited in number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from data_prep.clouds.orientations import OURS
from data_prep.datasets.dataset import Dataset
from data_prep.datasets.objects import MeshObject, Split
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES, NOVEL_CLASSES

PROCEDURAL_VERSION = 1  # raise when a shape changes: finished work is then done again
_SALT = "41ec20ecc29a5c5a3390005bfa849f81"  # of the sealed split


@dataclass(frozen=True)
class ProceduralObject(MeshObject):
    """Object `index` of a split. The splits share no random numbers, hence no object.

    The sealed split is another in each version of the protocol. The objects of `novel-families`
    are of structural families that no other split draws.
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
class WidenedObject(MeshObject):
    """Object `index` of the shapes for training that vary more than a class (`augmentation`)."""

    class_name: str
    index: int

    @property
    def object_id(self) -> str:
        """Return an id such as "widened-00007"."""
        return f"widened-{self.index:05d}"

    def fingerprint(self) -> str:
        """Return class, number and version of the procedure."""
        return f"procedural-{PROCEDURAL_VERSION}/{self.class_name}/{self.object_id}"

    def random_numbers(self) -> np.random.Generator:
        """Return a new stream of the random numbers that decide the object."""
        return generator("procedural", self.class_name, "widened", self.index)

    def load(self) -> Mesh:
        """Draw the object."""
        from data_prep.shapes.augmentation import draw_widened

        return draw_widened(CLASSES[self.class_name], self.random_numbers())[0]


@dataclass(frozen=True)
class ReliefObject(MeshObject):
    """Object `index` of the shapes for training that have relief (`data_prep.shapes.relief`)."""

    class_name: str
    index: int

    @property
    def object_id(self) -> str:
        """Return an id such as "relief-00007"."""
        return f"relief-{self.index:05d}"

    def fingerprint(self) -> str:
        """Return class, number and version of the procedure."""
        return f"procedural-{PROCEDURAL_VERSION}/{self.class_name}/{self.object_id}"

    def random_numbers(self) -> np.random.Generator:
        """Return a new stream of the random numbers that decide the object."""
        return generator("procedural", self.class_name, "relief", self.index)

    def load(self) -> Mesh:
        """Draw the object."""
        from data_prep.shapes.relief import draw_relief

        return draw_relief(CLASSES[self.class_name], self.random_numbers())[0]


def _widened(class_name: str, split: Split, index: int) -> MeshObject:
    """Return a widened object of the train split, or an object of `procedural` of another split."""
    if split == "train":
        return WidenedObject(class_name, index)
    return ProceduralObject(class_name, split, index)


def _relief(class_name: str, split: Split, index: int) -> MeshObject:
    """Return an object with relief of the train split, or one of `procedural` of another split."""
    if split == "train":
        return ReliefObject(class_name, index)
    return ProceduralObject(class_name, split, index)


def relief_dataset(spec: str) -> Dataset:
    """Return all classes of the catalogue with a train split with relief, which is measured."""
    return replace(procedural_dataset(spec, "train"), infinite=_relief)


def widened_dataset(spec: str) -> Dataset:
    """Return all classes of the catalogue with a widened train split, which is measured."""
    return replace(procedural_dataset(spec, "train"), infinite=_widened)


def procedural_dataset(spec: str, measured: Split) -> Dataset:
    """Return all classes of the catalogue, or the classes with novel families for that split."""
    return Dataset(
        spec,
        tuple(NOVEL_CLASSES if measured == "novel-families" else CLASSES),
        None,
        measured=measured,
        layout="parametric shapes, as many as one asks for",
        orientation=OURS.message,
        infinite=ProceduralObject,
    )
