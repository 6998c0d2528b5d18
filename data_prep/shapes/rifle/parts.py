"""Parts of rifles, with lengths in metres.

A rifle lies along z with its muzzle towards -z; the bore is at y = 0, the trigger near z = 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.palettes import RIFLE, shade_of
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    fillet,
    lathe,
    moved,
    post,
    prism,
    rectangle,
    rounded,
    sections,
    sweep,
    tube,
)

SECTION = rounded(rectangle(1.0, 1.0), 0.2, steps=1)  # a square without its corners
_KNOB = rounded(rectangle(0.018, 0.018), 0.005, steps=1)


tint = partial(shade_of, palette=RIFLE)


def stock(stations: ArrayLike, color: Color) -> Part:
    """Return a bar along z whose height and width change; its edges are taken off.

    stations  [k, 4]: z, lower y, upper y, width
    """
    z, low, high, width = np.asarray(stations, dtype=np.float64).T
    centres = np.stack([np.zeros_like(z), (low + high) / 2], axis=1)
    return prism(2, sections(SECTION, centres, np.stack([width, high - low], axis=1)), z, color)


def pipe(
    profile: ArrayLike, color: Color, *, x: float = 0.0, y: float = 0.0, sides: int = 10
) -> Part:
    """Return a solid turned about the line x, y along z; profile [k, 2]: (radius > 0, z)."""
    return moved(lathe(profile, color, sides=sides), (x, y, 0), tilt_rad=math.pi / 2)


def handle(
    head: Sequence[float], drop: float, back: float, depth: float, width: float, color: Color
) -> Part:
    """Return a pistol grip that hangs `drop` below head (y, z), its end `back` behind it."""
    section = rounded(rectangle(width, depth), 0.2 * width, steps=1)
    y, z = head
    return post((0, y - drop, z + back), (0, y, z), section, 0.85 * section, color)


def magazine(
    head: Sequence[float], drop: float, ahead: float, depth: float, width: float, color: Color
) -> Part:
    """Return a box magazine that hangs `drop` below head (y, z), bent by `ahead` at its end.

    It is bent forwards.
    """
    y, z = head
    t = np.linspace(0.0, 1.0, 5 if ahead else 2)
    bend = np.stack([np.zeros_like(t), ahead * (t**2)], axis=1)
    # The end of a bent one is square to its bend: its front stays higher than its rear.
    slope = 1.2 * ahead / drop * np.outer(t, rectangle(0.0, depth)[:, 1])
    outlines = np.add(rectangle(width, depth), (0.0, z)) - bend[:, None]
    return prism(1, outlines, y - (drop * t[:, None] + slope), color)


def trigger(y: float, front_z: float, rear_z: float, color: Color) -> list[Part]:
    """Return a guard hung from the height y, and the trigger in it."""
    low = y - 0.036
    path = [(0, y + 0.006, front_z), (0, low, front_z + 0.008), (0, low, rear_z - 0.008)]
    path = fillet([*path, (0, y + 0.006, rear_z)], 0.012, 2)
    middle = 0.4 * front_z + 0.6 * rear_z
    blade = tube([(0, y + 0.006, middle), (0, y - 0.022, middle - 0.006)], 0.0035, color, sides=4)
    return [tube(path, 0.0038, color, sides=5), blade]


def scope(y: float, floor_y: float, rear_z: float, length: float, color: Color) -> list[Part]:
    """Return a telescopic sight whose axis is at y, on two feet that reach down to `floor_y`."""
    front = rear_z - length
    thin, eye, lens = 0.013, 0.019, 0.024 if length > 0.2 else 0.018
    profile = [
        (eye, rear_z),
        (eye, rear_z - 0.22 * length),
        (thin, rear_z - 0.30 * length),
        (thin, front + 0.34 * length),
        (lens, front + 0.22 * length),
        (lens, front),
    ]
    parts = [pipe(profile, color, y=y)]
    for share in (0.36, 0.60):
        z = rear_z - share * length
        parts.append(box((0, (y + floor_y) / 2, z), (0.014, y - floor_y, 0.022), color))
    middle = rear_z - 0.48 * length
    knob = post((0, y, middle), (0, y + 0.026, middle), _KNOB, _KNOB, color)
    return [*parts, knob]


def bipod(y: float, z: float, drop: float, lean: float, color: Color) -> list[Part]:
    """Return two legs from a clamp on the barrel; their feet are `lean` ahead of it."""
    clamp = box((0, y, z), (0.034, 0.028, 0.026), color)
    feet = [(side * 0.42 * drop, y - drop, z - lean) for side in (-1.0, 1.0)]
    return [clamp, *(tube([(0, y, z), foot], 0.0065, color, sides=5) for foot in feet)]


def front_sight(z: float, height: float, color: Color) -> Part:
    """Return a wedge on the barrel."""
    foot, tip = rectangle(0.012, 0.035), rectangle(0.005, 0.012)
    return post((0, 0, z), (0, height, z), foot, tip, color)


def wire_stock(rear_z: float, length: float, top_y: float, drop: float, color: Color) -> list[Part]:
    """Return a folding stock: a rod, a strut below it and a plate for the shoulder."""
    butt = rear_z + length
    upper = tube([(0, top_y, rear_z - 0.03), (0, top_y, butt)], 0.0085, color, sides=6)
    path = [(0, top_y - 0.02, rear_z - 0.02), (0, top_y - drop + 0.01, butt)]
    plate = stock(
        [
            (butt - 0.010, top_y - drop, top_y + 0.016, 0.03),
            (butt + 0.012, top_y - drop - 0.01, top_y + 0.02, 0.036),
        ],
        color,
    )
    return [upper, tube(path, 0.007, color, sides=6), plate]


def carry_handle(y: float, rear_z: float, length: float, color: Color) -> Part:
    """Return an arched bar over the receiver, whose ends are sunk below the height y."""
    front, top = rear_z - length, y + 0.045
    path = [(0, y - 0.012, rear_z), (0, top, rear_z - 0.02), (0, top, front + 0.05)]
    return sweep([*path, (0, y - 0.012, front)], rectangle(0.018, 0.015), color, up=(0, 0, 1))
