"""Rifles and shotguns with a long barrel on a stock. Lengths are in metres; see `parts`."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.rifle.parts import (
    bipod,
    front_sight,
    handle,
    magazine,
    pipe,
    scope,
    stock,
    tint,
    trigger,
)
from data_prep.shapes.solids import Part, box, moved, tube


def bolt_action(rng: np.random.Generator) -> list[Part]:
    """Return a hunting rifle or carbine: one stock from the butt to the fore-end, a bolt."""
    wood = tint(rng, {"walnut": 0.88, "polymer": 0.12})
    metal = tint(rng, {"gunmetal": 0.75, "steel": 0.25})
    length, drop = uniform(rng, (0.30, 0.36)), uniform(rng, (0.10, 0.14))
    muzzle = -uniform(rng, (0.55, 0.85))
    full = chance(rng, 0.35)  # the fore-end reaches almost to the muzzle
    fore = (muzzle + 0.06) if full else -uniform(rng, (0.30, 0.42))
    fall = uniform(rng, (0.015, 0.04))
    bore = uniform(rng, (0.008, 0.011))
    stations = [
        (length, -drop - 0.01, -fall, 0.042),
        (0.55 * length, -0.55 * drop - 0.035, -0.8 * fall, 0.040),
        (0.08, -0.052, -0.4 * fall, 0.032),
        (0.02, -0.048, 0.004, 0.040),
        (-0.12, -0.046, 0.004, 0.044),
        (0.5 * fore - 0.06, -0.034, 0.002, 0.038),
        (fore, -0.024, 0.000, 0.028),
    ]
    butt = [
        (length - 0.006, -drop - 0.014, 0.004 - fall, 0.046),
        (length + 0.012, -drop - 0.012, 0.002 - fall, 0.044),
    ]
    knob = (0.055, -0.012, 0.035)
    parts = [
        stock(stations, wood),
        stock(butt, metal),
        pipe([(bore, -0.1), (0.85 * bore, muzzle)], metal, y=0.010, sides=8),
        pipe([(0.015, 0.06), (0.017, 0.03), (0.017, -0.14), (bore, -0.18)], metal, y=0.012),
        tube([(0, 0.012, 0.035), knob], 0.005, metal, sides=5),
        moved(pipe([(0.005, -0.009), (0.010, 0.0), (0.005, 0.009)], metal, sides=6), knob),
        *trigger(-0.047, -0.03, 0.05, metal),
    ]
    if chance(rng, 0.45):
        parts += scope(0.058, 0.018, 0.05, uniform(rng, (0.24, 0.32)), metal)
    else:
        parts.append(moved(front_sight(muzzle + 0.03, 0.035, metal), (0, 0.008, 0)))
        parts.append(box((0, 0.024, -0.2), (0.016, 0.026, 0.05), metal))
    if chance(rng, 0.35):
        parts.append(magazine((-0.04, -0.065), uniform(rng, (0.04, 0.07)), 0.0, 0.07, 0.026, metal))
    if full:
        bands = np.linspace(0.45 * fore, fore + 0.02, 3)
        parts += [
            stock([(z, -0.037, 0.022, 0.040), (z - 0.016, -0.036, 0.022, 0.039)], metal)
            for z in bands
        ]
    return parts


def sniper(rng: np.random.Generator) -> list[Part]:
    """Return a rifle with a long barrel, a telescopic sight and mostly a bipod."""
    chassis = tint(rng, {"olive": 0.35, "polymer": 0.40, "tan": 0.25})
    metal = tint(rng, {"gunmetal": 1.0})
    muzzle = -uniform(rng, (0.75, 0.98))
    fore = -uniform(rng, (0.30, 0.40))
    bore = uniform(rng, (0.010, 0.013))
    length, drop = uniform(rng, (0.30, 0.36)), uniform(rng, (0.10, 0.13))
    parts = [
        stock(
            [
                (0.13, -0.048, -0.002, 0.036),
                (0.0, -0.052, 0.004, 0.044),
                (-0.16, -0.050, 0.004, 0.046),
                (fore, -0.036, -0.002, 0.042),
            ],
            chassis,
        ),
        pipe([(0.018, 0.08), (0.019, -0.16), (1.25 * bore, -0.19), (bore, muzzle)], metal, y=0.010),
        pipe([(1.7 * bore, muzzle + 0.05), (1.7 * bore, muzzle - 0.04)], metal, y=0.010, sides=8),
        handle((-0.035, 0.075), uniform(rng, (0.09, 0.11)), 0.035, 0.048, 0.032, chassis),
        *trigger(-0.047, -0.02, 0.06, metal),
        magazine((-0.04, -0.085), uniform(rng, (0.05, 0.09)), 0.0, 0.075, 0.028, metal),
        *scope(0.064, 0.020, 0.07, uniform(rng, (0.28, 0.38)), metal),
    ]
    if chance(rng, 0.75):
        lean = uniform(rng, (0.0, 0.06))
        parts += bipod(-0.030, fore + 0.03, uniform(rng, (0.18, 0.24)), lean, metal)
    if chance(rng, 0.5):  # a skeleton: two bars and a butt
        parts += [
            stock([(0.11, -0.034, 0.000, 0.030), (length, -0.030, -0.006, 0.030)], chassis),
            stock([(0.10, -0.046, -0.026, 0.026), (length, -drop, 0.024 - drop, 0.026)], chassis),
            stock(
                [
                    (length - 0.03, -drop - 0.012, 0.002, 0.038),
                    (length + 0.02, -drop - 0.012, 0.002, 0.040),
                ],
                metal,
            ),
        ]
    else:
        top = uniform(rng, (-0.004, 0.018))
        parts.append(
            stock(
                [
                    (0.11, -0.042, -0.006, 0.034),
                    (0.16, -0.050, top, 0.038),
                    (length - 0.04, -drop, top, 0.040),
                    (length, -drop, -0.006, 0.038),
                ],
                chassis,
            )
        )
    return parts


def shotgun(rng: np.random.Generator) -> list[Part]:
    """Return a pump-action, double-barrelled or lever-action shotgun."""
    kind = pick(rng, {"pump": 0.55, "double": 0.27, "lever": 0.18})
    wood = tint(rng, {"walnut": 0.45, "polymer": 0.55} if kind == "pump" else {"walnut": 1.0})
    metal = tint(rng, {"gunmetal": 0.85, "steel": 0.15})
    muzzle = -uniform(rng, (0.45, 0.75))
    bore = uniform(rng, (0.011, 0.014))
    parts = [
        stock(
            [
                (0.09, -0.034, 0.014, 0.034),
                (0.05, -0.042, 0.024, 0.040),
                (-0.12, -0.040, 0.024, 0.041),
            ],
            metal,
        )
    ]
    if kind == "double":
        for x in (-0.95 * bore, 0.95 * bore):
            parts.append(pipe([(1.1 * bore, -0.09), (bore, muzzle)], metal, x=x, y=0.006))
        fore = [
            (-0.10, -0.032, -0.001, 0.040),
            (-0.22, -0.030, -0.001, 0.044),
            (-0.34, -0.016, 0.000, 0.032),
        ]
        parts.append(stock(fore, wood))
    else:
        below = -1.95 * bore
        short = muzzle * uniform(rng, (0.75, 0.97))
        parts += [
            pipe([(bore, -0.09), (bore, muzzle)], metal, y=0.008),
            pipe([(0.95 * bore, -0.09), (0.95 * bore, short)], metal, y=0.008 + below),
            box((0, 0.008 + below / 2, 0.9 * short), (0.018, 1.6 * bore, 0.02), metal),
            moved(front_sight(muzzle + 0.02, 0.03, metal), (0, 0.004, 0)),
        ]
        at = -uniform(rng, (0.20, 0.24))
        reach = at - uniform(rng, (0.13, 0.20))
        if kind == "pump":
            thick = 1.9 * bore
            grip = [
                (0.85 * thick, at),
                (thick, at - 0.02),
                (thick, reach + 0.02),
                (0.85 * thick, reach),
            ]
            parts.append(pipe(grip, wood, y=0.008 + below))
        else:
            parts.append(
                stock([(-0.11, -0.032, 0.018, 0.038), (reach, -0.030, 0.008, 0.034)], wood)
            )
            path = [(0, -0.035, -0.03), (0, -0.085, 0.0), (0, -0.10, 0.10), (0, -0.05, 0.13)]
            parts.append(tube([*path, (0, -0.038, 0.04)], 0.0048, metal, sides=5))
    if kind != "lever":
        parts += trigger(-0.040, -0.03, 0.045, metal)
    if kind == "pump" and chance(rng, 0.25):
        return [*parts, handle((-0.022, 0.075), 0.11, 0.06, 0.044, 0.033, wood)]
    length, drop = uniform(rng, (0.30, 0.37)), uniform(rng, (0.09, 0.13))
    butt = [
        (0.075, -0.030, 0.010, 0.030),
        (0.13, -0.052, -0.006, 0.032),
        (0.5 * length + 0.07, -0.62 * drop - 0.02, -0.012, 0.038),
        (length + 0.06, -drop - 0.02, -0.020, 0.041),
    ]
    return [*parts, stock(butt, wood)]
