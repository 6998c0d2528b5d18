"""Cargo ships and passenger ships."""

from __future__ import annotations

import itertools

import numpy as np

from data_prep.shapes.hulls import pair, spindle
from data_prep.shapes.palettes import VESSEL, shade, shades
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, tube
from data_prep.shapes.vessel.lines import Lines, decked_hull
from data_prep.shapes.vessel.rigs import funnel_parts, house, mast


def _bridge(
    z: tuple[float, float],
    y: tuple[float, float],
    half_width: float,
    color: Color,
    glass: Color,
    storeys: int,
) -> list[Part]:
    """Return a house with a strip of windows a storey."""
    parts = [house(z, y, half_width, color)]
    for level in range(storeys):
        middle = y[0] + (level + 0.68) / storeys * (y[1] - y[0])
        tall = 0.16 * (y[1] - y[0]) / storeys
        parts.append(house(z, (middle - tall, middle + tall), half_width, glass, swell=0.006))
    return parts


def cargo_ship(rng: np.random.Generator) -> list[Part]:
    """Return a full hull with its bridge at the stern.

    It carries containers, tanks or hatches with derricks.
    """
    side, bottom, deck = shades(rng, VESSEL, "ship-hull", "red-antifouling", "deck")
    white, glass, funnel = shades(rng, VESSEL, "white", "glass", "funnel")
    lines = Lines(
        half_beam=uniform(rng, (0.062, 0.090)),
        draft=uniform(rng, (0.025, 0.045)),
        freeboard=uniform(rng, (0.030, 0.060)),
        sheer=(uniform(rng, (0.012, 0.035)), 0.005),
        entry=uniform(rng, (0.16, 0.24)),
        stern=uniform(rng, (0.70, 0.92)),
        fullness=uniform(rng, (0.08, 0.16)),
        rake=uniform(rng, (0.02, 0.05)),
    )
    b, deck_y = lines.half_beam, lines.freeboard
    parts = decked_hull(lines, side, bottom, deck, uniform(rng, (-0.012, 0.008)))
    start = uniform(rng, (0.27, 0.36))
    end, top = start + uniform(rng, (0.06, 0.10)), deck_y + uniform(rng, (0.075, 0.125))
    parts += _bridge((start, end), (deck_y - 0.014, top), 0.85 * b, white, glass, 3)
    wings = ((start - 0.006, start + 0.03), (top - 0.004, top + 0.022), 1.02 * b)
    parts += [house(*wings, white), box((0, top + 0.012, start), (1.8 * b, 0.010, 0.024), glass)]
    parts.append(mast((0, top, start + 0.03), 0.05, 0.006, white))
    parts += funnel_parts(end + 0.025, deck_y - 0.014, top - deck_y, 0.022, funnel, glass)
    parts.append(mast((0, lines.deck_at(-0.44), -0.44), 0.05, 0.006, white))
    load = pick(rng, {"containers": 0.45, "tanks": 0.28, "hatches": 0.27})
    if load == "containers":
        first = int(rng.integers(len(VESSEL["container"]) - 1))
        colors = [shade(rng, (color,)) for color in VESSEL["container"][first : first + 2]]
        colors += [side] if chance(rng, 0.5) else []
        bays = int(rng.integers(5, 9))
        edges = np.linspace(-0.34, start - 0.015, bays + 1)
        for low, high in itertools.pairwise(edges.tolist()):
            half = 0.86 * min(lines.half_width_at(low), lines.half_width_at(high))
            for row in range(3):
                x = (row - 1) * half * 2 / 3
                y = deck_y + 0.020 * int(rng.integers(1, 5)) + 0.003
                size = (2 * half / 3 - 0.004, y - deck_y + 0.004, high - low - 0.010)
                centre = (x, (y + deck_y - 0.004) / 2, (low + high) / 2)
                parts.append(box(centre, size, colors[int(rng.integers(len(colors)))]))
    elif load == "tanks":
        pipe = [(0.0, deck_y + 0.012, z) for z in (-0.36, start + 0.01)]
        parts += [
            tube(pipe, 0.012, white, sides=6),
            *pair(tube(np.add(pipe, (0.3 * b, 0, 0)), 0.006, white, sides=6)),
        ]
        for z in np.linspace(-0.28, start - 0.06, int(rng.integers(3, 6))):
            parts.append(box((0, deck_y + 0.009, z), (1.5 * b, 0.022, 0.016), deck))
        parts += pair(mast((0.3 * b, deck_y - 0.014, -0.02), 0.075, 0.008, white))
    else:
        edges = np.linspace(-0.34, start - 0.02, int(rng.integers(4, 7)))
        for low, high in itertools.pairwise(edges.tolist()):
            middle, size = (low + high) / 2, (1.2 * b, 0.026, 0.72 * (high - low))
            parts.append(box((0, deck_y + 0.008, middle), size, funnel))
            foot, height = (0.0, deck_y - 0.014, high), uniform(rng, (0.08, 0.12))
            parts.append(mast(foot, height, 0.009, white))
            jib = [
                (0, deck_y + 0.5 * height, high),
                (0, deck_y + height, high - 0.7 * (high - low)),
            ]
            parts.append(tube(jib, 0.006, white, sides=6))
    return parts


