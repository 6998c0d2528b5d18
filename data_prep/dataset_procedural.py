"""The embedded default: parametric shapes, seeded, unlimited in number; nothing to download."""

from __future__ import annotations

from dataclasses import dataclass

from data_prep.dataset import Dataset
from data_prep.orientations import OURS
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.scene_objects import MeshObject, Split
from data_prep.shapes.catalogue import CLASSES

PROCEDURAL_VERSION = 1  # raise when a shape changes: finished work is then done again


@dataclass(frozen=True)
class ProceduralObject(MeshObject):
    """Number `index` of a split. The splits share no random numbers, hence no object."""

    class_name: str
    split: Split
    index: int

    @property
    def object_id(self) -> str:
        """For example "test-0007"."""
        return f"{self.split}-{self.index:04d}"

    def fingerprint(self) -> str:
        """Class, number and version of the procedure."""
        return f"procedural-{PROCEDURAL_VERSION}/{self.class_name}/{self.object_id}"

    def load(self) -> Mesh:
        """Draw the object."""
        rng = generator("procedural", self.class_name, self.split, self.index)
        return CLASSES[self.class_name].draw(rng).mesh()


def procedural_dataset(spec: str, measured: Split) -> Dataset:
    """All classes of the catalogue."""
    return Dataset(
        spec,
        tuple(CLASSES),
        None,
        measured=measured,
        layout="parametric shapes, as many as one asks for",
        orientation=OURS.message,
        endless=ProceduralObject,
    )
