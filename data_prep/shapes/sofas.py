"""Procedural sofas: of one to four seats, the seat open towards -Z."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.sofa.bodies import draw_box_arm, draw_rolled_arm, draw_sectional
from data_prep.shapes.sofa.frames import draw_armless, draw_curved, draw_open_frame
from data_prep.shapes.solids import Part

FAMILY_WEIGHTS = {
    "box-arm": 0.40,
    "rolled-arm": 0.17,
    "sectional": 0.15,
    "open-frame": 0.11,
    "armless": 0.08,
    "curved": 0.09,
}
FAMILIES = tuple(FAMILY_WEIGHTS)

_DRAW: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "box-arm": draw_box_arm,
    "rolled-arm": draw_rolled_arm,
    "sectional": draw_sectional,
    "open-frame": draw_open_frame,
    "armless": draw_armless,
    "curved": draw_curved,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(_DRAW[family](rng)))


CLASS = ShapeClass("sofa", FAMILIES, _draw)
