"""Procedural airplanes: thin wings on slim bodies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.airplane.airliners import airliner, rear_engine_jet, supersonic
from data_prep.shapes.airplane.military import fighter, flying_wing
from data_prep.shapes.airplane.propeller import biplane, propeller_plane
from data_prep.shapes.chances import pick
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.solids import Part

FAMILY_WEIGHTS = {
    "airliner": 0.40,
    "rear-engine-jet": 0.14,
    "fighter": 0.20,
    "propeller": 0.13,
    "biplane": 0.05,
    "supersonic": 0.04,
    "flying-wing": 0.04,
}
BUILDERS: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "airliner": airliner,
    "rear-engine-jet": rear_engine_jet,
    "fighter": fighter,
    "propeller": propeller_plane,
    "biplane": biplane,
    "supersonic": supersonic,
    "flying-wing": flying_wing,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(BUILDERS[family](rng)))


CLASS = ShapeClass("airplane", tuple(FAMILY_WEIGHTS), _draw)
