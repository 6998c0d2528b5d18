"""Procedural telephones: thin slabs that stand upright, and boxes with a handset.

The screen and the keys look towards -Z.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.solids import Part
from data_prep.shapes.telephone.fixed import classic, cordless, desk
from data_prep.shapes.telephone.mobile import flip, keypad_phone, smartphone

FAMILY_WEIGHTS: dict[str, float] = {
    "smartphone": 0.34,
    "keypad": 0.22,
    "flip": 0.13,
    "cordless": 0.10,
    "desk": 0.14,
    "classic": 0.07,
}

_BUILD: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "smartphone": smartphone,
    "keypad": keypad_phone,
    "flip": flip,
    "cordless": cordless,
    "desk": desk,
    "classic": classic,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(_BUILD[family](rng)))


CLASS = ShapeClass("telephone", tuple(FAMILY_WEIGHTS), _draw)
