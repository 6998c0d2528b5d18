"""Procedural lamps: the class that varies most, much of it thin rods.

Lamps have no front: those with an arm hold it out to any of four sides; a sconce's wall is at +Z.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.lamp.hung import chandelier, pendant, sconce
from data_prep.shapes.lamp.standing import bedside, desk, floor
from data_prep.shapes.lamp.street import lamp_post
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.solids import Part

FAMILY_WEIGHTS: dict[str, float] = {
    "bedside": 0.24,
    "floor": 0.18,
    "pendant": 0.17,
    "desk": 0.14,
    "chandelier": 0.11,
    "post": 0.09,
    "sconce": 0.07,
}

_BUILD: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "bedside": bedside,
    "floor": floor,
    "pendant": pendant,
    "desk": desk,
    "chandelier": chandelier,
    "post": lamp_post,
    "sconce": sconce,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(_BUILD[family](rng)))


CLASS = ShapeClass("lamp", tuple(FAMILY_WEIGHTS), _draw)
