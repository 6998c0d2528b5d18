"""Small loudspeakers: of a desk, a shelf, a television. Metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.fronts import frame, panel
from data_prep.shapes.loudspeaker.drivers import Drivers, dome, draw_drivers, woofer
from data_prep.shapes.loudspeaker.living_room import cabinet_color
from data_prep.shapes.palettes import LOUDSPEAKER, shade
from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    hoop,
    lathe,
    moved,
    prism,
    rectangle,
    rounded,
    sections,
    slab,
)


def desktop(rng: np.random.Generator) -> list[Part]:
    """Return a satellite of a computer: an egg or a leaning wedge on a foot."""
    color = cabinet_color(rng, "desktop")
    drivers = draw_drivers(rng, color, 1)
    width = uniform(rng, (0.075, 0.115))
    height, depth = width * uniform(rng, (1.4, 2.6)), width * uniform(rng, (0.8, 1.2))
    step = 0.012 * height
    if chance(rng, 0.5):
        return _egg(rng, drivers, (width, height, depth), color, step)
    lean = math.radians(uniform(rng, (8.0, 20.0)))
    plan = rounded(rectangle(1, 1), 0.22, steps=3)
    body = slab(plan, (0, height / 2, 0), (width, height, depth), color, bevel=0.06 * width)
    parts = [body]
    if chance(rng, 0.4):
        plate = (0.84 * width, 0.88 * height, 4 * step)
        parts.append(
            panel((0, height / 2, -depth / 2), plate, drivers.cloth, corner=0.2 * width, bevel=step)
        )
    else:
        plate = (0.84 * width, 0.9 * height, 2.4 * step)
        parts.append(panel((0, height / 2, -depth / 2), plate, drivers.baffle, corner=0.1 * width))
        z = -depth / 2 - step
        big = min(0.36 * width, 0.23 * height)
        parts += woofer(drivers, (0, 0.08 * height + 1.05 * big, z), big, step)
        parts += dome(drivers, (0, 0.78 * height, z), min(0.22 * width, 0.14 * height), step)
    # Leaned, its lower edge at the rear sinks: it is raised to clear the desk, on a stem.
    low = 0.02 * height + 0.5 * depth * math.sin(lean)
    parts = [moved(part, (0, low, 0), tilt_rad=lean) for part in parts]
    profile = np.array([(0.62, -0.05), (0.62, 0.0), (0.40, 0.02), (0.30, 0.10)]) * (width, height)
    profile[-1, 1] += low
    foot = lathe(profile, drivers.baffle, sides=18)
    return [*parts, moved(foot, (0, 0, 0.1 * depth))]


def _egg(
    rng: np.random.Generator,
    drivers: Drivers,
    size: tuple[float, float, float],
    color: Color,
    step: float,
) -> list[Part]:
    """Return a shell of round section, with a driver in its flattened front."""
    width, height, _ = size
    bulge, steps = uniform(rng, (0.75, 1.25)), 9
    turn = np.linspace(-0.48, 0.48, steps)
    radii = 0.62 * width * np.cos(math.pi * turn) ** (0.6 * bulge) + 0.02 * width
    shell = lathe(np.stack([radii, height * (turn + 0.5)], axis=1), color, sides=18)
    flat = -0.36 * width
    points = shell.vertices.copy()
    points[:, 2] = np.maximum(points[:, 2], flat)  # the baffle
    foot = lathe(
        [(0.55 * width, -0.10 * height), (0.52 * width, -0.05 * height), (0.16 * width, 0.0),
         (0.14 * width, 0.12 * height)], drivers.baffle, sides=16,
    )  # fmt: skip
    radius = 0.34 * width
    return [
        Part(points, shell.faces, color),
        foot,
        *woofer(drivers, (0, 0.42 * height, flat), radius, step),
        *dome(drivers, (0, 0.42 * height + radius + 0.20 * width, flat), 0.14 * width, step),
    ]


def cylinder(rng: np.random.Generator) -> list[Part]:
    """Return a wireless speaker that plays all round: a drum in cloth between a foot and a cap."""
    radius = uniform(rng, (0.045, 0.085))
    height = radius * uniform(rng, (0.9, 5.0))
    cloth = shade(rng, LOUDSPEAKER["fabric"] if chance(rng, 0.8) else LOUDSPEAKER["black"])
    trim = shade(rng, LOUDSPEAKER["black"] if chance(rng, 0.6) else LOUDSPEAKER["gloss"])
    waist = uniform(rng, (0.86, 1.12))
    turn = np.linspace(0, 1, 7)
    radii = radius * (1 + (waist - 1) * np.sin(math.pi * turn))
    ends = radius * uniform(rng, (0.82, 0.98))
    low, high = 0.06 * height, 0.90 * height
    profile = np.stack([radii, low + (high - low) * turn], axis=1)
    drum = np.concatenate([[(ends, low - 0.03 * height)], profile, [(ends, high + 0.03 * height)]])
    parts = [lathe(drum, cloth, sides=20)]
    foot = [(0.80 * ends, 0.0), (0.86 * ends, 0.015 * height), (0.86 * ends, 0.08 * height)]
    parts.append(lathe(foot, trim, sides=20))
    dish = 0.93 * ends
    cap = [
        (dish, high),
        (dish, 0.97 * height),
        (0.88 * dish, 1.0 * height),
        (0.3 * dish, 0.985 * height),
    ]
    parts.append(lathe(cap, trim, sides=20))
    if chance(rng, 0.35):  # a ring of light
        light = shade(rng, ((70, 150, 210), (200, 200, 204), (90, 180, 130)))
        parts.append(hoop((0, 0.985 * height, 0), 0.86 * dish, 0.035 * radius, light))
    return parts


def soundbar(rng: np.random.Generator) -> list[Part]:
    """Return a long low bar: cloth between two ends, or a row of drivers."""
    length = uniform(rng, (0.60, 1.15))
    height, depth = uniform(rng, (0.060, 0.120)), uniform(rng, (0.070, 0.130))
    color = cabinet_color(rng, "soundbar")
    drivers = draw_drivers(rng, color, 1)
    step = 0.006 * length
    corner = 0.30 * min(height, depth)
    section = rounded(rectangle(depth, height), corner, steps=3)  # in (z, y)
    x, inset = np.array([(-0.5, 0.9), (-0.488, 1.0), (0.488, 1.0), (0.5, 0.9)]).T
    y, z = height / 2 + 0.012, -depth / 2
    parts = [prism(0, sections(section, [(0.0, y)], inset[:, None]), x * length, color)]
    inner = height - 1.6 * corner
    if chance(rng, 0.45):
        size = (0.90 * length, inner, 3 * step)
        parts.append(panel((0, y, z), size, drivers.cloth, corner=0.2 * inner))
        badge = (0.05 * length, 0.25 * inner, 2 * step)
        parts.append(panel((0, y, z - 1.6 * step), badge, drivers.cone))
    else:
        radius = 0.47 * inner
        for side in (-length, length):
            parts += woofer(drivers, (0.42 * side, y, z), radius, 0.6 * step)
            parts += dome(drivers, (0.32 * side, y, z), 0.8 * radius, 0.6 * step)
        size = (0.44 * length, 0.9 * inner, 2.4 * step)
        parts.append(frame((0, y, z), size, 0.14 * inner, drivers.baffle))
        parts.append(
            panel(
                (0, y, z + 0.3 * step),
                (size[0] - 0.1 * inner, size[1] - 0.1 * inner, 2 * step),
                drivers.cloth,
            )
        )
    for x in (-0.38 * length, 0.38 * length):
        parts.append(box((x, 0.012, 0), (0.09 * length, 0.024, 0.7 * depth), drivers.baffle))
    return parts
