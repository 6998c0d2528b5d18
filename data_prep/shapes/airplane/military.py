"""Fighters and flying wings."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.airplane.parts import Wing, upright_fin
from data_prep.shapes.hulls import blade, mirrored, pair, spindle
from data_prep.shapes.palettes import AIRPLANE, shade, shades
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, rectangle, sweep


def fighter(rng: np.random.Generator) -> list[Part]:
    """Return a pointed body between intakes: trapezoid, delta or swept wing, one fin or two."""
    body, glass, dark = shades(rng, AIRPLANE, "military", "glass", "dark")
    wings = body if chance(rng, 0.7) else shade(rng, (body,))
    shape = pick(rng, {"trapezoid": 0.45, "delta": 0.3, "swept": 0.25})
    twin = chance(rng, 0.5 if shape == "trapezoid" else 0.2)
    width = uniform(rng, (0.062, 0.085)) if twin else uniform(rng, (0.045, 0.062))
    height = uniform(rng, (0.042, 0.055))
    nose = spindle(
        [
            (-0.5, -0.2 * height, 0.005, 0.005),
            (-0.43, -0.15 * height, 0.020, 0.020),
            (-0.30, 0.0, 0.036, 0.040),
            (-0.14, 0.0, 0.8 * width, height),
            (0.10, 0.0, width, height),
            (0.34, 0.0, 0.92 * width, 0.9 * height),
            (0.46, 0.0, 0.8 * width, 0.72 * height),
        ],
        body,
    )
    canopy_y = 0.75 * height
    canopy = spindle(
        [
            (-0.345, canopy_y - 0.018, 0.010, 0.008),
            (-0.29, canopy_y, 0.025, 0.028),
            (-0.22, canopy_y + 0.006, 0.027, 0.034),
            (-0.08, canopy_y, 0.012, 0.014),
        ],
        glass,
        sides=10,
    )
    parts = [nose, canopy]
    intake = rectangle(0.55 * width, 1.3 * height)
    parts += pair(sweep([(0.85 * width, -0.25 * height, z) for z in (-0.18, 0.22)], intake, body))
    parts += pair(
        box((0.85 * width, -0.25 * height, -0.165), (0.4 * width, 1.0 * height, 0.044), dark)
    )
    root, tip, sweep_range, half_span, z = {
        "trapezoid": ((0.34, 0.44), (0.08, 0.14), (0.7, 1.0), (0.30, 0.40), -0.10),
        "delta": ((0.48, 0.58), (0.03, 0.06), (1.15, 1.5), (0.28, 0.36), -0.16),
        "swept": ((0.24, 0.32), (0.09, 0.13), (0.7, 1.1), (0.32, 0.44), -0.08),
    }[shape]
    wing = Wing(
        half_span=uniform(rng, half_span),
        root=uniform(rng, root),
        tip=uniform(rng, tip),
        y=uniform(rng, (-0.3, 0.35)) * height,
        z=z,
        sweep=uniform(rng, sweep_range),
        dihedral=uniform(rng, (-0.06, 0.04)),
        thickness=0.045,
    )
    parts.append(wing.part(wings))
    small = Wing(
        half_span=uniform(rng, (0.17, 0.23)),
        root=0.17,
        tip=uniform(rng, (0.05, 0.08)),
        y=0.1 * height,
        z=0.30,
        sweep=uniform(rng, (0.7, 1.0)),
        thickness=0.06,
    )
    if shape != "delta":
        parts.append(small.part(wings))
    elif chance(rng, 0.5):  # a canard
        fore = Wing(0.15, 0.12, 0.04, 0.35 * height, -0.26, 0.8, 0.08, thickness=0.06)
        parts.append(fore.part(wings))
    fin_height, fin_sweep = uniform(rng, (0.12, 0.17)), uniform(rng, (0.7, 1.0))
    if twin:
        lean = uniform(rng, (0.0, 0.05))
        foot = (0.75 * width, 0.2 * height, 0.22)
        parts += pair(upright_fin(foot, fin_height + 0.03, (0.19, 0.07), fin_sweep, wings, lean))
    else:
        parts.append(
            upright_fin((0, 0.3 * height, 0.17), fin_height + 0.05, (0.25, 0.07), 0.95, wings)
        )
    engines = (-0.42 * width, 0.42 * width) if twin else (0.0,)
    radius = 0.62 * height if twin else 0.8 * height
    for x in engines:
        nozzle = [(0.40, 0.0, radius, radius), (0.5, 0.0, 0.8 * radius, 0.8 * radius)]
        parts.append(spindle(nozzle, dark, x=x, sides=10))
    return [*parts, *(_missiles(rng, wing, wings) if chance(rng, 0.6) else [])]


def _missiles(rng: np.random.Generator, wing: Wing, pylons: Color) -> list[Part]:
    """Return missiles on the tips of the wing, or hung from it."""
    parts = []
    store = shade(rng, AIRPLANE["white"]) if chance(rng, 0.5) else shade(rng, AIRPLANE["dark"])
    places = [1.0] if chance(rng, 0.4) else [0.5, 0.75][: 1 + int(rng.integers(2))]
    for place in places:
        x, y, z = wing.at(place * wing.half_span, 0.5)
        below = 0.0 if place == 1.0 else 0.026
        stations = [(-0.10, 0.003), (-0.075, 0.010), (0.07, 0.010), (0.09, 0.006)]
        missile = spindle([(z + dz, y - below, t, t) for dz, t in stations], store, x=x, sides=8)
        parts += pair(missile)
        if below:
            parts += pair(box((x, y - below / 2, z), (0.006, below, 0.06), pylons))
    return parts


def flying_wing(rng: np.random.Generator) -> list[Part]:
    """Return a swept wing and nothing else, but for humps over its engines."""
    body, glass, dark = shades(rng, AIRPLANE, "stealth", "glass", "dark")
    half_span, sweep_back = uniform(rng, (0.75, 1.0)), uniform(rng, (0.55, 0.75))
    root, tip = uniform(rng, (0.42, 0.52)), uniform(rng, (0.08, 0.12))
    notch = uniform(rng, (0.18, 0.30)) * half_span
    # The trailing edge is a saw: it runs back from the middle, forward, and back to the tips.
    half = [
        (0.0, root, 0.15),
        (notch, root - 0.5 * notch - sweep_back * notch, 0.10),
        (0.5 * half_span, uniform(rng, (0.15, 0.22)), 0.06),
        (half_span, tip, 0.012),
    ]
    stations = [
        (x, 0.0, -0.3 + sweep_back * x, max(chord, tip), 0.5 * thick) for x, chord, thick in half
    ]
    left = [(-x, *rest) for x, *rest in stations[:0:-1]]
    hump = [
        (-0.24, 0.01, 0.02, 0.015),
        (-0.12, 0.02, 0.075, 0.050),
        (0.02, 0.02, 0.075, 0.045),
        (0.16, 0.005, 0.02, 0.012),
    ]
    cockpit = [(-0.20, 0.035, 0.02, 0.012), (-0.14, 0.05, 0.042, 0.028), (-0.08, 0.045, 0.04, 0.02)]
    pod = [(-0.08, 0.025, 0.030, 0.010), (-0.04, 0.025, 0.040, 0.030), (0.10, 0.01, 0.03, 0.012)]
    x = uniform(rng, (0.12, 0.17))
    engine = spindle(pod, body, x=x, sides=8)
    intake = box((x, 0.036, -0.07), (0.05, 0.020, 0.044), dark)
    parts = [blade([*left, *stations], body), spindle(hump, body), spindle(cockpit, glass, sides=8)]
    parts += [engine, mirrored(engine), *pair(intake)]
    if chance(rng, 0.35):  # a pair of fins at the back
        foot = (0.3 * half_span, 0.0, -0.3 + 0.3 * half_span * sweep_back + 0.03)
        parts += pair(
            upright_fin(foot, uniform(rng, (0.10, 0.14)), (0.13, 0.06), 0.7, body, lean=0.03)
        )
    return parts
