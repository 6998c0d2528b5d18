"""Kitchens: runs of base units under a worktop, straight or round a corner. Metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.cabinet.parts import Field, Finish, darker, doors, draw_finish, drawers
from data_prep.shapes.palettes import CABINET, shade
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Part, box, fillet, moved, rectangle, slab, tube, turned

_KICK = 0.10  # height of the recessed plinth


def kitchen(rng: np.random.Generator) -> list[Part]:
    """Return a run of units along the wall.

    There may be a second one round the corner, wall units, or a tall unit.
    """
    kind = pick(rng, {"straight": 0.30, "corner": 0.30, "wall-units": 0.25, "tall": 0.15})
    units = int(rng.integers(3, 6)) if kind != "straight" else int(rng.integers(2, 5))
    unit, depth, height = (uniform(rng, r) for r in ((0.42, 0.62), (0.55, 0.64), (0.82, 0.92)))
    length = units * unit
    body = shade(rng, "lacquer" if chance(rng, 0.6) else "wood")
    tall = 2.05 if kind in ("wall-units", "tall") else height
    finish = draw_finish(rng, body, (length, tall, depth))
    stone = shade(rng, CABINET["stone"] if chance(rng, 0.65) else "wood")
    side = 1.0 if chance(rng, 0.5) else -1.0
    # At the corner, fronts end where those of the wing would be in their way.
    hidden = depth + 0.07 if kind == "corner" else 0.0
    fronts = units - 1 if kind == "corner" else units
    parts = _run(rng, finish, (length, height, depth), fronts, side * hidden)
    parts.append(_worktop(length, depth, height, stone))
    if chance(rng, 0.6):
        parts += _sink(finish, (uniform(rng, (-0.2, 0.2)) * length, height, 0.0))
    rear = depth / 2
    if kind == "corner":
        second = int(rng.integers(2, 4))
        wing = _run(rng, finish, (second * unit, height, depth), second, -side * 0.10)
        wing.append(_worktop(second * unit, depth, height + 0.006, stone))
        # The wing's rear is at the end of the first run; it begins inside that run.
        centre = (side * (length / 2 - rear - 0.02), 0.0, -depth / 2 - second * unit / 2 + 0.05)
        parts += [moved(turned(part, side * math.pi / 2), centre) for part in wing]
    elif kind == "wall-units":
        low, top, shallow = uniform(rng, (1.35, 1.50)), uniform(rng, (1.95, 2.25)), 0.34
        colour = darker(shade(rng, CABINET["stone"]), 0.95)
        middle, high = (height - 0.05 + top - 0.04) / 2, top - 0.04 - height + 0.05
        parts.append(box((0, middle, rear - 0.035), (0.985 * length, high, 0.03), colour))
        wide = length if chance(rng, 0.6) else length - unit
        x = side * (length - wide) / 2
        z = rear - shallow / 2 - 0.012
        parts.append(box((x, (low + top) / 2, z), (wide, top - low, shallow), body))
        field = Field(x - wide / 2, x + wide / 2, low, top, z - shallow / 2)
        parts += doors(finish, field, max(2, round(wide / unit)))
    elif kind == "tall":
        top, x = uniform(rng, (1.95, 2.20)), side * (length / 2 + unit / 2 - 0.01)
        parts.append(box((x, top / 2, 0), (unit, top, depth), body))
        field = Field(x - unit / 2, x + unit / 2, _KICK, top - 0.01, -depth / 2)
        below, above = field.split([1], [1, uniform(rng, (1.0, 1.8))])
        parts += doors(finish, below, 1) + doors(finish, above, 1)
    return parts


def _run(
    rng: np.random.Generator,
    finish: Finish,
    size: tuple[float, float, float],
    units: int,
    hidden: float,
) -> list[Part]:
    """Return base units of this length, height and depth, without a worktop.

    `hidden` metres of the front stay closed: at the +X end, or at the other where it is negative.
    """
    length, height, depth = size
    kick = box(
        (0, _KICK / 2 + 0.01, 0.05), (length - 0.03, _KICK + 0.02, depth - 0.12), finish.seam
    )
    body = box((0, (_KICK + height) / 2, 0), (length, height - _KICK, depth), finish.body)
    x_low, x_high = -length / 2 + max(0.0, -hidden), length / 2 - max(0.0, hidden)
    whole = Field(x_low, x_high, _KICK, height - 0.015, -depth / 2)
    parts = [kick, body]
    for field in whole.split([1] * units, [1]):
        what = pick(rng, {"doors": 0.5, "drawers": 0.3, "both": 0.2})
        if what == "doors":
            parts += doors(finish, field, 1)
        elif what == "drawers":
            parts += drawers(finish, field, [1.2, 1, 0.6])
        else:
            below, above = field.split([1], [3, 1])
            parts += doors(finish, below, 1) + drawers(finish, above, [1])
    return parts


def _worktop(length: float, depth: float, height: float, color: tuple[int, int, int]) -> Part:
    size = (length + 0.03, 0.045, depth + 0.035)
    return slab(rectangle(1, 1), (0, height + 0.012, -0.026), size, color, bevel=0.006)


def _sink(finish: Finish, place: tuple[float, float, float]) -> list[Part]:
    """Return a basin's rim and its tap, on a worktop."""
    x, y, z = place
    top = y + 0.034
    basin = slab(rectangle(1, 1), (x, top, z - 0.02), (0.50, 0.024, 0.36), finish.trim, bevel=0.006)
    inside = slab(rectangle(1, 1), (x, top + 0.010, z - 0.04), (0.42, 0.024, 0.26), finish.seam)
    path = fillet(
        [(x, top - 0.01, z + 0.14), (x, top + 0.28, z + 0.14), (x, top + 0.28, z - 0.04),
         (x, top + 0.20, z - 0.04)], 0.035, 3,
    )  # fmt: skip
    return [basin, inside, tube(path, 0.014, finish.trim, sides=6)]
