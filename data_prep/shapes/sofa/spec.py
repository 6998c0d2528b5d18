"""Parts that most sofas have in common: measures, colours, cushions and feet.

Lengths are in metres: x is to the side, y up from the floor, z to the rear; the middle of the main
seat is at x = z = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.furniture import back_cushion, cushion, legs
from data_prep.shapes.palettes import shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, polygon, rectangle, rounded

_SUNK = 0.012  # m, by which a cushion sinks into what it lies on

# What a family is covered with, as weights.
_COVERS: dict[str, dict[str, float]] = {
    "box-arm": {"upholstery": 0.62, "leather": 0.28, "office-fabric": 0.10},
    "rolled-arm": {"upholstery": 0.38, "leather": 0.62},
    "sectional": {"upholstery": 0.60, "leather": 0.28, "office-fabric": 0.12},
    "open-frame": {"upholstery": 0.66, "leather": 0.34},
    "armless": {"upholstery": 0.48, "leather": 0.22, "office-fabric": 0.30},
    "curved": {"upholstery": 0.70, "leather": 0.20, "plastic": 0.10},
}


@dataclass(frozen=True)
class SofaSpec:
    """The measures and colours of a sofa, with lengths in metres.

    seats    cushions side by side, 1 to 4; `seat` is the width of one
    depth    front to rear, over all
    low      underside of the body; 0 where it stands on the floor
    deck     what the seat cushions lie on, above the floor; `thick` is their thickness
    arm      an arm's thickness; `arm_top` and `back_top` are heights above the floor
    wall     thickness of the back at its foot; `rake_rad` is how far its front leans
    """

    seats: int
    seat: float
    depth: float
    low: float
    deck: float
    thick: float
    arm: float
    arm_top: float
    back_top: float
    wall: float
    rake_rad: float
    body: Color
    cushions: Color
    feet: Color
    pillows: Color

    @property
    def inside(self) -> float:
        """Return the width between the arms."""
        return self.seats * self.seat

    @property
    def half(self) -> float:
        """Return half of the width over all."""
        return self.inside / 2 + self.arm

    @property
    def sitting(self) -> float:
        """Return the height of the seat."""
        return self.deck + self.thick - _SUNK

    def back_front(self, y: float) -> float:
        """Return z of the back's front at a height."""
        return self.depth / 2 - self.wall + (y - self.deck) * math.tan(self.rake_rad)


def draw_sofa_spec(rng: np.random.Generator, family: str) -> SofaSpec:
    """Draw measures and colours at random, as they suit a family."""
    seats = pick(rng, {1: 0.14, 2: 0.34, 3: 0.42, 4: 0.10})
    if family == "sectional":
        seats = pick(rng, {2: 0.55, 3: 0.45})
    seat = uniform(rng, (0.62, 0.80) if seats == 1 else (0.50, 0.76))
    low = uniform(rng, pick(rng, {(0.0, 0.0): 0.30, (0.03, 0.08): 0.40, (0.08, 0.16): 0.30}))
    deck = uniform(rng, (0.25, 0.32))
    thick = uniform(rng, (0.10, 0.19))
    sitting = deck + thick
    body = shade_of(rng, _COVERS[family])
    return SofaSpec(
        seats=seats,
        seat=seat,
        depth=uniform(rng, (0.78, 1.02)),
        low=low,
        deck=deck,
        thick=thick,
        arm=uniform(rng, (0.09, 0.26)),
        arm_top=sitting + uniform(rng, (0.09, 0.24)),
        back_top=sitting + uniform(rng, (0.30, 0.50)),
        wall=uniform(rng, (0.14, 0.22)),
        rake_rad=math.radians(uniform(rng, (4, 16))),
        body=body,
        cushions=body if chance(rng, 0.72) else shade(rng, "upholstery"),
        feet=shade_of(rng, {"wood": 0.62, "dark-metal": 0.22, "chrome": 0.16}),
        pillows=shade(rng, "upholstery"),
    )


def back_profile(spec: SofaSpec, top: float) -> Floats:
    """Return the section (z, y) of a back whose rear stands upright and whose front leans."""
    rear = spec.depth / 2 + 0.012
    foot = spec.low + 0.03
    front_foot = spec.back_front(foot)
    front_top = min(spec.back_front(top), rear - 0.05)
    corners = np.array([(front_foot, foot), (front_top, top), (rear, top), (rear, foot)])
    return rounded(corners, 0.022, steps=2)


def seat_cushions(
    spec: SofaSpec, x: tuple[float, float], z: tuple[float, float], count: int
) -> list[Part]:
    """Return `count` cushions side by side on the deck."""
    width = (x[1] - x[0]) / count
    soft = 0.32 * spec.thick
    size = (width - 0.008, spec.thick, z[1] - z[0])
    y = spec.deck - _SUNK + spec.thick / 2
    centres = [(x[0] + (k + 0.5) * width, y, (z[0] + z[1]) / 2) for k in range(count)]
    return [cushion(centre, size, spec.cushions, soft=soft, corner=0.07) for centre in centres]


def back_cushions(
    spec: SofaSpec, x: tuple[float, float], count: int, height: float, thickness: float
) -> list[Part]:
    """Return `count` cushions side by side that stand on the seat and lean on the back."""
    width = (x[1] - x[0]) / count
    z = spec.back_front(spec.sitting) - 0.42 * thickness
    size = (width - 0.01, height, thickness)
    return [
        back_cushion(
            (x[0] + (k + 0.5) * width, spec.sitting - 0.03, z),
            size,
            spec.cushions,
            soft=0.36 * thickness,
            tilt_rad=spec.rake_rad,
        )
        for k in range(count)
    ]


def throw_pillows(rng: np.random.Generator, spec: SofaSpec, half_x: float, z: float) -> list[Part]:
    """Return up to two pillows of another colour, often none.

    They lean back near the ends of the seat.
    """
    if not chance(rng, 0.35):
        return []
    edge = uniform(rng, (0.30, 0.42))
    sides = (-1, 1) if chance(rng, 0.6) else (int(rng.choice([-1, 1])),)
    return [
        back_cushion(
            (side * (half_x - 0.56 * edge), spec.sitting - 0.04, z - 0.10),
            (edge, edge, 0.13),
            spec.pillows,
            soft=0.05,
            tilt_rad=0.38,
        )
        for side in sides
    ]


def feet(
    spec: SofaSpec, x: float, z: float, centre: tuple[float, float] = (0.0, 0.0)
) -> list[Part]:
    """Return four feet under a body, `x` and `z` from its middle.

    There are none where it stands on the floor.
    """
    if spec.low == 0.0:
        return []
    wide = 0.045 + 0.2 * spec.low
    head = polygon(8, wide / 2) if spec.low > 0.08 else rectangle(wide, wide)
    return legs(x, z, spec.low + 0.02, 0.7 * head, head, spec.feet, centre=centre)
