"""Procedural loudspeakers: boxes with round drivers, and other things that sound."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.loudspeaker.living_room import bookshelf, stand, tower
from data_prep.shapes.loudspeaker.small import cylinder, desktop, soundbar
from data_prep.shapes.loudspeaker.stage import stage
from data_prep.shapes.shape_class import Drawn, ShapeClass

FAMILY_WEIGHTS = {
    "bookshelf": 0.30,
    "tower": 0.26,
    "stand": 0.10,
    "stage": 0.13,
    "desktop": 0.08,
    "cylinder": 0.07,
    "soundbar": 0.06,
}
FAMILIES = tuple(FAMILY_WEIGHTS)

_BUILD = {
    "bookshelf": bookshelf,
    "tower": tower,
    "stand": stand,
    "stage": stage,
    "desktop": desktop,
    "cylinder": cylinder,
    "soundbar": soundbar,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(_BUILD[family](rng)))


CLASS = ShapeClass("loudspeaker", FAMILIES, _draw)
