"""The body of a car below the windows, with wheels and lights."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.car.cabins import Cabin
from data_prep.shapes.car.spec import ARCH, Car
from data_prep.shapes.hulls import disc, pair
from data_prep.shapes.palettes import CAR, shade
from data_prep.shapes.solids import Part, box, prism


def body_shell(car: Car, top: list[tuple[float, float]]) -> Part:
    """Return the body up to the belt: sections along z.

    The wheel arches are cut out of their lower edge.

    top  (z, height of the upper side), from the nose to the tail
    """
    front, rear = top[0][0], top[-1][0]
    low = [(front, car.clearance + 0.10), (front + 0.10, car.clearance)]
    for axle in car.axles:
        low.append((axle - car.arch - 0.02, car.clearance))
        for cos, sin in ARCH:
            low.append((axle + cos * car.arch, car.wheel + sin * car.arch))
        low.append((axle + car.arch + 0.02, car.clearance))
    low += [(rear - 0.10, car.clearance), (rear, car.clearance + 0.12)]
    plan = [(front, 0.80), (front + 0.10, 0.92), (front + 0.55, 1.0)]
    plan += [(rear - 0.6, 1.0), (rear - 0.1, 0.95), (rear, 0.88)]
    z = np.unique(np.concatenate([np.array(line)[:, 0] for line in (top, low, plan)]))
    high, floor, wide = (np.interp(z, *np.array(line).T) for line in (top, low, plan))
    right = [(0.985, 0.0, 0), (1.0, 0.4, 0), (0.975, 0.8, 0), (0.87, 1.0, 0), (0.4, 1.0, 0.02)]
    section = np.array([*right, *((-x, y, more) for x, y, more in right[::-1])])
    x = wide[:, None] * car.half * section[:, 0]
    y = floor[:, None] + (high - floor)[:, None] * section[:, 1] + section[:, 2]
    return prism(2, np.stack([x, y], axis=-1), z, car.paint)


def hood_line(car: Car, cabin: Cabin, nose: float) -> list[tuple[float, float]]:
    """Return the upper side from nose to windscreen; `nose` is its height there, in belts."""
    front = -car.length / 2
    return [
        (front, (nose - 0.10) * car.belt),
        (front + 0.10, max(nose * car.belt, car.arch_top + 0.06)),
        (cabin.foot[0], 0.97 * car.belt),
        (cabin.foot[0] + 0.3, car.belt),
    ]


def deck_line(car: Car, drop: float) -> list[tuple[float, float]]:
    """Return the upper side at the tail, `drop` lower than the belt."""
    rear = car.length / 2
    return [(rear - 0.10, car.belt - drop), (rear, car.belt - drop - 0.10)]


def running_gear(car: Car) -> list[Part]:
    """Return four wheels, and the dark floor between them, which is seen in the wheel arches."""
    front, rear = car.axles
    start, end = front - car.arch - 0.06, rear + car.arch + 0.06
    low, high = car.clearance + 0.03, car.arch_top + 0.02
    size = (2 * (car.half - 0.13), high - low, end - start)
    parts = [box((0, (low + high) / 2, (start + end) / 2), size, car.tyre)]
    for axle in car.axles:
        x = car.half - 0.13
        parts += pair(disc((x, car.wheel, axle), car.wheel, 0.22, car.tyre, bevel=0.025, sides=14))
        parts += pair(disc((x, car.wheel, axle), 0.62 * car.wheel, 0.25, car.hub, sides=8))
    return parts


def light_parts(
    rng: np.random.Generator, car: Car, nose: float, tail: float, wide: float
) -> list[Part]:
    """Return head lights and grille below the hood, `nose` belts high; tail lights at `tail`."""
    red = shade(rng, CAR["taillight"])
    depth, out, nose = 0.2, 0.03, (nose - 0.17) * car.belt
    front, rear = -car.length / 2 - out + depth / 2, car.length / 2 + out - depth / 2
    x = 0.66 * car.half
    parts = pair(box((x, nose, front), (wide, 0.12, depth), car.light))
    parts += pair(box((x + 0.04, tail, rear), (0.8 * wide, 0.14, depth), red))
    grille = box((0, nose - 0.10, front + 0.005), (0.95 * car.half, 0.13, depth), car.tyre)
    return [*parts, grille]


def mirror_parts(car: Car, cabin: Cabin) -> list[Part]:
    """Return both mirrors, at the foot of the windscreen."""
    y, x = car.belt + 0.06, cabin.half_widths[0]
    return pair(box((x + 0.05, y, cabin.foot[0] + 0.42), (0.34, 0.12, 0.09), car.paint))
