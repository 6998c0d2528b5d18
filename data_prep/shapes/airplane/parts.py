"""Wings, fins, engines and wheels of airplanes, and their colours.

Lengths are in fuselages: the nose is near z = -0.5, the tail near z = 0.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from data_prep.shapes.hulls import blade, disc, pair, spindle
from data_prep.shapes.solids import Color, Part, rectangle, sweep, tube


@dataclass(frozen=True)
class Wing:
    """A wing, or a tailplane, with its tips at x = -half_span and +half_span.

    y, z       leading edge at the root, x = 0
    sweep      how far the leading edge runs back per unit of span
    dihedral   how far it climbs per unit of span
    kink       share of the half span up to which the trailing edge runs straight across; 0: none
    thickness  in chords
    """

    half_span: float
    root: float
    tip: float
    y: float
    z: float
    sweep: float
    dihedral: float = 0.0
    kink: float = 0.0
    thickness: float = 0.11

    def chord(self, x: float) -> float:
        """Return the chord at the distance x from the middle."""
        knee = self.kink * self.half_span
        inner = max(self.root - knee * self.sweep, self.tip) if self.kink else self.root
        return float(np.interp(abs(x), (0.0, knee, self.half_span), (self.root, inner, self.tip)))

    def at(self, x: float, along: float = 0.0) -> tuple[float, float, float]:
        """Return the middle of the wing's thickness at `along` chords behind the leading edge."""
        height = self.y + abs(x) * self.dihedral
        return (x, height, self.z + abs(x) * self.sweep + along * self.chord(x))

    def part(self, color: Color) -> Part:
        """Return the wing from tip to tip, in one piece."""
        half = sorted({0.0, self.kink * self.half_span, self.half_span})
        stations = [
            (*self.at(x), self.chord(x), self.thickness * self.chord(x))
            for x in [*(-x for x in half[:0:-1]), *half]
        ]
        return blade(stations, color)


def upright_fin(
    foot: tuple[float, float, float],
    height: float,
    chords: tuple[float, float],
    sweep: float,
    color: Color,
    lean: float = 0.0,
) -> Part:
    """Return an upright fin; `lean` is how far its tip stands out in x."""
    x, y, z = foot
    root, tip = chords
    stations = [
        (x, y, z, root, 0.12 * root),
        (x + lean, y + height, z + sweep * height, tip, 0.12 * tip + 0.002),
    ]
    return blade(stations, color, upright=True)


def winglets_on(wing: Wing, height: float, color: Color) -> list[Part]:
    """Return winglets on both tips of a wing."""
    x, y, z = wing.at(0.99 * wing.half_span)
    chord = wing.chord(x)
    return pair(upright_fin((x, y, z), height, (chord, 0.5 * chord), 0.7, color, lean=0.006))


def turbofan(
    x: float, y: float, z: float, radius: float, length: float, shell: Color, dark: Color
) -> list[Part]:
    """Return a turbofan with its intake at z.

    The dark of intake and exhaust stands out of it.
    """
    nacelle = [
        (z, y, 0.86 * radius, 0.86 * radius),
        (z + 0.15 * length, y, radius, radius),
        (z + 0.6 * length, y, 0.94 * radius, 0.94 * radius),
        (z + length, y, 0.62 * radius, 0.62 * radius),
    ]
    core = [
        (z - 0.006, y, 0.6 * radius, 0.6 * radius),
        (z + 0.4 * length, y, 0.6 * radius, 0.6 * radius),
        (z + 1.14 * length, y, 0.36 * radius, 0.36 * radius),
    ]
    return [spindle(nacelle, shell, x=x, sides=10), spindle(core, dark, x=x, sides=8)]


def propeller_parts(
    centre: tuple[float, float, float],
    radius: float,
    blades: int,
    phase: float,
    dark: Color,
    spinner: Color,
) -> list[Part]:
    """Return a propeller in the plane of z, on a spinner that reaches back into its engine."""
    x, y, z = centre
    hub = 0.14 * radius
    parts = [
        spindle(
            [
                (z - 1.5 * hub, y, 0.2 * hub, 0.2 * hub),
                (z, y, hub, hub),
                (z + 2 * hub, y, hub, hub),
            ],
            spinner,
            x=x,
            sides=8,
        )
    ]
    for k in range(blades):
        angle = phase + 2 * math.pi * k / blades
        tip = (x + radius * math.cos(angle), y + radius * math.sin(angle), z)
        parts.append(sweep([centre, tip], rectangle(0.16 * radius, 0.010), dark, up=(0, 0, 1)))
    return parts


def undercarriage(
    places: list[tuple[float, float, float]], top: float, radius: float, leg: Color, tyre: Color
) -> list[Part]:
    """Return legs from y = `top` down to wheels at the places, which are given on one side."""
    parts = []
    for x, y, z in places:
        strut = tube([(0.2 * x, top, z), (x, y, z)], 0.007, leg, sides=6)
        wheel = disc((x, y, z), radius, 0.6 * radius, tyre, sides=12)
        parts += [strut, wheel] if x == 0 else pair(strut, wheel)
    return parts
