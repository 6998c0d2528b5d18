"""Yachts and tall ships, under sail or with furled sails."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.hulls import blade
from data_prep.shapes.palettes import VESSEL, shade, shades
from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import Part, tube
from data_prep.shapes.vessel.lines import Lines, decked_hull
from data_prep.shapes.vessel.rigs import fore_and_aft_sail, house, mast, square_sail, yard


def sailing_yacht(rng: np.random.Generator) -> list[Part]:
    """Return a yacht with a keel, and one or two masts with fore-and-aft sails."""
    dyed = (*VESSEL["trim"], *VESSEL["teak"])
    side = shade(rng, VESSEL["white"] if chance(rng, 0.6) else dyed)
    bottom, deck, white, glass, cloth = shades(
        rng, VESSEL, "trim", "teak", "white", "glass", "sailcloth"
    )
    spar = shade(rng, "chrome") if chance(rng, 0.65) else shade(rng, VESSEL["teak"])
    lines = Lines(
        half_beam=uniform(rng, (0.12, 0.165)),
        draft=uniform(rng, (0.045, 0.07)),
        freeboard=uniform(rng, (0.060, 0.085)),
        sheer=(uniform(rng, (0.015, 0.04)), 0.012),
        entry=uniform(rng, (0.50, 0.60)),
        stern=uniform(rng, (0.45, 0.85)),
        fullness=uniform(rng, (0.40, 0.60)),
        rake=uniform(rng, (0.06, 0.14)),
        rocker=0.7,
    )
    y = lines.freeboard
    parts = decked_hull(lines, side, bottom, deck, 0.0)
    parts.append(
        blade(
            [(0, -0.5 * lines.draft, -0.10, 0.26, 0.03), (0, -0.16, -0.02, 0.16, 0.02)],
            bottom,
            upright=True,
        )
    )
    parts.append(
        blade([(0, -0.01, 0.40, 0.07, 0.014), (0, -0.13, 0.42, 0.05, 0.010)], bottom, upright=True)
    )
    cabin = (-0.16, uniform(rng, (0.10, 0.20)))
    half, roof = 0.58 * lines.half_beam, y + uniform(rng, (0.035, 0.055))
    parts.append(house(cabin, (y - 0.012, roof), half, white, lean=(0.07, 0.01), narrow=0.85))
    parts.append(
        house(
            (-0.10, cabin[1] - 0.03), (roof - 0.03, roof - 0.012), 0.93 * half, glass, swell=0.006
        )
    )
    masts = [(-0.10, uniform(rng, (1.05, 1.35)), cabin[1] + 0.20)]
    if chance(rng, 0.25):  # a ketch
        masts = [(-0.16, uniform(rng, (0.90, 1.1)), 0.14), (0.22, uniform(rng, (0.62, 0.78)), 0.50)]
    belly = uniform(rng, (0.01, 0.05)) * (1 if chance(rng, 0.5) else -1)
    furled = chance(rng, 0.15)
    for z, height, end in masts:
        foot = y - 0.02
        parts.append(mast((0, foot, z), height, 0.014, spar))
        boom = foot + 0.13
        parts.append(tube([(0, boom, z), (0, boom, end)], 0.009, spar, sides=6))
        if furled:
            parts.append(
                tube(
                    [(0, boom + 0.016, z + 0.02), (0, boom + 0.016, end - 0.02)],
                    0.018,
                    cloth,
                    sides=6,
                )
            )
        else:
            low = [(boom - 0.002, z + 0.004), (boom - 0.002, end - 0.02)]
            high = [(foot + 0.97 * height, z + 0.002), (foot + 0.97 * height, z + 0.03)]
            parts.append(fore_and_aft_sail(low, high, belly, cloth))
    z, height, _ = masts[0]
    top = y + uniform(rng, (0.72, 0.96)) * height
    bow = lines.deck_at(-0.47)
    parts.append(tube([(0, bow - 0.01, -0.475), (0, top, z)], 0.005, spar, sides=6))
    if not furled:
        # The stay runs along the edge of the jib; at both of its ends the sail is still on it.
        tack, head = (bow + 0.03, -0.462), (top - 0.06, z - 0.024)
        clew = (bow + 0.05, z + uniform(rng, (-0.02, 0.10)))
        parts.append(
            fore_and_aft_sail([tack, clew], [head, (head[0], head[1] + 0.02)], belly, cloth)
        )
    return parts


def tall_ship(rng: np.random.Generator) -> list[Part]:
    """Return a wooden hull, two or three masts with square sails, a bowsprit."""
    wood = shade(rng, ((116, 74, 44), (92, 58, 38), (146, 98, 60), (56, 46, 42)))
    bottom, deck = shade(rng, ((70, 48, 36), (104, 60, 42))), shade(rng, VESSEL["teak"])
    spar, cloth = shade(rng, ((108, 74, 46), (84, 60, 42))), shade(rng, VESSEL["sailcloth"])
    lines = Lines(
        half_beam=uniform(rng, (0.10, 0.135)),
        draft=uniform(rng, (0.05, 0.07)),
        freeboard=uniform(rng, (0.065, 0.09)),
        sheer=(uniform(rng, (0.03, 0.06)), uniform(rng, (0.04, 0.08))),
        entry=uniform(rng, (0.26, 0.36)),
        stern=uniform(rng, (0.60, 0.75)),
        fullness=uniform(rng, (0.28, 0.42)),
        rake=uniform(rng, (0.05, 0.09)),
        rocker=0.25,
    )
    y = lines.freeboard
    parts = decked_hull(lines, wood, bottom, deck, 0.012)
    castle = uniform(rng, (0.02, 0.07))
    if castle > 0.03:
        z, half = (0.28, 0.505), 0.86 * lines.half_width_at(0.40)
        parts.append(house(z, (y, lines.deck_at(0.42) + castle), half, wood, lean=(0, -0.02)))
    bow = lines.deck_at(-0.46)
    parts.append(tube([(0, bow - 0.02, -0.40), (0, bow + 0.10, -0.78)], 0.011, spar, sides=6))
    count = 3 if chance(rng, 0.7) else 2
    tallest = uniform(rng, (0.72, 0.95))
    furled = chance(rng, 0.2)
    belly = uniform(rng, (0.015, 0.05))
    places = np.linspace(-0.27, 0.27 if count == 3 else 0.14, count)
    for place, share in zip(places, (0.92, 1.0, 0.80), strict=False):
        z, height = float(place), share * tallest
        foot = y - 0.03
        parts.append(mast((0, foot, z), height, 0.015, spar))
        levels = np.array([0.24, 0.52, 0.76, 0.95]) * height + foot
        widths = np.array([0.27, 0.23, 0.17, 0.10]) * share * tallest / 0.85
        for level, half in zip(levels, widths, strict=True):
            parts.append(yard(z - 0.010, float(level), float(half), 0.008, spar))
        if furled:
            for level, half in zip(levels[1:], widths[1:], strict=True):
                parts.append(yard(z - 0.014, float(level) - 0.014, 0.9 * float(half), 0.015, cloth))
            continue
        for k in range(3):
            heights = (float(levels[k]) + 0.003, float(levels[k + 1]) + 0.002)
            halves = (0.93 * float(widths[k]), 0.93 * float(widths[k + 1]))
            parts.append(square_sail(z - 0.014, heights, halves, belly, cloth))
    z = float(places[0])
    top = y + 0.66 * tallest
    end = (bow + 0.085, -0.73)
    parts.append(tube([(0, end[0], end[1]), (0, top, z)], 0.004, spar, sides=6))
    if not furled:
        tack = (end[0] + 0.02, end[1] + 0.02 * (z - end[1]) / (top - end[0]))
        head = (top - 0.10, z - 0.10 * (z - end[1]) / (top - end[0]))
        clew = (end[0] + 0.04, z - 0.12)
        parts.append(
            fore_and_aft_sail([tack, clew], [head, (head[0], head[1] + 0.02)], 0.4 * belly, cloth)
        )
    return parts
