"""Solids that tables, sofas and benches have in common: bars, legs and cushions.

Lengths are in metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from data_prep.arrays import Floats
from data_prep.shapes.solids import (
    Color,
    Part,
    layered,
    loft,
    moved,
    post,
    prism,
    rectangle,
    rings_across,
    rounded,
)


def run(
    profile: ArrayLike,
    stations: Sequence[float],
    color: Color,
    *,
    at: tuple[float, float] = (0.0, 0.0),
    axis: int = 0,
    bevel: float = 0.0,
) -> Part:
    """Return a bar of one convex section, along x (axis 0) or z (axis 2).

    profile   [n, 2]: (z, y) of a bar along x, (x, y) of one along z
    at        added to the profile
    stations  at least two places along the axis, ascending. A ring of vertices between the ends
              changes nothing in its shape; it shows where the bar is sunk into what carries it.
    bevel     length by which both ends are drawn in, from all sides, at 45 degrees; has to be less
              than half of the section's extents
    """
    section = np.add(profile, at)
    places = [(place, section) for place in stations]
    if bevel > 0.0:
        low, high = section.min(axis=0), section.max(axis=0)
        middle, drawn_in = (low + high) / 2, 1 - 2 * bevel / (high - low)
        end = middle + (section - middle) * drawn_in
        first, last = stations[0], stations[-1]
        places = [(first, end), (first + bevel, section), *places[1:-1]]
        places += [(last - bevel, section), (last, end)]
    along, outlines = zip(*places, strict=True)
    return prism(axis, outlines, along, color)


def legs(
    x: float,
    z: float,
    height: float,
    foot: Floats,
    head: Floats,
    color: Color,
    *,
    out: float = 0.0,
    centre: tuple[float, float] = (0.0, 0.0),
) -> list[Part]:
    """Return four legs from the floor to `height`, whose heads are at `centre` +- (x, z).

    foot, head  [n, 2], sections in (x, z)
    out         how far the feet stand outside the heads, in x and in z
    """
    cx, cz = centre
    return [
        post(
            (cx + i * (x + out), 0.0, cz + k * (z + out)),
            (cx + i * x, height, cz + k * z),
            foot,
            head,
            color,
        )
        for i in (-1.0, 1.0)
        for k in (-1.0, 1.0)
    ]


def beam(start: ArrayLike, end: ArrayLike, width: float, height: float, color: Color) -> Part:
    """Return a straight bar of rectangular section between two points [3] at different x or z.

    The section stands upright: `width` is level and across the bar, `height` is vertical.
    """
    ends = np.array([start, end], dtype=np.float64)
    along = ends[1] - ends[0]
    level = np.hypot(along[0], along[2])
    across = np.array([-along[2], 0.0, along[0]]) / level
    section = rectangle(width, height)
    rings = ends[:, None] + section[None, :, :1] * across + section[None, :, 1:] * (0.0, 1.0, 0.0)
    return loft(rings, color)


def cushion(
    centre: ArrayLike, size: ArrayLike, color: Color, *, soft: float, corner: float = 0.12
) -> Part:
    """Return a level cushion of size (x, y, z) with rounded edges.

    soft    radius of the edges; less than half of every extent
    corner  where the corners of the outline begin, as a share of its sides, less than 0.5
    """
    sy = np.asarray(size, dtype=np.float64)[1]
    outline = rounded(rectangle(1.0, 1.0), corner, steps=1)
    # A quarter of a circle in two steps: (below the top, in from the side), for both sides.
    quarter = [(0.0, 1.0), (1 - math.sqrt(0.5), 1 - math.sqrt(0.5)), (1.0, 0.0)]
    upper = [(sy / 2 - down * soft, inset * soft) for down, inset in quarter]
    levels = [*((-y, inset) for y, inset in upper), *upper[::-1]]
    return layered(outline, centre, size, levels, color)


def trough(
    half: float,
    arm: float,
    heights: tuple[float, float, float],
    edge: float,
    depth: float,
    color: Color,
    *,
    slope: float = 0.0,
) -> Part:
    """Return the base and arms of a seat as one solid.

    Boxes would hide a part of their sides in each other.

    half     half of the width over all
    arm      thickness of the arms
    heights  of the lower side, of the seat's deck, and of the arms
    edge     taken off the arms' upper edges
    slope    how much lower an arm is in front than behind
    """
    low, deck, top = heights
    outer = np.array([(edge - half, top), (-half, top - edge), (-half, low)])
    inner = np.array([(arm - edge - half, top), (arm - half, top - edge), (arm - half, deck)])
    outer, inner = (np.concatenate([line, line[::-1] * (-1, 1)]) for line in (outer, inner))
    front, rear = -0.5 * depth, 0.5 * depth
    rings = rings_across(2, [outer, outer, inner, inner], [front, rear, rear, front])
    for line in (0, 3):  # those in front
        rings[line, (0, 1, -2, -1), 1] -= slope
    return loft(rings.swapaxes(0, 1), color)


def back_cushion(
    foot: ArrayLike, size: ArrayLike, color: Color, *, soft: float, tilt_rad: float
) -> Part:
    """Return a cushion of (width, height, thickness) that stands on `foot` [3].

    It leans to the rear (+z).

    `foot` is the middle of its lower side; see `cushion` for `soft`.
    """
    width, height, thickness = np.asarray(size, dtype=np.float64)
    lying = cushion((0, 0, 0), (width, thickness, height), color, soft=soft)
    standing = moved(lying, (0.0, height / 2, 0.0), tilt_rad=math.pi / 2)
    return moved(standing, foot, tilt_rad=tilt_rad)
