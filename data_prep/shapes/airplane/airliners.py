"""Civil jets: engines under the wing, at the tail, or under a delta."""

from __future__ import annotations

import math

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.airplane.parts import Wing, turbofan, upright_fin, winglets_on
from data_prep.shapes.hulls import blade, pair, spindle
from data_prep.shapes.palettes import AIRPLANE, shade, shades
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box


def _tube_fuselage(r: float, taper: float) -> Floats:
    """Return the stations of an airliner's body of radius r, whose tail begins at z = taper."""
    return np.array(
        [
            (-0.5, -0.28 * r, 0.12 * r, 0.12 * r),
            (-0.488, -0.24 * r, 0.40 * r, 0.38 * r),
            (-0.46, -0.12 * r, 0.74 * r, 0.72 * r),
            (-0.41, -0.01 * r, 0.96 * r, 0.97 * r),
            (-0.36, 0.0, r, r),
            (taper, 0.0, r, r),
            (0.6 * taper + 0.2, 0.2 * r, 0.76 * r, 0.78 * r),
            (0.46, 0.56 * r, 0.30 * r, 0.32 * r),
            (0.5, 0.64 * r, 0.10 * r, 0.12 * r),
        ]
    )


def _windows(r: float, taper: float, glass: Color) -> list[Part]:
    """Return the cockpit's windows and one dark strip for all others, standing out of the body."""
    y, height = 0.28 * r, 0.22 * r
    half_width = math.sqrt(r**2 - (y - height / 2) ** 2) + 0.004
    strip = box((0, y, (taper - 0.36) / 2), (2 * half_width, height, 0.34 + taper), glass)
    cockpit = [
        (-0.478, 0.2 * r, 0.46 * r, 0.3 * r),
        (-0.462, 0.34 * r, 0.66 * r, 0.36 * r),
        (-0.44, 0.44 * r, 0.66 * r, 0.42 * r),
    ]
    return [strip, spindle(cockpit, glass, sides=10)]


def airliner(rng: np.random.Generator) -> list[Part]:
    """Return an airliner with two or four engines under a low, swept wing."""
    body, wings, accent, glass, dark = shades(
        rng, AIRPLANE, "white", "grey", "livery", "glass", "dark"
    )
    four = chance(rng, 0.28)
    r = uniform(rng, (0.046, 0.066))
    taper = uniform(rng, (0.10, 0.20))
    wing = Wing(
        half_span=uniform(rng, (0.42, 0.56)),
        root=uniform(rng, (0.21, 0.28)),
        tip=uniform(rng, (0.045, 0.075)),
        y=-0.6 * r,
        z=uniform(rng, (-0.17, -0.08)),
        sweep=uniform(rng, (0.42, 0.74)),
        dihedral=uniform(rng, (0.05, 0.13)),
        kink=uniform(rng, (0.28, 0.38)),
    )
    tail = Wing(
        half_span=uniform(rng, (0.15, 0.21)),
        root=uniform(rng, (0.10, 0.13)),
        tip=uniform(rng, (0.035, 0.055)),
        y=0.42 * r,
        z=0.35,
        sweep=uniform(rng, (0.5, 0.8)),
        dihedral=uniform(rng, (0.03, 0.16)),
    )
    height = uniform(rng, (0.13, 0.18))
    radius = uniform(rng, (0.020, 0.026) if four else (0.024, 0.036))
    length = uniform(rng, (3.0, 3.8)) * radius
    engine_color = pick(rng, {body: 0.4, accent: 0.35, wings: 0.25})
    painted_tail, winglets = chance(rng, 0.5), chance(rng, 0.4)
    parts = [
        spindle(_tube_fuselage(r, taper), body),
        wing.part(wings),
        tail.part(wings),
        upright_fin((0, 0.5 * r, 0.30), height + 0.5 * r, (0.16, 0.055), 0.85, accent),
        *_windows(r, taper, glass),
    ]
    if painted_tail:
        parts.append(
            spindle(np.add(_tube_fuselage(1.03 * r, taper)[-3:], (0.006, 0, 0.002, 0.002)), accent)
        )
    for place in (0.30, 0.56) if four else (0.33,):
        x = place * wing.half_span
        _, y, z = wing.at(x)
        drop, front = y - 1.1 * radius, z - 0.55 * length
        engine = turbofan(x, drop, front, radius, length, engine_color, dark)
        _, _, back = wing.at(x, 0.45)
        pylon = box(
            (x, (drop + y) / 2, (front + 0.3 * length + back) / 2),
            (0.008, y - drop, back - front - 0.3 * length),
            wings,
        )
        parts += pair(*engine, pylon)
    return parts + (winglets_on(wing, uniform(rng, (0.03, 0.06)), accent) if winglets else [])


