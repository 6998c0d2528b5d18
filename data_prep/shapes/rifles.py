"""Procedural rifles and other long guns: a thin barrel, and a silhouette that tells them apart.

The muzzle points towards -Z.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.rifle.automatic import assault, bullpup, machine_gun, submachine
from data_prep.shapes.rifle.long_guns import bolt_action, shotgun, sniper
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.solids import Part

FAMILY_WEIGHTS: dict[str, float] = {
    "assault": 0.30,
    "bolt-action": 0.18,
    "sniper": 0.14,
    "shotgun": 0.13,
    "submachine": 0.11,
    "machine-gun": 0.07,
    "bullpup": 0.07,
}

_BUILD: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "assault": assault,
    "bolt-action": bolt_action,
    "sniper": sniper,
    "shotgun": shotgun,
    "submachine": submachine,
    "machine-gun": machine_gun,
    "bullpup": bullpup,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(_BUILD[family](rng)))


CLASS = ShapeClass("rifle", tuple(FAMILY_WEIGHTS), _draw)
