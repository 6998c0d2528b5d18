"""What a procedural class is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data_prep.normalise import normalise
from data_prep.scene import Mesh
from data_prep.shapes.solids import Part, join


@dataclass(frozen=True)
class Drawn:
    """One object: its structural family, and the watertight solids that it is made of.

    The solids stand +Y up with the front towards -Z, in whatever unit the class is built in.
    """

    family: str
    parts: tuple[Part, ...]

    def mesh(self) -> Mesh:
        """The object as a mesh, normalised to the unit sphere."""
        return normalise(join(self.parts))


@dataclass(frozen=True)
class ShapeClass:
    """A class of objects that differ in structure, proportions and colours.

    families  structural families, in a fixed order
    draw      an object at random; equal streams give equal objects
    """

    name: str
    families: tuple[str, ...]
    draw: Callable[[np.random.Generator], Drawn]
