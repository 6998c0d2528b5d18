"""Lamp posts. Lengths are in metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.lamp.parts import ball, tint, to_a_side
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    fillet,
    lathe,
    post,
    rectangle,
    slab,
    tube,
    turned,
)

_IRON = {"cast-iron": 0.85, "galvanised": 0.15}


def lamp_post(rng: np.random.Generator) -> list[Part]:
    """Return a pole with a lantern, with globes, or with flat heads on long arms."""
    head = pick(rng, {"cobra": 0.36, "lantern": 0.34, "globes": 0.30})
    height = uniform(rng, (3.0, 4.6)) + (1.6 if head == "cobra" else 0.0)
    metal = tint(rng, {"galvanised": 0.8, "cast-iron": 0.2} if head == "cobra" else _IRON)
    glass = tint(rng, {"milk-glass": 0.75, "amber": 0.25})
    foot, thin = uniform(rng, (0.08, 0.12)), uniform(rng, (0.045, 0.06))
    plinth = uniform(rng, (0.3, 0.8))
    pole = lathe(
        [(1.9 * foot, 0), (1.6 * foot, 0.15), (foot, plinth), (thin, plinth + 0.1), (thin, height)],
        metal,
        sides=10,
    )
    if head == "lantern" and chance(rng, 0.7):
        return [pole, *_lantern((0.0, height, 0.0), uniform(rng, (0.20, 0.30)), metal, glass)]
    sides = pick(rng, {1: 0.6, 2: 0.4} if head == "cobra" else {2: 0.6, 3: 0.4})
    reach = uniform(rng, (0.7, 1.7)) if head == "cobra" else uniform(rng, (0.35, 0.6))
    parts = [pole]
    for k in range(sides):
        yaw_rad = 2 * math.pi * k / sides
        parts += [turned(part, yaw_rad) for part in _arm(head, height, reach, metal, glass)]
    if head == "globes" and chance(rng, 0.5):
        parts.append(ball((0, height + 0.16, 0), 0.2, glass))
    return to_a_side(rng, parts)


def _arm(head: str, height: float, reach: float, metal: Color, glass: Color) -> list[Part]:
    """Return one arm of a lamp post, towards -z, with its light."""
    if head == "cobra":
        path: Floats = np.array(
            [(0, height - 0.5, 0), (0, height, -0.12), (0, height + 0.25, -reach)]
        )
        along = fillet(path, 0.35, 4)
        # A flat head: seen from the side long and low, with the lit glass let into it from below.
        outline = np.array([(-0.6, -1), (0.6, -1), (1, -0.3), (0.8, 1), (-0.8, 1), (-1, -0.3)]) / 2
        y = height + 0.27
        return [
            tube(along, 0.045, metal, sides=7),
            slab(outline, (0, y, -reach - 0.22), (0.28, 0.14, 0.65), metal, bevel=0.04),
            slab(outline, (0, y - 0.07, -reach - 0.28), (0.18, 0.07, 0.40), glass),
        ]
    path = np.array([(0, height - 0.35, 0), (0, height - 0.42, -reach), (0, height - 0.12, -reach)])
    bent = tube(fillet(path, 0.13, 3), 0.03, metal, sides=6)
    end = (0.0, height - 0.13, -reach)
    if head == "lantern":
        return [bent, *_lantern(end, 0.2, metal, glass)]
    return [bent, ball((0.0, height + 0.04, -reach), 0.19, glass)]


def _lantern(
    foot: tuple[float, float, float], half: float, metal: Color, glass: Color
) -> list[Part]:
    """Return tapered panes between a cup and a roof, standing on `foot`."""
    x, y, z = foot

    def at(rise: float) -> tuple[float, float, float]:
        return x, y + rise * half, z

    def square(share: float) -> Floats:
        return rectangle(2 * share * half, 2 * share * half)

    corners = [
        post(
            (x + 0.52 * sx * half, y + 0.1 * half, z + 0.52 * sz * half),
            (x + 0.93 * sx * half, y + 2.25 * half, z + 0.93 * sz * half),
            square(0.07),
            square(0.07),
            metal,
        )
        for sx in (-1, 1)
        for sz in (-1, 1)
    ]
    return [
        post(at(-0.15), at(0.25), square(0.25), square(0.6), metal),
        post(at(0.15), at(2.2), square(0.5), square(0.9), glass),
        post(at(2.15), at(2.95), square(1.15), square(0.25), metal),
        ball(at(3.05), 0.18 * half, metal, sides=6),
        *corners,
    ]
