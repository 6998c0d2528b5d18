"""Procedural benches to sit on: in parks, halls, churches and waiting rooms. The front is -Z.

The module is not called `benches`: the package `bench` is the benchmark.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_prep.shapes.chances import pick
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.sitting_bench.indoor import draw_pew, draw_row, draw_settle
from data_prep.shapes.sitting_bench.outdoor import draw_park, draw_picnic, draw_plank
from data_prep.shapes.solids import Part

FAMILY_WEIGHTS = {
    "park": 0.30,
    "settle": 0.20,
    "plank": 0.20,
    "pew": 0.11,
    "picnic": 0.08,
    "row": 0.11,
}
FAMILIES = tuple(FAMILY_WEIGHTS)

_DRAW: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "park": draw_park,
    "settle": draw_settle,
    "plank": draw_plank,
    "pew": draw_pew,
    "picnic": draw_picnic,
    "row": draw_row,
}


def _draw(rng: np.random.Generator) -> Drawn:
    family = pick(rng, FAMILY_WEIGHTS)
    return Drawn(family, tuple(_DRAW[family](rng)))


CLASS = ShapeClass("bench", FAMILIES, _draw)
