"""Loudspeakers of a living room: a box with a baffle, on a shelf, the floor or a stand. Metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.fronts import panel
from data_prep.shapes.furniture import legs
from data_prep.shapes.loudspeaker.drivers import Drivers, dome, draw_drivers, port, woofer
from data_prep.shapes.palettes import LOUDSPEAKER, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    moved,
    polygon,
    post,
    rectangle,
    rounded,
    slab,
)

_CABINET_WEIGHTS = {
    "bookshelf": {"wood": 0.48, "black": 0.37, "gloss": 0.15},
    "tower": {"wood": 0.45, "black": 0.38, "gloss": 0.17},
    "stand": {"wood": 0.50, "black": 0.35, "gloss": 0.15},
    "stage": {"black": 0.94, "gloss": 0.06},
    "desktop": {"black": 0.55, "gloss": 0.45},
    "soundbar": {"black": 0.80, "gloss": 0.20},
}


def cabinet_color(rng: np.random.Generator, family: str) -> Color:
    """Return veneer, black or painted, as often as in the family."""
    return shade_of(rng, _CABINET_WEIGHTS[family], LOUDSPEAKER)


def cabinet(plan: Floats, size: tuple[float, float, float], low: float, color: Color) -> Part:
    """Return a box of a plan [n, 2] (x, z) of unit size, with its underside at `low`."""
    width, height, depth = size
    bevel = 0.012 * min(size)
    return slab(plan, (0, low + height / 2, 0), (width, height, depth), color, bevel=bevel)


def plan_of(kind: str) -> Floats:
    """Return the plan of a cabinet, x and z within +-0.5, the baffle at z = -0.5."""
    if kind == "box":
        return rectangle(1, 1)
    if kind == "tapered":  # trapezium, narrower behind
        return np.array([(0.5, -0.5), (0.32, 0.5), (-0.32, 0.5), (-0.5, -0.5)])
    # A lute: sides that curve inwards to a narrow rear.
    turn = np.linspace(0.0, 1.0, 7)
    right = np.stack([0.5 - 0.34 * turn**2.2, turn - 0.5], axis=1)
    return np.concatenate([right, right[::-1] * (-1, 1)])


def baffle(
    drivers: Drivers, size: tuple[float, float, float], low: float, *, grille: bool
) -> list[Part]:
    """Return the front of a cabinet: a plate with drivers, or a cloth before it.

    The size is (width, height, depth).

    Drivers sit one above the other, the tweeter near the top.
    """
    width, height, depth = size
    z, step = -depth / 2, 0.006 * math.hypot(*size)
    middle = low + height / 2
    if grille:
        plate = (0.92 * width, 0.94 * height, 5 * step)
        corner = 0.06 * width
        return [panel((0, middle, z), plate, drivers.cloth, corner=corner, bevel=step)]
    plate = (0.94 * width, height - 0.06 * width, 2.4 * step)
    parts = [panel((0, middle, z), plate, drivers.baffle)]
    z -= step
    biggest = 0.42 * width
    # From the top: the tweeter, then the woofers, then the port, as far as there is room.
    tweeter = drivers.tweeter * width
    sizes = [tweeter, *([biggest * drivers.woofer] * drivers.woofers)]
    if drivers.port:
        sizes.append(0.15 * width)
    taken = 2 * sum(sizes)
    room = height - 0.10 * width - taken
    if room < 0.0:
        sizes = [radius * (height - 0.14 * width) / taken for radius in sizes]
        room = 0.04 * width
    gap = min(room / (len(sizes) + 1), 0.10 * width)
    y = low + height - 0.05 * width - (room - gap * (len(sizes) - 1)) * drivers.drop
    for k, radius in enumerate(sizes):
        y -= radius
        centre = (0.0, y, z)
        if k == 0:
            parts += dome(drivers, centre, radius, step)
        elif k <= drivers.woofers:
            parts += woofer(drivers, centre, radius, step)
        else:
            parts += port(drivers, centre, radius, step)
        y -= radius + gap
    return parts


def _feet(x: float, z: float, height: float, color: Color) -> list[Part]:
    """Return four cones under a cabinet."""
    head, foot = polygon(8, 0.5 * height), polygon(8, 0.2 * height)
    return legs(x, z, 1.25 * height, foot, head, color)


def bookshelf(rng: np.random.Generator) -> list[Part]:
    """Return a small box, or a subwoofer on feet."""
    width = uniform(rng, (0.15, 0.28))
    size = (width, width * uniform(rng, (1.1, 2.0)), width * uniform(rng, (0.85, 1.45)))
    plan = plan_of(pick(rng, {"box": 0.72, "tapered": 0.12, "lute": 0.16}))
    color = cabinet_color(rng, "bookshelf")
    count = pick(rng, {1: 0.8, 2: 0.2}) if size[1] > 1.5 * width else 1
    drivers = draw_drivers(rng, color, count)
    parts = [cabinet(plan, size, 0.0, color)]
    if chance(rng, 0.15):  # a subwoofer: one large driver fires forwards
        size = (1.4 * width, 1.35 * width, 1.5 * width)
        low = 0.12 * width
        parts = [cabinet(rectangle(1, 1), size, low, color)]
        step = 0.006 * math.hypot(*size)
        centre = (0.0, low + size[1] / 2, -size[2] / 2)
        parts += woofer(drivers, centre, 0.40 * size[1], step)
        return parts + _feet(0.4 * size[0], 0.4 * size[2], low, drivers.baffle)
    return parts + baffle(drivers, size, 0.0, grille=chance(rng, 0.14))


def tower(rng: np.random.Generator) -> list[Part]:
    """Return a tall box on a plinth or on cones, perhaps leaning back."""
    width = uniform(rng, (0.17, 0.30))
    size = (width, uniform(rng, (0.80, 1.35)), width * uniform(rng, (1.0, 1.7)))
    plan = plan_of(pick(rng, {"box": 0.58, "tapered": 0.14, "lute": 0.28}))
    color = cabinet_color(rng, "tower")
    drivers = draw_drivers(rng, color, pick(rng, {1: 0.15, 2: 0.35, 3: 0.32, 4: 0.18}))
    low = uniform(rng, (0.03, 0.07))
    parts = [cabinet(plan, size, low, color)]
    if chance(rng, 0.55):  # a plinth wider than the cabinet
        plate = (1.18 * width, low + 0.006, 1.08 * size[2])
        parts.append(
            slab(rectangle(1, 1), (0, plate[1] / 2, 0), plate, drivers.baffle, bevel=0.008)
        )
    else:
        parts += _feet(0.26 * width, 0.42 * size[2], low, drivers.baffle)
    parts += baffle(drivers, size, low, grille=chance(rng, 0.16))
    lean = math.radians(uniform(rng, (2.0, 7.0))) if chance(rng, 0.25) else 0.0
    return [moved(part, (0, 0, 0), tilt_rad=lean) for part in parts]


def stand(rng: np.random.Generator) -> list[Part]:
    """Return a small cabinet on a column."""
    width = uniform(rng, (0.17, 0.26))
    size = (width, width * uniform(rng, (1.3, 1.9)), width * uniform(rng, (0.9, 1.4)))
    low = uniform(rng, (0.50, 0.80))
    color = cabinet_color(rng, "stand")
    drivers = draw_drivers(rng, color, 1)
    metal = shade_of(rng, {"dark-metal": 0.75, "chrome": 0.25})
    parts = [cabinet(plan_of(pick(rng, {"box": 0.75, "lute": 0.25})), size, low, color)]
    parts += baffle(drivers, size, low, grille=chance(rng, 0.1))
    shelf = (0.94 * width, 0.02, 0.86 * size[2])
    parts.append(box((0, low - 0.004, 0), shelf, metal))
    spread = uniform(rng, (1.15, 1.6))
    base = (spread * width, uniform(rng, (0.02, 0.04)), spread * max(width, 0.8 * size[2]))
    round_base = chance(rng, 0.35)
    outline = polygon(20, 0.5) if round_base else rounded(rectangle(1, 1), 0.1, steps=2)
    parts.append(slab(outline, (0, base[1] / 2, 0), base, metal, bevel=0.006))
    thick = uniform(rng, (0.025, 0.07))
    columns = {1: (0.0,), 2: (-0.26 * width, 0.26 * width)}[pick(rng, {1: 0.65, 2: 0.35})]
    for x in columns:
        section = polygon(10, thick / 2) if round_base else rectangle(thick, thick)
        parts.append(post((x, base[1] / 2, 0), (x, low, 0), section, section, metal))
    return parts
