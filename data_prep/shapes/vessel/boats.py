"""Motor yachts, speedboats, rowing boats and inflatables."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.hulls import pair
from data_prep.shapes.palettes import VESSEL, shade, shades
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, tube
from data_prep.shapes.vessel.lines import STATIONS, Lines, decked_hull
from data_prep.shapes.vessel.rigs import house, mast


def motor_yacht(rng: np.random.Generator) -> list[Part]:
    """Return a planing hull with one or two glazed decks; or a speedboat."""
    side = shade(rng, VESSEL["white"]) if chance(rng, 0.7) else shade(rng, VESSEL["trim"])
    bottom, deck, white = shades(rng, VESSEL, "trim", "teak", "white")
    glass = shade(rng, VESSEL["glass"])
    speedboat = chance(rng, 0.4)
    lines = Lines(
        half_beam=uniform(rng, (0.12, 0.175)) if speedboat else uniform(rng, (0.10, 0.145)),
        draft=uniform(rng, (0.035, 0.05)),
        freeboard=uniform(rng, (0.065, 0.095)),
        sheer=(uniform(rng, (0.02, 0.05)), -0.015),
        entry=uniform(rng, (0.48, 0.62)),
        stern=uniform(rng, (0.82, 0.98)),
        fullness=uniform(rng, (0.25, 0.42)),
        rake=uniform(rng, (0.10, 0.20)),
        rocker=0.3,
    )
    b, y = lines.half_beam, lines.freeboard
    if speedboat:
        return _speedboat(rng, lines, side, bottom, glass)
    parts = decked_hull(lines, side, bottom, deck, 0.0)
    fore = lines.deck_at(-0.2)
    start, end = uniform(rng, (-0.26, -0.15)), uniform(rng, (0.22, 0.34))
    first = fore + uniform(rng, (0.045, 0.06))
    lean, width = uniform(rng, (0.08, 0.14)), 0.80 * b
    parts.append(
        house((start, end), (y - 0.02, first), width, white, lean=(lean, 0.03), narrow=0.88)
    )
    window = (first - 0.040, first - 0.014)
    parts.append(
        house(
            (start + 0.62 * lean, end - 0.05),
            window,
            0.90 * width,
            glass,
            swell=0.010,
            lean=(0.3 * lean, 0.0),
            narrow=0.97,
        )
    )
    decks = 2 if end - start > 0.46 and chance(rng, 0.7) else 1
    top, front, back, half = first, start + lean + 0.02, end + 0.04, 0.86 * width
    for _ in range(decks):
        roof = top + uniform(rng, (0.042, 0.058))
        parts.append(house((front - 0.02, back), (top - 0.006, top + 0.008), half, white))
        parts.append(
            house(
                (front, back - 0.10),
                (top + 0.004, roof - 0.008),
                0.9 * half,
                glass,
                lean=(0.06, 0.01),
                narrow=0.9,
            )
        )
        parts.append(
            house(
                (front + 0.045, back - 0.06),
                (roof - 0.014, roof),
                0.92 * half,
                white,
                lean=(0.02, 0.0),
            )
        )
        top, front, back, half = roof, front + 0.09, back - 0.07, 0.84 * half
    arch = house(
        (back - 0.09, back - 0.03),
        (top - 0.01, top + 0.06),
        0.30 * b,
        white,
        lean=(0.05, -0.02),
        narrow=0.7,
    )
    parts += [arch, mast((0, top + 0.05, back - 0.035), 0.06, 0.006, white)]
    return parts


def _speedboat(
    rng: np.random.Generator, lines: Lines, side: Color, bottom: Color, glass: Color
) -> list[Part]:
    """Return an open cockpit behind a windscreen, and an outboard engine."""
    b, y = lines.half_beam, lines.freeboard
    seat, depth = shade(rng, VESSEL["trim"]), 0.8 * y
    start = uniform(rng, (-0.10, 0.0))
    parts = [lines.open_boat(depth, 0.16 * b, side, fore=0.45)]
    parts.append(lines.between(lines.keel - 0.004, 0.0, bottom, swell=0.004))
    fore = lines.deck_at(start)
    screen = house(
        (start - 0.10, start + 0.01),
        (fore - 0.02, fore + 0.06),
        0.80 * b,
        glass,
        lean=(0.08, 0.01),
        narrow=0.85,
    )
    parts.append(screen)
    for z in (start + 0.10, start + 0.26):
        parts.append(box((0, y - depth + 0.03, z), (1.2 * b, 0.09, 0.09), seat))
        parts.append(box((0, y - depth + 0.08, z + 0.05), (1.2 * b, 0.09, 0.025), seat))
    z = 0.525
    engine = house(
        (z - 0.04, z + 0.04),
        (0.3 * y, 1.45 * y),
        0.04,
        shade(rng, VESSEL["black"]),
        lean=(0.01, 0.015),
    )
    parts += [
        engine,
        box((0, 0.0, z), (0.02, 0.12, 0.05), bottom),
        box((0, 0.6 * y, 0.48), (0.05, 0.5 * y, 0.08), side),
    ]
    return parts


def open_boat(rng: np.random.Generator) -> list[Part]:
    """Return a hull with a well and thwarts: with oars, with inflated tubes, or bare."""
    kind = pick(rng, {"oars": 0.5, "tubes": 0.25, "bare": 0.25})
    wooden = kind != "tubes" and chance(rng, 0.75)
    plain = VESSEL["rubber"] if kind == "tubes" else (*VESSEL["trim"], *VESSEL["white"])
    hull = shade(rng, "wood" if wooden else plain)
    inside = shade(rng, VESSEL["teak"]) if wooden else shade(rng, VESSEL["black"])
    lines = Lines(
        half_beam=uniform(rng, (0.14, 0.21)),
        draft=uniform(rng, (0.05, 0.08)),
        freeboard=uniform(rng, (0.07, 0.12)),
        sheer=(uniform(rng, (0.02, 0.08)), uniform(rng, (0.0, 0.05))),
        entry=uniform(rng, (0.45, 0.60)),
        stern=uniform(rng, (0.30, 0.85)),
        fullness=uniform(rng, (0.25, 0.50)),
        rake=uniform(rng, (0.04, 0.12)),
        rocker=uniform(rng, (0.2, 0.6)),
    )
    depth = 0.75 * (lines.freeboard + 0.4 * lines.draft)
    parts = [lines.open_boat(depth, 0.022, hull)]
    for z in np.linspace(-0.22, 0.30, int(rng.integers(2, 5))):
        half, y = lines.half_width_at(float(z), 0.05) - 0.006, lines.deck_at(float(z)) - 0.04
        parts.append(box((0, y, z), (2 * half, 0.016, 0.075), inside))
    half = 0.5 * min(lines.half_width_at(z, depth) for z in (-0.2, 0.3))
    floor = lines.freeboard - depth
    parts.append(box((0, floor, 0.05), (2 * half, 0.016, 0.50), inside))
    if kind == "oars":
        z = uniform(rng, (-0.06, 0.10))
        edge, top = lines.half_width_at(z), lines.deck_at(z)
        inner, outer = (0.3 * edge, top + 0.03, z - 0.05), (edge + 0.26, top - 0.10, z + 0.16)
        oar = tube([inner, (edge - 0.008, top, z + 0.02), outer], 0.010, inside, sides=6)
        flat = [
            (outer[0] - 0.02, outer[1] - 0.006, outer[2] - 0.03),
            (outer[0] + 0.08, outer[1] - 0.04, outer[2] + 0.05),
        ]
        parts += [*pair(oar), *pair(tube(flat, 0.020, inside, sides=6))]
    elif kind == "tubes":  # an inflatable: fat tubes along the edge
        z = STATIONS[1:-1] - 0.5
        path = [(lines.half_width_at(float(at)), lines.deck_at(float(at)), float(at)) for at in z]
        parts += pair(tube(path, 0.042, hull, sides=8))
        parts.append(box((0, 0.09, 0.50), (0.07, 0.14, 0.08), inside))
    return parts