def passenger_ship(rng: np.random.Generator) -> list[Part]:
    """Return a ship with storeys of windows along nearly all of it, lifeboats, funnels."""
    white, glass, funnel = shades(rng, VESSEL, "white", "glass", "funnel")
    side = white if chance(rng, 0.55) else shade(rng, VESSEL["ship-hull"])
    bottom, deck = shade(rng, (*VESSEL["antifouling"], *VESSEL["trim"])), shade(rng, VESSEL["teak"])
    boat = shade(rng, ((214, 108, 46),))
    lines = Lines(
        half_beam=uniform(rng, (0.060, 0.095)),
        draft=uniform(rng, (0.025, 0.038)),
        freeboard=uniform(rng, (0.050, 0.070)),
        sheer=(uniform(rng, (0.010, 0.030)), 0.004),
        entry=uniform(rng, (0.26, 0.36)),
        stern=uniform(rng, (0.75, 0.95)),
        fullness=uniform(rng, (0.10, 0.20)),
        rake=uniform(rng, (0.04, 0.09)),
    )
    b, y = lines.half_beam, lines.freeboard
    parts = decked_hull(lines, side, bottom, deck, 0.0)
    storeys = int(rng.integers(2, 6))
    front, back, half = uniform(rng, (-0.34, -0.26)), uniform(rng, (0.40, 0.46)), 0.94 * b
    step, tall = uniform(rng, (0.008, 0.030)), uniform(rng, (0.022, 0.028))
    base = y
    for level in range(storeys):
        low = base - (0.012 if level == 0 else 0.005)
        parts.append(house((front, back), (low, base + tall), half, white))
        window = (base + 0.40 * tall, base + 0.72 * tall)
        parts.append(house((front, back), window, half, glass, swell=0.0055))
        base += tall
        front, back = front + uniform(rng, (0.2, 1.2)) * step, back - step
        half *= 0.97
    parts.append(house((front + 0.01, front + 0.06), (base - 0.005, base + 0.022), 1.02 * b, white))
    parts.append(box((0, base + 0.012, front + 0.01), (1.9 * b, 0.010, 0.020), glass))
    if chance(rng, 0.7):
        z = np.linspace(-0.12, 0.24, int(rng.integers(4, 8)))
        for place in z:  # lifeboats along the lowest house
            hung = [
                (place - 0.022, 0.3),
                (place - 0.010, 1.0),
                (place + 0.010, 1.0),
                (place + 0.022, 0.3),
            ]
            stations = [(at, y + 0.018, 0.016 * full, 0.010 * full) for at, full in hung]
            parts += pair(spindle(stations, boat, x=0.94 * b + 0.008, sides=8))
    for z in [0.10] if chance(rng, 0.6) else [0.02, 0.16]:
        parts += funnel_parts(
            z + uniform(rng, (-0.02, 0.02)),
            base - 0.01,
            uniform(rng, (0.05, 0.08)),
            0.024,
            funnel,
            glass,
        )
    parts.append(mast((0, base, front + 0.05), 0.08, 0.007, white))
    return parts
