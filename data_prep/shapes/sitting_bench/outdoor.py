"""Benches of parks and gardens, and those without a back. Lengths in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from data_prep.shapes.furniture import beam, cushion, legs, run
from data_prep.shapes.palettes import BENCH, shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    curved_panel,
    moved,
    polygon,
    post,
    rectangle,
    rounded,
    slab,
)


def park(rng: np.random.Generator) -> list[Part]:
    """Return slats of wood on ends of iron, wood or stone."""
    length, depth = uniform(rng, (1.2, 2.1)), uniform(rng, (0.40, 0.52))
    height = uniform(rng, (0.40, 0.47))
    frame = shade_of(rng, {"dark-metal": 0.62, "paint": 0.16, "wood": 0.22})
    wood = shade(rng, "wood" if chance(rng, 0.85) else "paint")
    rake = math.radians(uniform(rng, (8, 20)))
    back = uniform(rng, (0.32, 0.48))
    thick = uniform(rng, (0.022, 0.045))
    support = uniform(rng, (0.04, 0.07))
    inset = uniform(rng, (0.0, 0.16)) * length + 0.6 * support
    places = [-length / 2 + inset, length / 2 - inset]
    if length > 1.7 and chance(rng, 0.5):
        places.insert(1, 0.0)
    stations = (-length / 2, *places, length / 2)
    parts = _slats(stations, (-depth / 2, depth / 2), height, thick, int(rng.integers(3, 8)), wood)
    hinge = (height - 0.5 * thick, depth / 2 + 0.01)
    count = int(rng.integers(2, 6))
    parts += [
        moved(part, (0.0, *hinge), tilt_rad=rake)
        for part in _upright_slats(stations, (0.12, back), thick, count, wood)
    ]
    blocks = chance(rng, 0.18)  # what stands on the ground is of stone
    stone = shade(rng, BENCH["stone"])
    arms = chance(rng, 0.1 if blocks else 0.65)
    arm_y = height + uniform(rng, (0.18, 0.24))
    front, rear = -depth / 2, depth / 2
    splay = uniform(rng, (0.0, 0.08))
    wide = uniform(rng, (0.10, 0.20))
    flat = rectangle(0.8 * support, support)
    slim = rectangle(0.6 * support, 0.8 * support)
    under = height - thick
    behind = hinge[1] + 0.35 * thick + 0.4 * support
    back_top = (height + back * math.cos(rake) - 0.02, behind + back * math.sin(rake) - 0.012)
    for x in places:
        # A bar under the seat, an upright behind the back, two legs; all meet in one another.
        parts.append(box((x, under - 0.015, 0.02), (0.8 * support, 0.05, depth + 0.05), frame))
        parts.append(post((x, under - 0.03, behind - 0.04), (x, *back_top), slim, slim, frame))
        outer = x in (places[0], places[-1])
        head_y = arm_y if arms and outer else under
        if blocks:
            foot, head = rectangle(1.15 * wide, 0.86 * depth), rectangle(wide, 0.86 * depth)
            parts.append(post((x, 0.0, 0.01), (x, under - 0.01, 0.01), foot, head, stone))
        else:
            parts.append(post((x, 0, rear + splay), (x, under, rear - 0.02), flat, flat, frame))
        if not blocks or head_y == arm_y:
            foot = (x, under - 0.03 if blocks else 0.0, front + (0.03 if blocks else -splay))
            parts.append(post(foot, (x, head_y, front + 0.03), flat, flat, frame))
        if head_y == arm_y:
            end = behind + (arm_y - height) * math.tan(rake)
            section, ends = rectangle(1.2 * support, 0.5 * support), (front - 0.03, end)
            parts.append(run(section, ends, frame, at=(x, arm_y), axis=2, bevel=0.008))
    return parts


def plank(rng: np.random.Generator) -> list[Part]:
    """Return a bench without a back: a plank, a slab of stone, a cushion, slats or an arc."""
    length, depth = uniform(rng, (1.0, 1.9)), uniform(rng, (0.32, 0.50))
    height = uniform(rng, (0.40, 0.48))
    kind = pick(rng, {"stone": 0.24, "wood": 0.32, "padded": 0.22, "slats": 0.12, "arc": 0.10})
    if kind == "arc":
        return _arc(rng, height)
    if kind == "padded":
        frame = shade_of(rng, {"wood": 0.5, "dark-metal": 0.3, "chrome": 0.2})
        color = shade(rng, "leather" if chance(rng, 0.4) else "upholstery")
        thick = uniform(rng, (0.09, 0.16))
        size = (length, thick, depth)
        parts = [cushion((0, height - thick / 2, 0), size, color, soft=0.3 * thick, corner=0.05)]
        section = polygon(8, uniform(rng, (0.016, 0.03)))
        under = height - 0.75 * thick
        out = uniform(rng, (0.0, 0.05))
        x, z = length / 2 - 0.1, depth / 2 - 0.07
        return parts + legs(x, z, under, 0.7 * section, section, frame, out=out)
    thick = uniform(rng, (0.03, 0.06)) if kind != "stone" else uniform(rng, (0.07, 0.13))
    seat = shade(rng, BENCH["stone"] if kind == "stone" else "wood")
    carrier = seat
    if not chance(rng, 0.5):
        carrier = shade(rng, BENCH["stone"] if chance(rng, 0.6) else "dark-metal")
    inset = uniform(rng, (0.10, 0.24)) * length
    under = height - thick
    stations = (-length / 2, inset - length / 2, length / 2 - inset, length / 2)
    if kind == "slats":
        parts = _slats(
            stations, (-depth / 2, depth / 2), height, thick, int(rng.integers(3, 7)), seat
        )
        for x in stations[1:3]:
            size = (0.07, 0.05, 0.98 * depth)
            parts.append(box((x, under - 0.013, 0), size, carrier))
    else:
        corner = pick(rng, {0.012: 0.7, 0.12: 0.3})
        outline = rounded(rectangle(length, depth), corner) / (length, depth)
        parts = [
            slab(outline, (0, height - thick / 2, 0), (length, thick, depth), seat, bevel=0.008)
        ]
    style = "legs" if kind == "slats" else pick(rng, {"blocks": 0.40, "panels": 0.30, "legs": 0.30})
    head = under + 0.01 if kind == "slats" else under + 0.4 * thick
    if style == "legs":
        bar = uniform(rng, (0.045, 0.075))
        x, z = length / 2 - inset, depth / 2 - 0.7 * bar
        square = rectangle(0.9 * bar, bar)
        out = uniform(rng, (0.0, 0.05))
        parts += legs(x, z, head, square, square, carrier, out=out)
        if out < 0.025:
            for i in (-x, x):
                parts.append(beam((i, 0.13, -z), (i, 0.13, z), 0.5 * bar, 0.8 * bar, carrier))
            parts.append(beam((-x, 0.13, 0), (x, 0.13, 0), 0.5 * bar, 0.8 * bar, carrier))
        return parts
    wide = uniform(rng, (0.14, 0.24)) if style == "blocks" else uniform(rng, (0.04, 0.07))
    foot = rectangle(wide * uniform(rng, (0.9, 1.5)), 0.94 * depth)
    for x in (inset - length / 2, length / 2 - inset):
        top = rectangle(wide, uniform(rng, (0.7, 0.9)) * depth)
        parts.append(post((x, 0, 0), (x, head, 0), foot, top, carrier))
    if style == "panels":
        half = length / 2 - inset
        parts.append(beam((-half, 0.5 * under, 0), (half, 0.5 * under, 0), 0.04, 0.1, carrier))
    return parts


def _arc(rng: np.random.Generator, height: float) -> list[Part]:
    """Return a bent bench without a back, on posts."""
    angle, half_width = uniform(rng, (0.5, 1.3)), uniform(rng, (0.7, 1.1))
    thick, depth = uniform(rng, (0.05, 0.10)), uniform(rng, (0.36, 0.44))
    seat = shade(rng, "wood" if chance(rng, 0.6) else BENCH["stone"])
    frame = shade(rng, "dark-metal")
    parts = [curved_panel(half_width, angle, depth, height - thick, height, seat, steps=16)]
    radius = half_width / math.sin(min(angle, math.pi / 2))
    section = polygon(8, 0.035)
    for r in (radius - 0.11, radius + 0.11):
        for a in np.linspace(-0.82, 0.82, 4) * angle:
            x, z = r * math.sin(a), r * math.cos(a) - radius
            parts.append(post((x, 0, z), (x, height - 0.5 * thick, z), section, section, frame))
    return parts


def picnic(rng: np.random.Generator) -> list[Part]:
    """Return a table with a bench on either side, all on the same crossed or splayed legs."""
    length = uniform(rng, (1.3, 2.1))
    wood = shade_of(rng, {"wood": 0.82, "paint": 0.18})
    frame = wood if chance(rng, 0.7) else shade(rng, "dark-metal")
    table_y, seat_y = uniform(rng, (0.70, 0.78)), uniform(rng, (0.42, 0.48))
    half_table, reach = uniform(rng, (0.33, 0.42)), uniform(rng, (0.62, 0.76))
    seat = uniform(rng, (0.22, 0.30))
    thick = uniform(rng, (0.032, 0.05))
    x = length / 2 - uniform(rng, (0.12, 0.2)) * length
    stations = (-length / 2, -x, x, length / 2)
    boards = int(rng.integers(4, 7))
    parts = _slats(stations, (-half_table, half_table), table_y, thick, boards, wood)
    for side in (-1, 1):
        edges = sorted((side * (reach - seat / 2), side * (reach + seat / 2)))
        parts += _slats(stations, (edges[0], edges[1]), seat_y, thick, 2, wood)
    bar = uniform(rng, (0.07, 0.10))
    section = rectangle(0.45 * bar, bar)
    tops = table_y - thick + 0.012, seat_y - thick + 0.012  # a little inside the slats
    low_z, high_z = reach - 0.05, 0.5 * half_table
    knee_y = tops[1] - 0.4 * bar
    knee_z = low_z + (high_z - low_z) * knee_y / tops[0]
    for i in (-x, x):
        for side in (-1, 1):
            # One straight leg in two pieces, which end in the bar under the seats.
            foot, knee, head = (0, low_z), (knee_y, knee_z), (tops[0] - 0.004, high_z)
            for (y0, z0), (y1, z1) in ((foot, knee), (knee, head)):
                ends = (i, y0, side * z0), (i, y1, side * z1)
                parts.append(post(*ends, section, section, frame))
        for y, half in zip(tops, (0.95 * half_table, reach + 0.46 * seat), strict=True):
            size = (0.5 * bar, 0.8 * bar, 2 * half)
            parts.append(box((i, y - 0.4 * bar, 0), size, frame))
    y = seat_y - thick - 0.3 * bar
    parts.append(beam((-x, y, 0), (x, y, 0), 0.04, 0.07, frame))
    return parts


def _across(low: float, high: float, count: int, gap: float) -> list[tuple[float, float]]:
    """Return middle and width of each of `count` bars that fill the way between two places.

    The gap between two bars is a given share of a bar's width.
    """
    pitch = (high - low) / (count - gap)
    return [(low + (k + 0.5 * (1 - gap)) * pitch, (1 - gap) * pitch) for k in range(count)]


def _slats(
    stations: Sequence[float],
    z: tuple[float, float],
    top: float,
    thick: float,
    count: int,
    color: Color,
) -> list[Part]:
    """Return level bars along x, `count` of them between two z, up to a height.

    `stations` are their ends in x and the places between them where something carries them.
    """
    parts = []
    for middle, width in _across(*z, count, 0.16):
        section = rounded(rectangle(width, thick), 0.2 * thick, steps=1)
        parts.append(run(section, stations, color, at=(middle, top - thick / 2)))
    return parts


def _upright_slats(
    stations: Sequence[float], y: tuple[float, float], thick: float, count: int, color: Color
) -> list[Part]:
    """Return upright bars along x in the plane z = 0, `count` of them between two heights."""
    parts = []
    for middle, width in _across(*y, count, 0.22):
        section = rounded(rectangle(thick, width), 0.2 * thick, steps=1)
        parts.append(run(section, stations, color, at=(0.0, middle)))
    return parts
