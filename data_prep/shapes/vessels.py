"""Procedural vessels: smooth hulls, and what tells them apart on deck."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.solids import Part
from data_prep.shapes.vessel.boats import motor_yacht, open_boat
from data_prep.shapes.vessel.merchant import cargo_ship, passenger_ship
from data_prep.shapes.vessel.sailing import sailing_yacht, tall_ship
from data_prep.shapes.vessel.warships import submarine, warship

FAMILY_WEIGHTS = {
    "cargo-ship": 0.22,
    "warship": 0.20,
    "sailing-yacht": 0.15,
    "motor-yacht": 0.13,
    "passenger-ship": 0.10,
    "tall-ship": 0.08,
    "open-boat": 0.07,
    "submarine": 0.05,
}
BUILDERS: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "cargo-ship": cargo_ship,
    "warship": warship,
    "sailing-yacht": sailing_yacht,
    "motor-yacht": motor_yacht,
    "passenger-ship": passenger_ship,
    "tall-ship": tall_ship,
    "open-boat": open_boat,
    "submarine": submarine,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(BUILDERS[family](rng)))


CLASS = ShapeClass("vessel", tuple(FAMILY_WEIGHTS), _draw)
