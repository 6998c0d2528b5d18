"""Parts of telephones: plates, keys, dials, handsets.

Lengths are in centimetres.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.fronts import panel
from data_prep.shapes.palettes import TELEPHONE, shade_of
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    fillet,
    lathe,
    moved,
    prism,
    rectangle,
    rounded,
    sections,
    tube,
)

CUP_PLACE = 0.375  # of a handset's length, from its middle to its ear and mouth pieces


tint = partial(shade_of, palette=TELEPHONE)


def key_color(rng: np.random.Generator, body: Color) -> Color:
    """Return the colour of keys: light on a dark body, and the other way round."""
    return tint(rng, {"silver": 0.8, "white": 0.2} if sum(body) < 330 else {"black": 1.0})


def plate(
    centre: ArrayLike,
    size: tuple[float, float, float],
    corner: float,
    color: Color,
    *,
    bevel: float = 0.0,
) -> Part:
    """Return an upright plate of size (x, y, z) with round corners.

    Its broad sides face -z and +z.
    """
    corner = min(corner, 0.48 * size[0], 0.48 * size[1])
    return panel(centre, size, color, corner=corner, bevel=bevel, steps=3)


def keypad(
    x: tuple[float, float],
    y: tuple[float, float],
    columns_rows: tuple[int, int],
    front: float,
    color: Color,
    *,
    rise: float = 0.22,
) -> list[Part]:
    """Return keys in a grid that fills x and y, `rise` in front of a face at z = `front`."""
    columns, rows = columns_rows
    across, up = (x[1] - x[0]) / columns, (y[1] - y[0]) / rows
    size = 0.74 * across, 0.62 * up, rise + 0.4
    return [
        box((key_x, key_y, front + 0.2 - rise / 2), size, color)
        for key_y in y[0] + up * (np.arange(rows) + 0.5)
        for key_x in x[0] + across * (np.arange(columns) + 0.5)
    ]


def antenna(foot: tuple[float, float, float], length: float, radius: float, color: Color) -> Part:
    """Return a round stub that stands on `foot`."""
    profile = [(radius, 0), (radius, 0.9 * length), (0.6 * radius, length)]
    return moved(lathe(profile, color, sides=10), foot)


def dial(radius: float, face: Color, ring: Color) -> list[Part]:
    """Return a disc with ten finger holes around a hub, its face towards -z.

    Holes and hub have the colour `ring`, and stand out: nothing is let in.
    """
    parts = [lathe([(radius, -0.5), (radius, 0.3), (0.93 * radius, 0.6)], face, sides=20)]
    for angle in np.radians(np.arange(10) * 30.0 - 60.0):
        hole = lathe([(0.125 * radius, 0.0), (0.125 * radius, 0.85)], ring, sides=8)
        parts.append(
            moved(hole, (0.72 * radius * math.cos(angle), 0, 0.72 * radius * math.sin(angle)))
        )
    parts.append(lathe([(0.36 * radius, 0.0), (0.36 * radius, 0.8)], ring, sides=12))
    return [moved(part, (0, 0, 0), tilt_rad=-math.pi / 2) for part in parts]


def handset(length: float, width: float, thick: float, color: Color) -> list[Part]:
    """Return a receiver along y whose ear and mouth pieces reach 0.72 `thick` towards +z.

    These are at CUP_PLACE of the length from its middle.
    """
    half = length / 2
    stations = np.array(  # y, z, width, thickness
        [
            (-half, 0.0, 0.80 * width, 0.45 * thick),
            (-half + 0.12 * length, -0.10 * thick, width, 0.80 * thick),
            (-half + 0.26 * length, -0.28 * thick, 0.72 * width, 0.70 * thick),
            (0.0, -0.42 * thick, 0.62 * width, 0.60 * thick),
            (half - 0.26 * length, -0.28 * thick, 0.72 * width, 0.70 * thick),
            (half - 0.12 * length, -0.10 * thick, width, 0.80 * thick),
            (half, 0.0, 0.80 * width, 0.45 * thick),
        ]
    )
    section = rounded(rectangle(1.0, 1.0), 0.28, steps=1)
    centres = stations[:, :2] * (0.0, 1.0)
    grip = prism(1, sections(section, centres, stations[:, 2:]), stations[:, 0], color)
    cup = lathe(
        [(0.46 * width, -0.2), (0.46 * width, 0.3 * thick), (0.38 * width, 0.62 * thick)], color
    )
    cups = [
        moved(cup, (0, y, 0.1 * thick), tilt_rad=math.pi / 2)
        for y in (-CUP_PLACE * length, CUP_PLACE * length)
    ]
    return [grip, *cups]


def wedge(width: float, z: tuple[float, float], heights: tuple[float, float], color: Color) -> Part:
    """Return a body on the floor from z[0] to z[1] whose top rises between two heights."""
    (front, rear), (low, high) = z, heights
    section = np.array([(front, 0.0), (rear, 0.0), (rear, high), (front, low)])
    section = rounded(section, 0.4 * min(low, high, 3.0))
    centre, edge = section.mean(axis=0), 0.6
    smaller = centre + (section - centre) * (1 - 2 * edge / np.ptp(section, axis=0))
    places = (-width / 2, edge - width / 2, width / 2 - edge, width / 2)
    return prism(0, [smaller, section, section, smaller], places, color)


def hood(
    foot: tuple[float, float, float], head: tuple[float, float, float], y: ArrayLike, color: Color
) -> Part:
    """Return a body that narrows upwards from (width, front z, rear z) to (width, ...).

    `foot` and `head` are such triples, y is three heights.

    It is upright between the first two heights and narrows to the third.
    """
    outlines = [
        np.add(rounded(rectangle(width, rear - front), 1.5), (0.0, (front + rear) / 2))
        for width, front, rear in (foot, foot, head)
    ]
    return prism(1, outlines, y, color)


def leaned(part: Part, offset: ArrayLike) -> Part:
    """Return the part laid down, its +y towards +x, then shifted by [3]."""
    x, y, z = part.vertices.T
    return Part(
        np.stack([y, -x, z], axis=1) + np.asarray(offset, dtype=np.float64), part.faces, part.color
    )


def cord(x: float, front: float, y: float, side: float, color: Color) -> Part:
    """Return the cord from a handset's end round the body's left side, lying on the floor."""
    path = [(x, 0.6 * y, front + 1.0), (x, 0.6 * y, front - 1.6), (side + 2.0, 0.5, front - 1.6)]
    path = [*path, (side + 2.0, 0.5, front + 6.0), (side - 1.0, 0.5, front + 7.5)]
    return tube(fillet(path, 1.2, 3), 0.35, color, sides=6)
