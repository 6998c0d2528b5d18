"""The measures and colours of a car, and the tables they are drawn from.

Lengths are in metres: y = 0 is the road, the nose is towards -z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_prep.shapes.car.cabins import Cabin
from data_prep.shapes.palettes import CAR, CAR_PAINTS, shade, shade_of
from data_prep.shapes.random_choices import uniform
from data_prep.shapes.solids import Color

_Range = tuple[float, float]


@dataclass(frozen=True)
class Proportions:
    """The ranges of a family; each value is uniform within its range.

    length, width, height  metres
    belt                   lower edge of the windows, in heights
    cowl, roof, tail       along the car, in lengths from the nose: lower edge of the windscreen,
                           both ends of the roof, lower edge of the rear window
    wheel                  radius, metres
    clearance              from the road to the sills, metres
    """

    length: _Range
    width: _Range
    height: _Range
    belt: _Range
    cowl: _Range
    roof: tuple[_Range, _Range]
    tail: _Range
    wheel: _Range
    clearance: _Range


PROPORTIONS = {
    "sedan": Proportions(
        *((4.2, 5.1), (1.70, 1.90), (1.38, 1.52), (0.62, 0.68), (0.26, 0.32)),
        *(((0.41, 0.46), (0.68, 0.74)), (0.82, 0.90), (0.31, 0.35), (0.18, 0.24)),
    ),
    "coupe": Proportions(
        *((4.1, 4.8), (1.78, 2.00), (1.14, 1.32), (0.64, 0.72), (0.30, 0.38)),
        *(((0.47, 0.52), (0.62, 0.68)), (0.86, 0.95), (0.32, 0.37), (0.13, 0.18)),
    ),
    "suv": Proportions(
        *((4.2, 5.1), (1.78, 2.00), (1.66, 1.90), (0.58, 0.64), (0.24, 0.30)),
        *(((0.34, 0.40), (0.90, 0.94)), (0.96, 0.985), (0.36, 0.42), (0.28, 0.38)),
    ),
    "hatchback": Proportions(
        *((3.4, 4.2), (1.62, 1.80), (1.40, 1.58), (0.58, 0.66), (0.20, 0.27)),
        *(((0.36, 0.42), (0.80, 0.89)), (0.95, 0.98), (0.28, 0.33), (0.17, 0.22)),
    ),
    "van": Proportions(
        *((4.4, 5.6), (1.80, 2.05), (1.85, 2.35), (0.48, 0.56), (0.08, 0.16)),
        *(((0.20, 0.28), (0.95, 0.97)), (0.98, 0.99), (0.32, 0.37), (0.22, 0.30)),
    ),
    "pickup": Proportions(
        *((4.9, 5.7), (1.80, 2.05), (1.68, 1.90), (0.60, 0.65), (0.22, 0.28)),
        *(((0.31, 0.36), (0.44, 0.56)), (0.0, 0.0), (0.36, 0.43), (0.28, 0.40)),
    ),
    "convertible": Proportions(
        *((3.8, 4.6), (1.66, 1.88), (1.16, 1.32), (0.66, 0.74), (0.32, 0.38)),
        *(((0.44, 0.47), (0.62, 0.68)), (0.70, 0.76), (0.30, 0.35), (0.14, 0.19)),
    ),
}
_PAINT_WEIGHTS = {
    "sedan": {
        "silver": 0.30,
        "dark": 0.28,
        "white": 0.14,
        "blue": 0.12,
        "red": 0.09,
        "green": 0.07,
    },
    "coupe": {"red": 0.30, "bright": 0.26, "silver": 0.16, "blue": 0.14, "dark": 0.14},
    "suv": {"dark": 0.34, "silver": 0.24, "green": 0.18, "white": 0.12, "red": 0.07, "blue": 0.05},
    "hatchback": {"blue": 0.25, "red": 0.22, "bright": 0.20, "white": 0.16, "silver": 0.17},
    "van": {"white": 0.55, "silver": 0.15, "blue": 0.14, "dark": 0.08, "red": 0.08},
    "pickup": {"red": 0.26, "dark": 0.24, "white": 0.22, "blue": 0.14, "green": 0.14},
    "convertible": {"red": 0.35, "bright": 0.25, "silver": 0.15, "green": 0.15, "blue": 0.10},
}
# A wheel arch, as corners on the unit circle.
ARCH = ((-1.0, 0.0), (-0.8, 0.6), (-0.4, 0.917), (0.4, 0.917), (0.8, 0.6), (1.0, 0.0))


@dataclass(frozen=True)
class Car:
    """The measures of one car, in metres; z counts from the middle of its length.

    half     half of the width
    belt     lower edge of the windows
    arch     radius of a wheel arch
    axles    z of both
    """

    length: float
    half: float
    height: float
    belt: float
    clearance: float
    wheel: float
    arch: float
    axles: tuple[float, float]
    paint: Color
    glass: Color
    tyre: Color
    hub: Color
    light: Color

    @property
    def arch_top(self) -> float:
        """Return the height to which the wheel arches are cut."""
        return self.wheel + ARCH[2][1] * self.arch

    def z(self, share: float) -> float:
        """Return the place at this share of the length, from the nose."""
        return (share - 0.5) * self.length


def draw_car(rng: np.random.Generator, family: str) -> tuple[Car, Cabin]:
    """Return the measures and colours of a car of this family, and its cabin."""
    given = PROPORTIONS[family]
    length, width, height = (uniform(rng, r) for r in (given.length, given.width, given.height))
    belt, wheel = uniform(rng, given.belt) * height, uniform(rng, given.wheel)
    cowl, roof_front = uniform(rng, given.cowl), uniform(rng, given.roof[0])
    roof_rear, tail = uniform(rng, given.roof[1]), uniform(rng, given.tail)
    if family == "pickup":
        tail = roof_rear + 0.03
    arch = wheel + uniform(rng, (0.04, 0.07))
    front = uniform(rng, (0.165, 0.20)) * length + 0.02
    rear = uniform(rng, (0.775, 0.81)) * length - 0.02
    car = Car(
        length=length,
        half=width / 2,
        height=height,
        belt=max(belt, wheel + arch + 0.06),
        clearance=uniform(rng, given.clearance),
        wheel=wheel,
        arch=arch,
        axles=(front - length / 2, rear - length / 2),
        paint=shade_of(rng, _PAINT_WEIGHTS[family], CAR_PAINTS),
        glass=shade(rng, CAR["glass"]),
        tyre=shade(rng, CAR["tyre"]),
        hub=shade(rng, CAR["hub"]),
        light=shade(rng, CAR["headlight"]),
    )
    cabin = Cabin(
        foot=(car.z(cowl), car.z(tail)),
        roof=(car.z(roof_front), car.z(roof_rear)),
        low=car.belt - 0.05,
        high=height - 0.03,
        half_widths=(0.90 * car.half, uniform(rng, (0.70, 0.80)) * car.half),
    )
    return car, cabin
