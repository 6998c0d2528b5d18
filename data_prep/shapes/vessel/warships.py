"""Destroyers, battleships, carriers and submarines."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.hulls import blade, spindle
from data_prep.shapes.palettes import VESSEL, shade, shades
from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import Color, Part, box, lathe, moved, slab, tube
from data_prep.shapes.vessel.lines import Lines, decked_hull
from data_prep.shapes.vessel.rigs import funnel_parts, house, mast, yard


def warship(rng: np.random.Generator) -> list[Part]:
    """Return a slim grey hull: stepped houses, masts, turrets; or a carrier."""
    grey, dark, glass = shades(rng, VESSEL, "navy-grey", "black", "glass")
    deck = shade(rng, ((96, 102, 108), (120, 84, 66)))
    lines = Lines(
        half_beam=uniform(rng, (0.046, 0.066)),
        draft=uniform(rng, (0.025, 0.038)),
        freeboard=uniform(rng, (0.032, 0.048)),
        sheer=(uniform(rng, (0.018, 0.035)), 0.0),
        entry=uniform(rng, (0.34, 0.48)),
        stern=uniform(rng, (0.55, 0.85)),
        fullness=uniform(rng, (0.18, 0.30)),
        rake=uniform(rng, (0.03, 0.07)),
    )
    bottom = shade(rng, VESSEL["antifouling"]) if chance(rng, 0.6) else dark
    parts = decked_hull(lines, grey, bottom, deck, -0.006)
    b, y = lines.half_beam, lines.freeboard
    if chance(rng, 0.25):
        return [*parts, *_flight_deck(rng, lines, grey, deck, glass)]
    start, end = uniform(rng, (-0.20, -0.12)), uniform(rng, (0.14, 0.26))
    first = y + uniform(rng, (0.028, 0.040))
    second = first + uniform(rng, (0.026, 0.042))
    width = uniform(rng, (0.70, 0.92)) * b
    middle = start + uniform(rng, (0.10, 0.16))
    lean = uniform(rng, (0.0, 0.02))
    parts.append(
        house((start, end), (y - 0.014, first), width, grey, lean=(lean, 0.4 * lean), narrow=0.92)
    )
    parts.append(
        house(
            (start + 0.025, middle),
            (first - 0.006, second),
            0.86 * width,
            grey,
            lean=(lean, 0.0),
            narrow=0.9,
        )
    )
    strip = (second - 0.016, second - 0.007)
    parts.append(house((start + 0.025 + lean, middle), strip, 0.80 * width, glass, swell=0.007))
    for z in (middle - 0.03, *((end - 0.05,) if chance(rng, 0.5) else ())):
        foot = first - 0.01 if z > middle else second - 0.01
        tall = uniform(rng, (0.08, 0.13))
        parts += [
            mast((0, foot, z), tall, 0.012, grey),
            yard(z, foot + 0.6 * tall, 0.6 * b, 0.004, grey),
            yard(z, foot + 0.8 * tall, 0.4 * b, 0.004, grey),
            box((0, foot + 0.9 * tall, z), (0.035, 0.014, 0.010), dark),
        ]
    for z in (middle + 0.05, middle + 0.13)[: int(rng.integers(1, 3))]:
        parts += funnel_parts(z, first - 0.012, uniform(rng, (0.045, 0.065)), 0.020, grey, dark)
    battleship = chance(rng, 0.35)
    size = uniform(rng, (0.042, 0.056)) if battleship else uniform(rng, (0.028, 0.038))
    parts += _turret(
        start - 1.4 * size, lines.deck_at(start - 1.4 * size), size, 3 if battleship else 1, grey
    )
    if battleship:
        z = start - 3.6 * size
        parts += _turret(z, lines.deck_at(z), size, 3, grey)
        parts += _turret(end + 1.4 * size, y, size, 3, grey, aft=True)
    elif chance(rng, 0.5):
        hangar = house((end - 0.03, end + 0.06), (y - 0.014, first - 0.006), 0.9 * width, grey)
        parts.append(hangar)
    return parts


def _turret(
    z: float, y: float, size: float, guns: int, color: Color, aft: bool = False
) -> list[Part]:
    """Return a gun turret whose barrels point to the bow, or to the stern."""
    ahead = 1.0 if aft else -1.0
    ring = (z - 0.6 * size, z + 0.6 * size)
    parts = [
        house(ring, (y - 0.012, y + 0.55 * size), 0.5 * size, color, lean=(0.3 * size, 0.3 * size))
    ]
    for k in range(guns):
        x = (k - (guns - 1) / 2) * 0.28 * size
        muzzle = (x, y + 0.45 * size, z + ahead * 1.9 * size)
        parts.append(tube([(x, y + 0.25 * size, z), muzzle], 0.0045, color, sides=6))
    return parts


def _flight_deck(
    rng: np.random.Generator, lines: Lines, grey: Color, deck: Color, glass: Color
) -> list[Part]:
    """Return a carrier's flat deck that hangs over, an island on its right, and aircraft."""
    b, y = lines.half_beam, lines.freeboard
    parts = []
    wide, top = uniform(rng, (1.5, 1.9)) * b, y + 0.036
    plan = np.array([(0.5, -0.5), (0.5, 0.42), (0.3, 0.5), (-0.5, 0.5), (-0.5, -0.2), (-0.2, -0.5)])
    parts.append(house((-0.36, 0.46), (y - 0.014, top - 0.012), 0.9 * b, grey, narrow=1.3))
    parts.append(slab(plan, (0, top - 0.008, 0.0), (2 * wide, 0.022, 1.02), deck))
    x, z = 0.76 * wide, uniform(rng, (-0.02, 0.15))
    island = house((z - 0.06, z + 0.06), (top - 0.004, top + 0.06), 0.018, grey)
    windows = house((z - 0.06, z + 0.06), (top + 0.038, top + 0.048), 0.018, glass, swell=0.006)
    parts += [moved(part, (x, 0, 0)) for part in (island, windows)]
    parts += [
        mast((x, top + 0.05, z), 0.08, 0.008, grey),
        box((x, top + 0.09, z), (0.05, 0.008, 0.01), grey),
    ]
    for z in np.linspace(-0.1, 0.4, int(rng.integers(3, 6))):  # aircraft along the edge
        parts.append(box((-0.62 * wide, top + 0.006, z), (0.012, 0.012, 0.06), grey))
        parts.append(box((-0.62 * wide, top + 0.008, z + 0.006), (0.05, 0.006, 0.02), grey))
    return parts


