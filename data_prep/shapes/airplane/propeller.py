"""Airplanes with propellers: light ones, warbirds, biplanes."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.airplane.parts import Wing, propeller_parts, undercarriage, upright_fin
from data_prep.shapes.hulls import pair, spindle
from data_prep.shapes.palettes import AIRPLANE, shade, shades
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Part, box, rectangle, slab, tube


def propeller_plane(rng: np.random.Generator) -> list[Part]:
    """Return a straight wing, high or low, with one propeller in the nose or one on each side."""
    warbird = chance(rng, 0.35)
    body = shade(rng, AIRPLANE["warbird"] if warbird else AIRPLANE["white"])
    accent = shade(rng, AIRPLANE["livery"])
    wings = body if chance(rng, 0.7) else shade(rng, AIRPLANE["grey"])
    glass, dark = shades(rng, AIRPLANE, "glass", "dark")
    high, twin = not warbird and chance(rng, 0.6), chance(rng, 0.3)
    w, h = uniform(rng, (0.060, 0.080)), uniform(rng, (0.070, 0.095))
    wide = uniform(rng, (0.55, 0.66)) if twin else uniform(rng, (0.52, 0.70))
    fuselage = spindle(
        [
            (-0.5, -0.1 * h, 0.3 * w, 0.3 * h) if twin else (-0.5, -0.1 * h, 0.75 * w, 0.62 * h),
            (-0.46, -0.1 * h, 0.7 * w, 0.6 * h) if twin else (-0.44, -0.1 * h, 0.9 * w, 0.8 * h),
            (-0.26, 0.0, w, 0.9 * h),
            (-0.14, 0.05 * h, w, h),
            (0.06, 0.05 * h, 0.92 * w, 0.9 * h),
            (0.30, 0.25 * h, 0.46 * w, 0.46 * h),
            (0.5, 0.4 * h, 0.10 * w, 0.24 * h),
        ],
        body,
    )
    wing = Wing(
        half_span=wide,
        root=uniform(rng, (0.17, 0.22)),
        tip=uniform(rng, (0.08, 0.16)),
        y=0.95 * h if high else -0.62 * h,
        z=-0.24 if high else -0.22,
        sweep=uniform(rng, (0.0, 0.08)),
        dihedral=uniform(rng, (0.01, 0.04)) if high else uniform(rng, (0.05, 0.11)),
        thickness=0.12,
    )
    tail = Wing(
        half_span=uniform(rng, (0.17, 0.22)),
        root=0.13,
        tip=uniform(rng, (0.06, 0.10)),
        y=0.42 * h,
        z=0.36,
        sweep=uniform(rng, (0.1, 0.35)),
    )
    fin_color = pick(rng, {accent: 0.5, body: 0.5})
    parts = [fuselage, wing.part(wings), tail.part(wings)]
    fin_height = uniform(rng, (0.13, 0.18))
    parts.append(upright_fin((0, 0.4 * h, 0.31), fin_height, (0.18, 0.08), 0.55, fin_color))
    if high:  # a cabin between the body and the wing above it, glazed all round
        cabin = slab(rectangle(1, 1), (0, 0.72 * h, -0.13), (1.7 * w, 0.5 * h, 0.24), glass)
        roof = slab(rectangle(1, 1), (0, 0.98 * h, -0.115), (1.5 * w, 0.14 * h, 0.23), body)
        parts += [cabin, roof]
    else:
        bubble = [(-0.24, 0.7, 0.3), (-0.17, 0.7, 0.7), (-0.05, 0.68, 0.66), (0.10, 0.4, 0.2)]
        parts.append(spindle([(z, 0.75 * h, a * w, b * h) for z, a, b in bubble], glass, sides=10))
    blades, phase = int(rng.integers(2, 5)), uniform(rng, (0.0, math.pi))
    spinner = pick(rng, {accent: 0.5, dark: 0.5})
    if twin:
        x = uniform(rng, (0.28, 0.36)) * wide
        (_, middle, z), (*_, rear) = wing.at(x), wing.at(x, 0.7)
        y = middle - 0.22 * h
        pod = [
            (z - 0.12, y, 0.024, 0.024),
            (z - 0.09, y, 0.036, 0.036),
            (z + 0.06, y, 0.034, 0.036),
            (rear, middle, 0.005, 0.005),
        ]
        parts += pair(spindle(pod, accent if chance(rng, 0.4) else wings, x=x, sides=10))
        parts += pair(*propeller_parts((x, y, z - 0.13), 0.10, blades, phase, dark, spinner))
    else:
        centre = (0.0, -0.1 * h, -0.515)
        parts += propeller_parts(centre, uniform(rng, (0.13, 0.17)), blades, phase, dark, spinner)
    if high and not twin:
        x = 0.45 * wide
        foot, (_, y, z) = (0.8 * w, -0.3 * h, -0.17), wing.at(x, 0.35)
        parts += pair(tube([foot, (x, y, z)], 0.006, wings, sides=6))
    if not warbird and chance(rng, 0.7):  # the undercarriage stands out
        ground = -h - uniform(rng, (0.05, 0.08))
        places = [(uniform(rng, (0.12, 0.17)), ground, -0.12), (0.0, ground, -0.38)]
        parts += undercarriage(places, -0.4 * h, 0.030, body, dark)
    return parts


def biplane(rng: np.random.Generator) -> list[Part]:
    """Return a biplane: two wings joined by struts, an open cockpit, wheels."""
    body, dark = shades(rng, AIRPLANE, "stunt", "dark")
    wings = shade(rng, AIRPLANE["stunt"]) if chance(rng, 0.5) else body
    wood = shade(rng, "wood")
    w, h = uniform(rng, (0.060, 0.075)), uniform(rng, (0.070, 0.090))
    fuselage = spindle(
        [
            (-0.44, 0.0, 0.95 * w, 0.9 * h),
            (-0.15, 0.0, w, h),
            (0.05, 0.02 * h, 0.85 * w, 0.9 * h),
            (0.5, 0.2 * h, 0.12 * w, 0.25 * h),
        ],
        body,
    )
    engine = spindle([(-0.5, 0.0, 0.7 * w, 0.7 * h), (-0.47, 0.0, w, h), (-0.40, 0, w, h)], dark)
    half_span, chord = uniform(rng, (0.46, 0.60)), uniform(rng, (0.14, 0.18))
    gap, stagger = uniform(rng, (0.15, 0.20)), uniform(rng, (0.0, 0.06))
    low = Wing(0.94 * half_span, chord, 0.9 * chord, -0.75 * h, -0.28, 0.0, 0.04, thickness=0.08)
    top = Wing(
        half_span,
        chord,
        0.9 * chord,
        low.y + gap + 0.45 * h,
        -0.28 - stagger,
        0.0,
        0.04,
        thickness=0.08,
    )
    tail = Wing(uniform(rng, (0.17, 0.22)), 0.14, 0.09, 0.2 * h, 0.35, 0.25)
    parts = [fuselage, engine, low.part(wings), top.part(wings), tail.part(wings)]
    parts.append(
        upright_fin((0, 0.1 * h, 0.33), uniform(rng, (0.13, 0.17)), (0.17, 0.09), 0.4, wings)
    )
    for place in (0.72,) if chance(rng, 0.6) else (0.45, 0.8):
        for along in (0.25, 0.7):
            x = place * half_span
            parts += pair(tube([low.at(x, along), top.at(x, along)], 0.006, wood, sides=6))
    for along in (0.25, 0.7):
        _, y, z = top.at(0.12, along)
        parts += pair(tube([(0.6 * w, 0.4 * h, z), (0.09, y, z)], 0.006, wood, sides=6))
    seat = box((0, 0.85 * h, -0.06), (1.0 * w, 0.5 * h, 0.08), dark)
    screen = slab(rectangle(1, 1), (0, 1.0 * h, -0.115), (0.8 * w, 0.6 * h, 0.010), dark)
    parts += [seat, screen]
    phase = uniform(rng, (0.0, math.pi))
    parts += propeller_parts((0, 0, -0.515), uniform(rng, (0.14, 0.17)), 2, phase, wood, dark)
    ground = -h - uniform(rng, (0.06, 0.09))
    parts += undercarriage([(0.11, ground, -0.26)], -0.4 * h, 0.036, wood, dark)
    return parts
