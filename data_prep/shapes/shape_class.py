"""The procedural class of shapes, and one that draws its family first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from data_prep.clouds.normalise import normalise
from data_prep.scene import Mesh
from data_prep.shapes.random_choices import pick
from data_prep.shapes.solids import Part, join

Builder = Callable[[np.random.Generator], Sequence[Part]]


@dataclass(frozen=True)
class Drawn:
    """One object: its structural family, and the watertight solids that it is made of.

    The solids stand +Y up with the front towards -Z, in whatever unit the class is built in.
    """

    family: str
    parts: tuple[Part, ...]

    def mesh(self) -> Mesh:
        """Return the object as a mesh, normalised to the unit sphere."""
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


def shape_class(name: str, families: Mapping[str, tuple[float, Builder]]) -> ShapeClass:
    """Return a class that draws a family by its weight and then calls its builder."""
    weights = {family: weight for family, (weight, _) in families.items()}

    def draw(rng: np.random.Generator) -> Drawn:
        family = pick(rng, weights)
        _, build = families[family]
        return Drawn(family, tuple(build(rng)))

    return ShapeClass(name, tuple(families), draw)
