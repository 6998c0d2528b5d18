"""Lamps that stand indoors, on the floor (y = 0) or on a table. Lengths are in metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.lamp.parts import (
    METAL,
    ball,
    bar_height,
    bowl,
    open_shade,
    rod,
    shaded_stem,
    tint,
    to_a_side,
)
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    curved_panel,
    fillet,
    lathe,
    moved,
    rectangle,
    slab,
    tube,
)

_FLOOR_KINDS = {"shaded": 0.32, "tripod": 0.16, "torchiere": 0.20, "arc": 0.20, "lantern": 0.12}


def _disc(radius: float, height: float, color: Color) -> Part:
    """Return a foot on the floor (y = 0), slightly conical."""
    return lathe([(radius, 0.0), (radius, 0.6 * height), (0.7 * radius, height)], color)


def _foot(rng: np.random.Generator, radius: float, height: float, color: Color) -> Part:
    """Return a round or a square foot."""
    if chance(rng, 0.7):
        return _disc(radius, height, color)
    return box((0, height / 2, 0), (1.8 * radius, height, 1.8 * radius), color)


def bedside(rng: np.random.Generator) -> list[Part]:
    """Return a body and a fabric shade on it."""
    body = pick(rng, {"vase": 0.34, "column": 0.30, "balls": 0.20, "block": 0.16})
    height, wide = uniform(rng, (0.16, 0.34)), uniform(rng, (0.05, 0.10))
    shade_radius = uniform(rng, (0.12, 0.21))
    color = tint(
        rng,
        {
            "vase": {"ceramic": 0.75, "brass": 0.25},
            "column": METAL | {"wood": 0.30},
            "balls": {"wood": 0.40, "ceramic": 0.35, "chrome": 0.25},
            "block": {"wood": 0.50, "ceramic": 0.50},
        }[body],
    )
    parts: list[Part] = []
    if body == "vase":
        belly = uniform(rng, (0.30, 0.62))
        t = np.linspace(0.0, 1.0, 8)
        swell = np.sin(np.pi * t ** (math.log(0.5) / math.log(belly)))
        radii = wide * (uniform(rng, (0.25, 0.45)) * (1.2 - 0.6 * t) + 0.7 * swell)
        parts = [lathe(np.stack([radii, height * t], axis=1), color)]
    elif body == "column":
        column = 0.03 * uniform(rng, (0.3, 1.0))
        parts = [_foot(rng, wide, 0.02, color), rod(0.01, height, column, color)]
    elif body == "balls":
        count = int(rng.integers(2, 5))
        radius = (height - 0.02) / (1.85 * count)
        parts = [_foot(rng, max(0.8 * radius, 0.05), 0.02, color)]
        parts += [
            ball((0, 0.018 + radius * (0.9 + 1.8 * k), 0), radius, color) for k in range(count)
        ]
        parts.append(rod(0.01, height, 0.26 * radius, color))
    else:
        outline = rectangle(1.0, 1.0)
        size = (1.5 * wide, height, uniform(rng, (0.9, 1.5)) * wide)
        parts = [slab(outline, (0, height / 2, 0), size, color, bevel=0.006)]
    stem = tint(rng, METAL)
    low = height + shade_radius * uniform(rng, (-0.15, 0.45))
    return parts + shaded_stem(rng, height - 0.02, low, shade_radius, stem)


def floor(rng: np.random.Generator) -> list[Part]:
    """Return a lamp as tall as a person: shade on pole or tripod, bowl, bow, or paper lantern."""
    kind = pick(rng, _FLOOR_KINDS)
    height = uniform(rng, (1.05, 1.55))
    metal, pole = tint(rng, METAL), uniform(rng, (0.010, 0.020))
    if kind == "arc":
        return to_a_side(rng, _arc(rng, height, pole, metal))
    if kind == "tripod":
        color = tint(rng, {"wood": 0.7, "dark-metal": 0.3})
        reach = uniform(rng, (0.24, 0.36))
        parts = [lathe([(0.04, height - 0.06), (0.05, height)], color, sides=10)]
        for angle in np.radians([-90, 30, 150]):
            way = np.array([math.cos(angle), 0.0, math.sin(angle)])
            head = 0.02 * way + (0, height - 0.03, 0)
            parts.append(tube([reach * way, head], 1.1 * pole, color, sides=6))
        return parts + shaded_stem(rng, height - 0.03, height, uniform(rng, (0.18, 0.28)), metal)
    foot = _foot(rng, uniform(rng, (0.12, 0.18)), 0.035, metal)
    if kind == "lantern":  # almost all of it is shade
        radius, low = uniform(rng, (0.10, 0.17)), uniform(rng, (0.06, 0.25))
        y, paper = (low, low + 0.8 * height), tint(rng, {"linen": 0.9, "amber": 0.1})
        sides = pick(rng, {4: 0.6, 16: 0.4})
        walls = open_shade((radius, radius), y, paper, sides=sides, waist=1.0)
        return [foot, rod(0.02, bar_height(y) + 0.01, pole, metal), *walls]
    if kind == "torchiere":
        radius = uniform(rng, (0.13, 0.22))
        glass = tint(rng, {"milk-glass": 0.55, "amber": 0.20, "dark-metal": 0.25})
        depth = radius * uniform(rng, (0.4, 0.8))
        cup = moved(bowl(radius, depth, glass, curve=0.6), (0, height, 0), tilt_rad=math.pi)
        return [foot, rod(0.02, height + 0.03 * radius, pole, metal), cup]
    low = height + uniform(rng, (-0.05, 0.05))
    stem = shaded_stem(rng, height - 0.03, low, uniform(rng, (0.16, 0.27)), metal)
    return [foot, rod(0.02, height, pole, metal), *stem]


def _arc(rng: np.random.Generator, height: float, pole: float, metal: Color) -> list[Part]:
    """Return a dome that hangs from a bow, far out from its foot, towards -z."""
    # A quarter of an ellipse after the upright part, and a little more, so that the end hangs.
    straight, reach = uniform(rng, (0.5, 0.8)) * height, uniform(rng, (0.35, 0.6))
    angle = np.linspace(0.0, uniform(rng, (2.0, 2.5)), 10)
    bend = np.zeros((11, 3))
    bend[0, 1] = 0.02
    bend[1:, 1] = straight + (1.25 * height - straight) * np.sin(angle)
    bend[1:, 2] = -reach * (1 - np.cos(angle))
    radius = uniform(rng, (0.12, 0.20))
    dome = bowl(radius, 0.75 * radius, tint(rng, METAL | {"milk-glass": 0.3}), curve=0.5)
    hung = moved(dome, bend[-1] + (0, 0.02 * radius, 0))
    big = _foot(rng, 0.20, 0.05, metal)
    return [big, tube(bend, pole, metal, sides=8), hung]


def desk(rng: np.random.Generator) -> list[Part]:
    """Return a reflector on a jointed arm or a gooseneck, or a trough across a column."""
    kind = pick(rng, {"arm": 0.52, "gooseneck": 0.26, "banker": 0.22})
    if kind == "banker":
        return to_a_side(rng, _banker(rng))
    color = tint(rng, {"dark-metal": 0.35, "chrome": 0.25, "plastic": 0.25, "paint": 0.15})
    foot = _foot(rng, uniform(rng, (0.07, 0.11)), 0.025, color)
    thick = uniform(rng, (0.006, 0.011))
    radius = uniform(rng, (0.05, 0.085))
    depth = radius * uniform(rng, (1.0, 1.7))
    if kind == "arm":
        lower, upper = uniform(rng, (0.20, 0.36)), uniform(rng, (0.20, 0.36))
        lean, rise = uniform(rng, (-0.1, 0.6)), uniform(rng, (-0.15, 0.75))
        base = np.array([0.0, 0.012, 0.0])
        elbow = base + lower * np.array([0.0, math.cos(lean), math.sin(lean)])
        wrist = elbow + upper * np.array([0.0, math.sin(rise), -math.cos(rise)])
        parts = [
            tube([base, elbow], thick, color, sides=6),
            tube([elbow, wrist], thick, color, sides=6),
            ball(elbow, 1.7 * thick, color, sides=8),
            ball(wrist, 1.7 * thick, color, sides=8),
        ]
    else:
        height, reach = uniform(rng, (0.26, 0.40)), uniform(rng, (0.16, 0.30))
        path = [(0, 0.012, 0), (0, height, 0), (0, height, -reach), (0, 0.72 * height, -reach)]
        path = fillet(path, 0.45 * min(reach, 0.28 * height), 4)
        wrist = path[-1]
        parts = [tube(path, thick, color, sides=7)]
    shell = color if chance(rng, 0.6) else tint(rng, {"plastic": 0.6, "chrome": 0.4})
    tilt_rad = uniform(rng, (0.1, 0.8))
    head = bowl(radius, depth, shell, apex=0.35, curve=pick(rng, {1.0: 0.6, 0.6: 0.4}))
    bulb = ball((0, -0.45 * depth, 0), 0.45 * radius, tint(rng, {"milk-glass": 1.0}), sides=8)
    socket = rod(-0.4 * depth, 0.02 * radius, 0.2 * radius, color)
    parts += [moved(part, wrist, tilt_rad=tilt_rad) for part in (head, socket, bulb)]
    return to_a_side(rng, [foot, *parts])


def _banker(rng: np.random.Generator) -> list[Part]:
    """Return a trough of glass across a column."""
    metal = tint(rng, {"brass": 0.7, "dark-metal": 0.3})
    glass = tint(rng, {"dyed": 0.7, "milk-glass": 0.3})
    height, length = uniform(rng, (0.26, 0.36)), uniform(rng, (0.12, 0.19))
    thickness = 0.014
    trough = curved_panel(uniform(rng, (0.06, 0.09)), 1.35, thickness, -length, length, glass)
    tray = box((0, 0.012, 0), (0.13, 0.024, uniform(rng, (0.13, 0.22))), metal)
    return [
        tray,
        rod(0.01, height, 0.009, metal),
        ball((0, 0.4 * height, 0), 0.03, metal),
        moved(trough, (0, height, 0), tilt_rad=-math.pi / 2),
        tube([(0, height - 0.03, -0.7 * length), (0, height - 0.03, 0.7 * length)], 0.012, metal),
    ]
