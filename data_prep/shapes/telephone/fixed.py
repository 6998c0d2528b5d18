"""Telephones for the desk. Lengths are in centimetres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import Part, box, moved, turned
from data_prep.shapes.telephone.parts import (
    CUP_PLACE,
    antenna,
    cord,
    dial,
    handset,
    hood,
    key_color,
    keypad,
    plate,
    tint,
    wedge,
)


def cordless(rng: np.random.Generator) -> list[Part]:
    """Return a handset that leans back in its charger."""
    height, thick = uniform(rng, (15.0, 18.5)), uniform(rng, (2.2, 3.2))
    width = uniform(rng, (4.6, 5.6))
    body = tint(rng, {"black": 0.45, "silver": 0.25, "white": 0.20, "beige": 0.10})
    base = body if chance(rng, 0.6) else tint(rng, {"black": 0.6, "silver": 0.4})
    keys, lit = key_color(rng, body), tint(rng, {"lit": 1.0})
    front = -thick / 2
    phone = [
        plate((0, 0, 0), (width, height, thick), 0.3 * width, body, bevel=0.26 * thick),
        plate((0, 0.22 * height, front + 0.2), (0.66 * width, 0.18 * height, 0.6), 0.2, lit),
        plate((0, 0.41 * height, front + 0.2), (0.4 * width, 0.3, 0.6), 0.1, keys),
        plate((0, 0.07 * height, front + 0.15), (0.36 * width, 0.07 * height, 0.6), 0.3, keys),
        *keypad(
            (-0.36 * width, 0.36 * width), (-0.33 * height, 0.02 * height), (3, 4), front, keys
        ),
    ]
    if chance(rng, 0.45):
        phone.append(
            antenna((0.3 * width, 0.46 * height, 0.1 * thick), uniform(rng, (2.5, 6.0)), 0.45, body)
        )
    lean = uniform(rng, (0.10, 0.35))
    phone = [moved(part, (0, 0.5 * height + 1.6, 0), tilt_rad=lean) for part in phone]
    wide, deep = width + uniform(rng, (1.6, 5.0)), uniform(rng, (7.5, 10.0))
    middle = 0.25 * deep - 1.0
    stand = wedge(
        wide, (middle - deep / 2, middle + deep / 2), (1.8, uniform(rng, (3.4, 6.0))), base
    )
    return [stand, *phone]


def desk(rng: np.random.Generator) -> list[Part]:
    """Return a wedge with keys and a screen, and a handset beside them."""
    wide, deep = uniform(rng, (15.0, 21.0)), uniform(rng, (17.0, 22.0))
    low, high = uniform(rng, (2.2, 3.4)), uniform(rng, (5.0, 9.0))
    body = tint(
        rng, {"black": 0.40, "beige": 0.25, "silver": 0.15, "white": 0.12, "coloured": 0.08}
    )
    keys, lit = key_color(rng, body), tint(rng, {"lit": 0.6, "glass": 0.4})
    slope = math.atan2(high - low, deep)

    def on_top(parts: list[Part]) -> list[Part]:
        """Return parts that are built upright, at z = 0 in front, laid down on the sloping top."""
        tilt_rad = math.pi / 2 - slope
        return [moved(part, (0, (low + high) / 2, 0), tilt_rad=tilt_rad) for part in parts]

    length = math.hypot(deep, high - low)
    left = 0.5 * wide - 2.9  # the handset's axis; who looks at the front has +x at the left
    key_side = (1.6 - 0.5 * wide, 0.5 * wide - 6.6)
    centre, breadth = sum(key_side) / 2, key_side[1] - key_side[0]
    rows = 4 if chance(rng, 0.7) else 5
    show = uniform(rng, (0.10, 0.24)) * length
    reach = uniform(rng, (0.92, 1.02)) * length
    top = [
        *keypad(key_side, (-0.38 * length, 0.08 * length), (3, rows), 0.0, keys, rise=0.45),
        plate((centre, 0.27 * length, -0.15), (breadth, show, 0.7), 0.2, lit),
        plate((left, CUP_PLACE * reach, -0.1), (4.0, 0.16 * length, 0.9), 0.5, keys),
        plate((left, -CUP_PLACE * reach, -0.1), (4.0, 0.16 * length, 0.9), 0.5, keys),
    ]
    color = body if chance(rng, 0.75) else tint(rng, {"black": 1.0})
    held = handset(reach, 4.4, 2.6, color)
    held = [moved(part, (left, 0.0, -2.3)) for part in held]
    parts = [wedge(wide, (-deep / 2, deep / 2), (low, high), body), *on_top([*top, *held])]
    if chance(rng, 0.6):
        parts.append(cord(left, -0.5 * deep, low, 0.5 * wide, color))
    return parts


def classic(rng: np.random.Generator) -> list[Part]:
    """Return a narrowing body with a dial, more rarely with keys, and a handset across its top."""
    wide, deep = uniform(rng, (14.0, 18.0)), uniform(rng, (14.0, 19.0))
    high = uniform(rng, (9.0, 12.5))
    color = tint(rng, {"bakelite": 0.85, "wood": 0.15})
    face = tint(rng, {"silver": 0.5, "beige": 0.3, "black": 0.2})
    ring = key_color(rng, face)
    low = 2.6
    # A body that narrows to the cradle; the dial lies on its sloping front.
    shoulder_front, shoulder_rear = 0.02 * deep, 0.34 * deep
    parts = [
        wedge(wide, (-deep / 2, deep / 2), (low, low), color),
        hood(
            (0.9 * wide, -0.47 * deep, 0.44 * deep),
            (0.62 * wide, shoulder_front, shoulder_rear),
            (0.2 * low, low, high),
            color,
        ),
    ]
    slope = math.atan2(high - low, shoulder_front + 0.47 * deep)
    middle = (0.0, (low + high) / 2 - 0.1, (shoulder_front - 0.47 * deep) / 2)
    size = 0.36 * min(wide, deep) if chance(rng, 0.75) else 0.0
    if size:
        turned_on = dial(
            min(size, 0.44 * math.hypot(high - low, shoulder_front + 0.47 * deep)), face, ring
        )
    else:
        half = 0.2 * wide
        turned_on = keypad(
            (-half, half), (-half, half), (3, 4), 0.0, key_color(rng, color), rise=0.5
        )
    parts += [moved(part, middle, tilt_rad=math.pi / 2 - slope) for part in turned_on]
    middle_z = (shoulder_front + shoulder_rear) / 2
    for x in (-0.24 * wide, 0.24 * wide):  # the cradle
        for z in (middle_z - 1.2, middle_z + 1.2):
            parts.append(box((x, high + 0.7, z), (1.3, 3.6, 1.3), color))
    held = handset(wide * uniform(rng, (1.05, 1.25)), 4.6, 2.4, color)
    for part in held:
        lying = moved(part, (0, 0, 0), tilt_rad=math.pi / 2)
        parts.append(moved(turned(lying, math.pi / 2), (0, high + 2.2, middle_z)))
    return parts
