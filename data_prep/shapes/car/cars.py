"""Procedural cars: one body colour, tinted windows, black tyres."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.car.bodies import (
    body_shell,
    deck_line,
    hood_line,
    light_parts,
    mirror_parts,
    running_gear,
)
from data_prep.shapes.car.cabins import Cabin
from data_prep.shapes.car.spec import draw_car
from data_prep.shapes.hulls import pair
from data_prep.shapes.palettes import CAR, shade
from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import Part, box, loft, post, rectangle, rim, tube


def closed(rng: np.random.Generator, family: str) -> list[Part]:
    """Return a sedan, coupe, SUV or hatchback: a cabin of glass between pillars, under a roof."""
    car, cabin = draw_car(rng, family)
    nose = uniform(rng, (0.76, 0.88)) if family == "suv" else uniform(rng, (0.66, 0.82))
    top = [*hood_line(car, cabin, nose), *deck_line(car, uniform(rng, (0.0, 0.04)))]
    middles = {"sedan": (0.5,), "coupe": (), "suv": (0.36, 0.68), "hatchback": (0.48,)}[family]
    rear = {"sedan": 0.16, "coupe": 0.22, "suv": 0.14, "hatchback": 0.20}[family]
    parts = [
        body_shell(car, top),
        *running_gear(car),
        cabin.shell(car.glass, 0.0, (0.0, 0.97)),
        cabin.top(car.paint),
        *cabin.pillars(car.paint, middles, rear),
        *mirror_parts(car, cabin),
        *light_parts(rng, car, nose, car.belt - 0.20, uniform(rng, (0.22, 0.34))),
    ]
    if family == "coupe" and chance(rng, 0.4):
        high, z = car.belt + uniform(rng, (0.10, 0.22)), car.length / 2 - 0.16
        parts.append(box((0, high, z), (1.7 * car.half, 0.045, 0.24), car.paint))
        stay = box(
            (0.55 * car.half, (high + car.belt) / 2 - 0.05, z - 0.02),
            (0.07, high - car.belt + 0.10, 0.14),
            car.paint,
        )
        parts += pair(stay)
    if family == "suv" and chance(rng, 0.6):
        x, y = 0.86 * cabin.half_widths[1], car.height + 0.05
        front, back = cabin.roof[0] + 0.25, cabin.roof[1] - 0.15
        rail = [
            (x, y - 0.12, front),
            (x, y, front + 0.08),
            (x, y, back - 0.08),
            (x, y - 0.12, back),
        ]
        parts += pair(tube(rail, 0.025, car.tyre, sides=6))
    return parts


def van(rng: np.random.Generator) -> list[Part]:
    """Return a tall box with a short nose; a panel van has no windows behind the front doors."""
    car, drawn = draw_car(rng, "van")
    cabin = Cabin(
        drawn.foot,
        drawn.roof,
        drawn.low,
        drawn.high,
        (0.96 * car.half, uniform(rng, (0.86, 0.92)) * car.half),
    )
    nose = uniform(rng, (0.72, 0.86))
    parts = [
        body_shell(car, [*hood_line(car, cabin, nose), *deck_line(car, 0.0)]),
        *running_gear(car),
    ]
    parts += [cabin.shell(car.glass, 0.0, (0.0, 0.9)), cabin.top(car.paint, 0.80)]
    if chance(rng, 0.5):  # a panel van: no windows behind the front doors
        door = cabin.roof[0] + uniform(rng, (0.45, 0.9))
        rear = (door, cabin.foot[1]), (door, cabin.roof[1])
        box_cabin = Cabin(*rear, cabin.low, cabin.high, cabin.half_widths, nose=0.0)
        parts += [
            box_cabin.shell(car.paint, 0.02, (0.03, 0.97)),
            *cabin.pillars(car.paint, (), 0.16),
        ]
    else:
        parts += cabin.pillars(car.paint, (0.28, 0.52, 0.76), 0.16)
    parts += mirror_parts(car, cabin)
    return parts + light_parts(rng, car, nose, 0.9 * car.belt, 0.24)


def pickup(rng: np.random.Generator) -> list[Part]:
    """Return a cabin and an open bed."""
    car, cabin = draw_car(rng, "pickup")
    nose = uniform(rng, (0.80, 0.90))
    start, rear = cabin.foot[1] + 0.08, car.length / 2
    floor = car.belt - uniform(rng, (0.14, 0.26))
    floor = max(floor, car.arch_top + 0.06)
    top = [
        *hood_line(car, cabin, nose),
        (start, car.belt),
        (start + 0.02, floor),
        (rear, floor - 0.02),
    ]
    walls = rectangle(1.95 * car.half, rear - start + 0.02)
    walls[:, 1] += (rear + start) / 2
    middles = (0.5,) if cabin.roof[1] - cabin.roof[0] > 0.9 else ()
    parts = [
        body_shell(car, top),
        *running_gear(car),
        cabin.shell(car.glass, 0.0, (0.0, 0.97)),
        cabin.top(car.paint),
        *cabin.pillars(car.paint, middles, 0.14),
        *mirror_parts(car, cabin),
        rim(walls, floor - 0.12, car.belt + uniform(rng, (0.0, 0.06)), 0.10, car.paint),
        *light_parts(rng, car, nose, floor - 0.22, 0.28),
    ]
    if chance(rng, 0.25):  # a roll bar behind the cabin
        x, z, high = 0.80 * car.half, start + 0.22, car.height - 0.08
        bar = [(-x, floor - 0.05, z), (-x, high, z), (x, high, z), (x, floor - 0.05, z)]
        parts.append(tube(bar, 0.04, car.tyre, sides=6))
    return parts


def convertible(rng: np.random.Generator) -> list[Part]:
    """Return seats behind a windscreen, and no roof."""
    car, cabin = draw_car(rng, "convertible")
    leather = shade(rng, CAR["leather"])
    nose = uniform(rng, (0.66, 0.80))
    start, end = cabin.foot[0] + 0.35, cabin.foot[1]
    parts = [
        body_shell(car, [*hood_line(car, cabin, nose), *deck_line(car, 0.02)]),
        *running_gear(car),
    ]
    well = box((0, car.belt, (start + end) / 2), (1.5 * car.half, 0.09, end - start), car.tyre)
    parts.append(well)
    rows = (0.52,) if end - start < 1.35 else (0.25, 0.72)
    for row in rows:
        for x in (-0.37 * car.half, 0.37 * car.half):
            z = start + row * (end - start) + 0.15
            back = rectangle(0.52 * car.half, 0.14)
            head = (x, car.belt + 0.26, z + 0.08)
            parts.append(post((x, car.belt - 0.05, z), head, back, 0.8 * back, leather))
    # The windscreen leans back between two posts and a rail of the body's colour.
    foot, height = cabin.foot[0], car.height - 0.02
    lean = uniform(rng, (0.36, 0.50))
    low, high = 0.84 * car.half, 0.72 * car.half
    pane = [(foot + 0.06, car.belt - 0.06, low), (foot + 0.06 + lean, height, high)]
    rings = [
        [(-x, y, z - 0.012), (x, y, z - 0.012), (x, y, z + 0.012), (-x, y, z + 0.012)]
        for z, y, x in pane
    ]
    parts.append(loft(rings, car.glass))
    frame = [(x, y, z) for z, y, x in pane]
    corners = [frame[0], frame[1], *((-x, y, z) for x, y, z in frame[::-1])]
    parts.append(tube(corners, 0.032, car.paint, sides=6))
    parts += pair(
        box((0.93 * car.half, car.belt + 0.04, foot + 0.2), (0.3 * car.half, 0.11, 0.09), car.paint)
    )
    return parts + light_parts(rng, car, nose, car.belt - 0.20, 0.26)
