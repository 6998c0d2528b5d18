"""Lamps that hang from a ceiling or on a wall. Lengths are in metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.lamp.parts import METAL, ball, bowl, fabric_shade, rod, shaded_stem, tint
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, fillet, hoop, lathe, moved, tube


def pendant(rng: np.random.Generator) -> list[Part]:
    """Return one light on a cord, or three in a row."""
    form = pick(rng, {"dome": 0.28, "cone": 0.20, "globe": 0.22, "fabric": 0.30})
    count = pick(rng, {1: 0.70, 3: 0.30})
    metal = tint(rng, METAL)
    radius = uniform(rng, (0.13, 0.22)) / (1.0 if count == 1 else 1.4)
    drop = uniform(rng, (0.12, 0.9))
    glass = tint(rng, {"milk-glass": 0.70, "amber": 0.30})
    enamel = tint(rng, {"plastic": 0.30, "dark-metal": 0.30, "chrome": 0.15, "brass": 0.25})
    depth = radius * uniform(rng, (0.6, 1.2))

    def hung(x: float, y: float) -> list[Part]:
        """Return the light on the end of its cord, whose upper end is at the height 0."""
        if form == "fabric":
            lit, held_y = fabric_shade(rng, radius, 0.0)
            lit = [moved(part, (x, y - held_y, 0)) for part in lit]
            end = y - 0.01
        elif form == "globe":
            lit, end = [ball((x, y - radius, 0), radius, glass, sides=14)], y - 0.05 * radius
        else:
            shape = bowl(radius, depth, enamel, apex=0.12, curve=1.0 if form == "cone" else 0.45)
            bulb = ball((x, y - 0.42 * depth, 0), 0.32 * radius, glass)
            stalk = moved(rod(-0.4 * depth, 0.05 * radius, 0.12 * radius, metal), (x, y, 0))
            lit, end = [moved(shape, (x, y, 0)), stalk, bulb], y - 0.02 * radius
        cord = moved(rod(end, -0.01, 0.007, metal), (x, 0, 0))
        return [cord, *lit]

    if count == 1:
        canopy = lathe([(0.06, 0.0), (0.06, -0.015), (0.03, -0.035)], metal)
        return [canopy, *hung(0.0, -drop)]
    spread = 2.6 * radius
    bar = box((0, -0.012, 0), (2 * spread + 0.06, 0.03, 0.05), metal)
    drops = drop * np.array([1.0, uniform(rng, (0.7, 1.3)), 1.0])
    ends = zip((-spread, 0.0, spread), drops, strict=True)
    return [bar, *(part for x, length in ends for part in hung(x, -length))]


def chandelier(rng: np.random.Generator) -> list[Part]:
    """Return four to seven lights on arms about a turned column, or on a wheel."""
    metal = tint(rng, {"brass": 0.50, "dark-metal": 0.35, "chrome": 0.15})
    light = pick(rng, {"candles": 0.45, "cups": 0.30, "shades": 0.25})
    glass = tint(rng, {"milk-glass": 0.6, "amber": 0.2, "linen": 0.2})
    arms, reach = int(rng.integers(4, 8)), uniform(rng, (0.28, 0.46))
    sag, drop = uniform(rng, (0.06, 0.16)), uniform(rng, (0.25, 0.7))
    canopy = lathe([(0.07, drop), (0.07, drop - 0.02), (0.02, drop - 0.05)], metal, sides=12)
    parts = [canopy, rod(-0.06, drop - 0.03, 0.010, metal)]
    if chance(rng, 0.3):
        parts += _wheel(rng, arms, reach, metal)
    else:
        belly = uniform(rng, (0.035, 0.07))
        turning = [(0.015, -0.14), (belly, -0.10), (0.02, -0.03), (0.7 * belly, 0.03), (0.012, 0.1)]
        parts.append(lathe(turning, metal, sides=10))
        path = np.array([(0.01, -0.08), (0.45 * reach, -0.08 - sag), (reach, -0.08 - 0.5 * sag)])
        path = np.array([*path, (reach, 0.03)])
        for angle in 2 * math.pi / arms * np.arange(arms):
            course = np.zeros((4, 3))
            course[:, 0], course[:, 2] = np.outer([math.cos(angle), math.sin(angle)], path[:, 0])
            course[:, 1] = path[:, 1]
            arm = fillet(course, 0.45 * min(0.03 + 0.5 * sag + 0.08, 0.45 * reach), 3)
            parts.append(tube(arm, 0.009, metal, sides=5))
    size = min(0.065, 0.8 * reach * math.sin(math.pi / arms))
    for angle in 2 * math.pi / arms * np.arange(arms):
        end = (reach * math.cos(angle), 0.02, reach * math.sin(angle))
        parts += [moved(part, end) for part in _candle(light, size, metal, glass)]
    return parts


def _wheel(rng: np.random.Generator, arms: int, reach: float, metal: Color) -> list[Part]:
    """Return a hoop hung from the rod by as many stays as it has lights."""
    top = uniform(rng, (0.12, 0.22))
    ring = hoop((0, 0, 0), reach, 0.026, metal, steps=4 * arms)
    stays = [
        tube(
            [(0, top, 0), (reach * math.cos(angle), 0.0, reach * math.sin(angle))],
            0.006,
            metal,
            sides=5,
        )
        for angle in 2 * math.pi / arms * np.arange(arms)
    ]
    return [ring, *stays, rod(-0.06, top + 0.02, 0.014, metal)]


def _candle(light: str, size: float, metal: Color, glass: Color) -> list[Part]:
    """Return one light of a chandelier, standing on the origin or hanging from it."""
    if light == "cups":  # bowls that open upwards
        cup = bowl(size, 1.1 * size, glass, apex=0.35, curve=0.7, sides=8)
        return [moved(cup, (0, -0.004, 0), tilt_rad=math.pi)]
    pan = lathe([(0.012, -0.012), (0.55 * size, 0.0), (0.55 * size, 0.008)], metal, sides=8)
    tall = 1.6 * size
    stick = lathe([(0.012, 0.0), (0.012, tall)], glass, sides=6)
    if light == "candles":
        flame = [(0.007, tall - 0.01), (0.016, tall + 0.02), (0.003, tall + 0.06)]
        return [pan, stick, lathe(flame, (226, 196, 120), sides=6)]
    shade_y = np.array([0.7, 0.7, 1.9]) * size
    cone = np.stack([np.array([0.75, 0.95, 0.45]) * size, shade_y], axis=1)
    return [pan, stick, lathe([(0.010, shade_y[0] + 0.004), *cone], glass, sides=10)]


def sconce(rng: np.random.Generator) -> list[Part]:
    """Return one or two lights on a plate, whose wall is behind it, at +Z."""
    light = pick(rng, {"fabric": 0.34, "cup": 0.28, "tube": 0.20, "globe": 0.18})
    metal = tint(rng, METAL)
    reach = uniform(rng, (0.12, 0.24))
    tall = uniform(rng, (0.10, 0.34))
    glass = tint(rng, {"milk-glass": 0.7, "amber": 0.3})
    if light == "tube":  # lit upwards and downwards, close to the wall
        half, radius = uniform(rng, (0.10, 0.20)), uniform(rng, (0.035, 0.06))
        profile = [(radius, -half), (radius, half)]
        ends = [(0.8 * radius, -half - 0.008), (0.8 * radius, half + 0.008)]
        z = -radius - 0.03
        return [
            box((0, 0, 0), (0.09, 0.6 * half, 0.02), metal),
            box((0, 0, z / 2), (0.03, 0.03, -z), metal),
            moved(lathe(profile, metal, sides=14), (0, 0, z)),
            moved(lathe(ends, glass, sides=14), (0, 0, z)),
        ]
    plate = box((0, 0, 0), (uniform(rng, (0.07, 0.12)), tall, 0.022), metal)
    lights = pick(rng, {1: 0.6, 2: 0.4})
    spread = uniform(rng, (0.11, 0.16)) if lights == 2 else 0.0
    radius = uniform(rng, (0.08, 0.13)) * (0.75 if lights == 2 else 1.0)
    if light == "fabric":
        fixed = shaded_stem(rng, -0.02, 0.02, radius, metal)
    elif light == "cup":
        cup = bowl(radius, 1.3 * radius, glass, apex=0.3, curve=0.7)
        fixed = [moved(cup, (0, -0.003, 0), tilt_rad=math.pi)]
    else:
        fixed = [ball((0, 0.85 * radius, 0), 0.9 * radius, glass, sides=12)]
    parts = [plate]
    for x in (-spread, spread)[:lights]:
        foot = -0.25 * tall
        path = [(0, foot, 0.0), (0.5 * x, foot - 0.04, -0.6 * reach), (x, foot - 0.03, -reach)]
        path = fillet([*path, (x, foot + 0.05, -reach)], 0.18 * reach, 3)
        parts.append(tube(path, 0.008, metal, sides=6))
        parts += [moved(part, (x, foot + 0.05, -reach)) for part in fixed]
    return parts
