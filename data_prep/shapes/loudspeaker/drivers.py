"""Drivers of loudspeakers: woofers, domes, horns and ports, looking towards -Z.

Each stands on the surface at its centre's z and is sunk into it. `step` is the height in which its
parts stand out one above the other; a woofer is 3 steps high.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_prep.shapes.fronts import dial, frame, panel
from data_prep.shapes.palettes import LOUDSPEAKER, LOUDSPEAKER_CONES, shade, shade_of
from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import Color, Part

Place = tuple[float, float, float]

_CONE_WEIGHTS = {"paper": 0.50, "metal": 0.22, "kevlar": 0.12, "white": 0.08, "copper": 0.08}


@dataclass(frozen=True)
class Drivers:
    """The look of the drivers of one loudspeaker.

    woofers  number of equal ones
    woofer   radius as a share of the largest that fits the baffle's width
    tweeter  radius of its plate as a share of the baffle's width
    drop     how far down free room moves the drivers: 0 to the top, 1 to the bottom
    """

    woofers: int
    woofer: float
    tweeter: float
    port: bool
    drop: float
    baffle: Color
    cone: Color
    ring: Color
    cap: Color
    cloth: Color


def draw_drivers(rng: np.random.Generator, cabinet: Color, woofers: int) -> Drivers:
    """Return drivers for a cabinet of this colour; its baffle is black, or of the same colour."""
    cone = shade_of(rng, _CONE_WEIGHTS, LOUDSPEAKER_CONES)
    ring = shade(rng, LOUDSPEAKER["rubber"])
    baffle = (
        cabinet if chance(rng, 0.45) else shade(rng, ((40, 40, 42), (54, 54, 56), (30, 30, 32)))
    )
    return Drivers(
        woofers=woofers,
        woofer=uniform(rng, (0.78, 1.0)),
        tweeter=uniform(rng, (0.14, 0.24)),
        port=chance(rng, 0.4),
        drop=uniform(rng, (0.0, 0.5)),
        baffle=baffle,
        cone=cone,
        ring=shade(rng, ((150, 152, 156),)) if chance(rng, 0.22) else ring,
        cap=ring if chance(rng, 0.5) else cone,
        cloth=shade(rng, LOUDSPEAKER["cloth"]),
    )


def woofer(drivers: Drivers, centre: Place, radius: float, step: float) -> list[Part]:
    """Return a ring, a cone that deepens inwards, and a cap in its middle."""
    profile = [(1.0, -1.0), (1.0, 1.8), (0.94, 3.0), (0.84, 3.0), (0.78, 1.0)]
    ring = _round(centre, radius, step, profile, drivers.ring)
    profile = [(0.80, -0.8), (0.80, 2.6), (0.30, 1.8)]
    cone = _round(centre, radius, step, profile, drivers.cone)
    cap = _round(centre, radius, step, [(0.34, -0.6), (0.31, 2.6), (0.16, 3.4)], drivers.cap)
    return [ring, cone, cap]


def dome(drivers: Drivers, centre: Place, radius: float, step: float) -> list[Part]:
    """Return a tweeter: a round plate with a small dome."""
    plate = _round(centre, radius, step, [(1.0, -1.0), (1.0, 1.0), (0.9, 1.6)], drivers.ring)
    cap = _round(centre, radius, step, [(0.5, -0.7), (0.5, 2.0), (0.22, 3.4)], drivers.cone)
    return [plate, cap]


def port(drivers: Drivers, centre: Place, radius: float, step: float) -> list[Part]:
    """Return the mouth of a bass-reflex tube: a dark disc within a ring."""
    ring = _round(centre, radius, step, [(1.0, -1.0), (1.0, 1.6), (0.8, 2.4)], drivers.ring)
    dark: Color = (14, 14, 15)
    return [ring, _round(centre, radius, step, [(0.72, -0.7), (0.72, 3.0)], dark)]


def horn(drivers: Drivers, centre: Place, size: tuple[float, float], step: float) -> list[Part]:
    """Return a rectangular horn: a frame, its flare as a plate let in, and a dark throat."""
    width, height = size
    x, y, z = centre
    border = 0.12 * height
    outside = (width, height, 4 * step)
    inner = (width - border, height - border, 2.4 * step)
    throat = (0.28 * width, 0.42 * height, 3.6 * step)
    return [
        frame((x, y, z - step), outside, border, drivers.ring, corner=0.1 * height),
        panel((x, y, z - 0.4 * step), inner, drivers.baffle),
        panel((x, y, z - 0.6 * step), throat, (16, 16, 17)),
    ]


def _round(
    centre: Place, radius: float, step: float, profile: list[tuple[float, float]], color: Color
) -> Part:
    """Return a solid with a profile of (share of the radius, steps in front of the centre)."""
    return dial(centre, np.array(profile) * (radius, step), color)