def submarine(rng: np.random.Generator) -> list[Part]:
    """Return a round hull with a sail, fins and a propeller; partly below the water."""
    hull = shade(rng, (*VESSEL["black"], (74, 80, 86), (92, 104, 110)))
    trim = shade(rng, (*VESSEL["antifouling"], *VESSEL["black"]))
    r = uniform(rng, (0.048, 0.066))
    blunt = uniform(rng, (0.5, 0.75))
    body = [
        (-0.5, 0.0, 0.22 * r, 0.22 * r),
        (-0.488, 0.0, blunt * r, blunt * r),
        (-0.45, 0.0, 0.90 * r, 0.90 * r),
        (-0.38, 0.0, r, r),
        (uniform(rng, (0.10, 0.22)), 0.0, r, r),
        (0.36, 0.0, 0.62 * r, 0.62 * r),
        (0.46, 0.0, 0.20 * r, 0.20 * r),
    ]
    z, height = uniform(rng, (-0.24, -0.06)), uniform(rng, (0.055, 0.085))
    long = uniform(rng, (0.10, 0.17))
    parts = [spindle(body, hull)]
    sail = [(0, 0.6 * r, z, long, 0.030), (0, r + height, z + 0.012, 0.86 * long, 0.026)]
    parts.append(blade(sail, hull, upright=True))
    for along in (0.25, 0.4, 0.55):
        tall = uniform(rng, (0.02, 0.06))
        parts.append(mast((0, r + height - 0.01, z + along * long), tall, 0.005, trim))
    planes = (r + 0.55 * height, z + 0.15 * long) if chance(rng, 0.5) else (0.0, -0.34)
    span = 0.09 if planes[0] > 0 else r + 0.06
    y, front = planes
    parts.append(
        blade(
            [
                (-span, y, front + 0.01, 0.035, 0.007),
                (0, y, front, 0.05, 0.010),
                (span, y, front + 0.01, 0.035, 0.007),
            ],
            hull,
        )
    )
    reach = uniform(rng, (0.075, 0.10))
    tail = [
        (-reach, 0, 0.40, 0.04, 0.007),
        (0, 0, 0.37, 0.08, 0.012),
        (reach, 0, 0.40, 0.04, 0.007),
    ]
    parts.append(blade(tail, hull))
    parts.append(blade([(x, y, z, c, t) for y, x, z, c, t in tail], hull, upright=True))
    blades = lathe([(0.02, -0.004), (0.036, 0.0), (0.02, 0.004)], trim, sides=7)
    parts.append(moved(blades, (0, 0, 0.475), tilt_rad=math.pi / 2))
    parts.append(spindle([(0.44, 0, 0.011, 0.011), (0.50, 0, 0.006, 0.006)], trim, sides=8))
    if chance(rng, 0.5):
        parts.append(
            box(
                (0, 0.93 * r, (z + long + 0.16) / 2),
                (0.9 * r, 0.2 * r, 0.16 - z - long + 0.06),
                trim,
            )
        )
    return parts