def rear_engine_jet(rng: np.random.Generator) -> list[Part]:
    """Return a jet with engines on both sides of the tail (sometimes one in the fin), a T-tail."""
    body, accent = shades(rng, AIRPLANE, "white", "livery")
    wings = body if chance(rng, 0.5) else shade(rng, AIRPLANE["grey"])
    glass, dark = shades(rng, AIRPLANE, "glass", "dark")
    r = uniform(rng, (0.044, 0.070))
    taper = uniform(rng, (0.14, 0.22))
    wing = Wing(
        half_span=uniform(rng, (0.40, 0.54)),
        root=uniform(rng, (0.17, 0.24)),
        tip=uniform(rng, (0.04, 0.07)),
        y=-0.62 * r,
        z=uniform(rng, (-0.08, 0.0)),
        sweep=uniform(rng, (0.22, 0.55)),
        dihedral=uniform(rng, (0.03, 0.09)),
        kink=0.3 if chance(rng, 0.4) else 0.0,
    )
    height = uniform(rng, (0.13, 0.19))
    fin_sweep = uniform(rng, (0.7, 1.0))
    low = 0.5 * r
    fin = upright_fin((0, low, 0.29), r + height - low, (0.16, 0.09), fin_sweep, accent)
    top = r + height
    tail = Wing(
        half_span=uniform(rng, (0.14, 0.19)),
        root=0.095,
        tip=uniform(rng, (0.035, 0.055)),
        y=top - 0.006,
        z=0.29 + fin_sweep * (top - low) + uniform(rng, (-0.01, 0.02)),
        sweep=uniform(rng, (0.3, 0.6)),
        dihedral=-0.03,
    )
    radius = uniform(rng, (0.022, 0.032))
    length = uniform(rng, (4.0, 5.5)) * radius
    x, y, z = r + 1.05 * radius, 0.42 * r, uniform(rng, (0.12, 0.18))
    shell = pick(rng, {body: 0.5, accent: 0.3, wings: 0.2})
    parts = [
        spindle(_tube_fuselage(r, taper), body),
        wing.part(wings),
        tail.part(wings),
        fin,
        *_windows(r, taper - 0.08, glass),
        box((0, y, z + 0.45 * length), (2 * x, 0.012, 0.5 * length), body),
    ]
    parts += pair(*turbofan(x, y, z, radius, length, shell, dark))
    if chance(rng, 0.2):  # a third engine at the root of the fin
        parts += turbofan(0.0, 0.95 * r + 0.6 * radius, 0.24, 0.9 * radius, 0.22, shell, dark)
    if chance(rng, 0.5):
        parts += winglets_on(
            wing, uniform(rng, (0.03, 0.055)), pick(rng, {wings: 0.5, accent: 0.5})
        )
    return parts


def supersonic(rng: np.random.Generator) -> list[Part]:
    """Return an airliner with a needle of a body on an ogee wing, without a tailplane."""
    body, accent, glass, dark = shades(rng, AIRPLANE, "white", "livery", "glass", "dark")
    r = uniform(rng, (0.026, 0.036))
    fuselage = spindle(
        [
            (-0.5, -0.6 * r, 0.08 * r, 0.08 * r),
            (-0.44, -0.3 * r, 0.45 * r, 0.45 * r),
            (-0.36, 0.0, 0.9 * r, 0.9 * r),
            (-0.28, 0.0, r, r),
            (0.26, 0.0, r, r),
            (0.5, 0.5 * r, 0.1 * r, 0.1 * r),
        ],
        body,
    )
    # An ogee: each half of the wing is swept twice.
    half_span, start = uniform(rng, (0.20, 0.27)), uniform(rng, (-0.26, -0.18))
    end, y = uniform(rng, (0.30, 0.36)), -0.5 * r
    half = [
        (0.0, start, end),
        (0.28 * half_span, start + 0.24, end),
        (0.72 * half_span, start + 0.40, end),
        (half_span, end - 0.06, end + 0.01),
    ]
    stations = [(x, y, z, back - z, 0.016) for x, z, back in half]
    left = [(-x, *rest) for x, *rest in stations[:0:-1]]
    parts = [fuselage, blade([*left, *stations], body)]
    parts.append(
        upright_fin((0, 0.4 * r, 0.20), uniform(rng, (0.10, 0.14)), (0.26, 0.06), 1.6, accent)
    )
    y_engine = y - 0.020
    pod = box((0.42 * half_span, y_engine, end - 0.09), (0.055, 0.036, 0.20), body)
    exhaust = box((0.42 * half_span, y_engine, end - 0.05), (0.042, 0.026, 0.16), dark)
    parts += pair(pod, exhaust)
    height = 0.24 * r
    strip = box((0, 0.3 * r, 0.0), (2.06 * r + 0.006, height, 0.5), glass)
    visor = [(-0.43, -0.1 * r, 0.3 * r, 0.2 * r), (-0.38, 0.5 * r, 0.6 * r, 0.52 * r)]
    return [*parts, strip, spindle([*visor, (-0.35, 0.45 * r, 0.6 * r, 0.5 * r)], glass, sides=10)]
