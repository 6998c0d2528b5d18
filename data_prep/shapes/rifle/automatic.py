"""Rifles of separate receiver, grip and magazine.

Lengths are in metres; see `parts`.
"""

from __future__ import annotations

import numpy as np

from data_prep.shapes.hulls import disc
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.rifle.parts import (
    bipod,
    carry_handle,
    front_sight,
    handle,
    magazine,
    pipe,
    scope,
    stock,
    tint,
    trigger,
    wire_stock,
)
from data_prep.shapes.solids import Color, Part, box


def assault(rng: np.random.Generator) -> list[Part]:
    """Return a rifle of receiver, fore-end, pistol grip, magazine and stock, all separate."""
    metal = tint(rng, {"gunmetal": 1.0})
    wood = chance(rng, 0.35)
    grip = tint(rng, {"walnut": 1.0} if wood else {"polymer": 0.65, "olive": 0.15, "tan": 0.20})
    back, front = 0.10, 0.10 - uniform(rng, (0.22, 0.31))
    guard, beyond = uniform(rng, (0.17, 0.30)), uniform(rng, (0.10, 0.26))
    muzzle = front - guard - beyond
    top = uniform(rng, (0.020, 0.032))
    low = -uniform(rng, (0.035, 0.050))
    bore = uniform(rng, (0.008, 0.011))
    parts = [
        stock(
            [(back, 0.5 * low, top, 0.036), (0.05, low, top, 0.040), (front, low, top, 0.040)],
            metal,
        ),
        stock(
            [
                (front + 0.02, -0.030, 0.024, 0.048),
                (front - 0.5 * guard, -0.034, 0.026, 0.050),
                (front - guard, -0.026, 0.020, 0.043),
            ],
            grip,
        ),
        pipe([(bore, front), (bore, muzzle)], metal, sides=8),
        pipe([(1.5 * bore, muzzle + 0.035), (1.5 * bore, muzzle - 0.015)], metal, sides=8),
        front_sight(muzzle + uniform(rng, (0.05, 0.9)) * beyond, top + 0.028, metal),
        handle((low + 0.01, 0.055), uniform(rng, (0.09, 0.12)), 0.045, 0.045, 0.030, grip),
        *trigger(low, -0.035, 0.04, metal),
    ]
    bent = wood or chance(rng, 0.4)
    depth, drop = uniform(rng, (0.055, 0.070)), uniform(rng, (0.13, 0.21))
    ahead = uniform(rng, (0.05, 0.08)) if bent else 0.0
    clip = metal if chance(rng, 0.7) else grip
    parts.append(magazine((low + 0.012, -0.075), drop, ahead, depth, 0.026, clip))
    sight = pick(rng, {"notch": 0.42, "handle": 0.28, "scope": 0.30})
    if sight == "handle":
        parts.append(carry_handle(top, 0.075, uniform(rng, (0.13, 0.17)), metal))
    elif sight == "scope":
        parts += scope(top + 0.034, top - 0.008, 0.06, uniform(rng, (0.13, 0.20)), metal)
    else:
        parts.append(box((0, top + 0.004, front + 0.03), (0.02, 0.026, 0.05), metal))
    return parts + _shoulder(rng, back, top, metal, grip)


def _shoulder(
    rng: np.random.Generator, back: float, top: float, metal: Color, grip: Color
) -> list[Part]:
    """Return the stock behind a receiver that ends at z = `back`."""
    kind = pick(rng, {"fixed": 0.55, "collapsible": 0.27, "wire": 0.18})
    length, drop = uniform(rng, (0.21, 0.29)), uniform(rng, (0.09, 0.13))
    if kind == "wire":
        return wire_stock(back, length, 0.6 * top - 0.006, drop, metal)
    if kind == "collapsible":
        return [
            pipe([(0.014, back - 0.02), (0.014, back + 0.7 * length)], metal, y=-0.004, sides=8),
            stock(
                [
                    (back + 0.45 * length, -0.045, 0.016, 0.034),
                    (back + 0.8 * length, -0.06, 0.018, 0.037),
                    (back + 0.82 * length, -drop, 0.020, 0.037),
                    (back + length, 0.01 - drop, 0.016, 0.034),
                ],
                grip,
            ),
        ]
    stations = [
        (back - 0.02, -0.028, 0.8 * top, 0.032),
        (back + 0.05, -0.032, 0.7 * top, 0.034),
        (back + 0.5 * length, -0.045 - 0.25 * drop, 0.6 * top, 0.037),
        (back + length, -drop, 0.4 * top, 0.041),
    ]
    return [stock(stations, grip)]


def submachine(rng: np.random.Generator) -> list[Part]:
    """Return a short gun with a long magazine."""
    metal = tint(rng, {"gunmetal": 1.0})
    grip = tint(rng, {"polymer": 0.85, "olive": 0.15})
    back, front = uniform(rng, (0.07, 0.11)), -uniform(rng, (0.13, 0.20))
    top, low = uniform(rng, (0.026, 0.036)), -uniform(rng, (0.026, 0.036))
    inside = chance(rng, 0.35)  # the magazine is in the grip
    drop = uniform(rng, (0.12, 0.20))
    beyond = uniform(rng, (0.04, 0.12))
    parts = [
        stock([(back, low, top, 0.042), (front, low, top, 0.044)], metal),
        pipe([(0.009, front + 0.02), (0.009, front - beyond)], metal, sides=8),
        box((0, top + 0.008, front + 0.02), (0.012, 0.032, 0.018), metal),
        box((0, top + 0.006, back - 0.02), (0.020, 0.026, 0.026), metal),
        *trigger(low, -0.05, 0.03, metal),
    ]
    if inside:
        parts.append(handle((low + 0.01, 0.045), 0.10, 0.012, 0.050, 0.036, grip))
        parts.append(magazine((low, 0.05), 0.10 + 0.5 * drop, 0.0, 0.036, 0.024, metal))
    else:
        parts.append(handle((low + 0.01, 0.045), 0.095, 0.04, 0.045, 0.031, grip))
        ahead = uniform(rng, (0.02, 0.05)) if chance(rng, 0.5) else 0.0
        parts.append(magazine((low + 0.01, 0.5 * front - 0.02), drop, ahead, 0.042, 0.026, metal))
    if chance(rng, 0.35):  # a silencer
        end = front - 0.5 * beyond
        reach = end - uniform(rng, (0.14, 0.20))
        parts.append(pipe([(0.020, end), (0.020, reach)], grip))
    elif chance(rng, 0.6):
        guard = [
            (front + 0.03, low - 0.006, 0.020, 0.050),
            (front - 0.8 * beyond, low + 0.002, 0.016, 0.040),
        ]
        parts.append(stock(guard, grip))
    ending = pick(rng, {"wire": 0.5, "fixed": 0.3, "none": 0.2})
    length = uniform(rng, (0.18, 0.25))
    if ending == "wire":
        parts += wire_stock(back, length, 0.25 * top, 0.09, metal)
    elif ending == "fixed":
        butt = [
            (back - 0.02, -0.022, 0.016, 0.034),
            (back + 0.05, -0.032, 0.014, 0.034),
            (back + length, -0.10, 0.010, 0.038),
        ]
        parts.append(stock(butt, grip))
    return parts


def machine_gun(rng: np.random.Generator) -> list[Part]:
    """Return a gun with a bipod, a jacketed barrel, and a box or drum of cartridges."""
    metal = tint(rng, {"gunmetal": 1.0})
    grip = tint(rng, {"walnut": 0.45, "polymer": 0.55})
    front, muzzle = -uniform(rng, (0.20, 0.28)), -uniform(rng, (0.68, 0.90))
    top = uniform(rng, (0.034, 0.046))
    bore = uniform(rng, (0.011, 0.014))
    jacket = front - uniform(rng, (0.15, 0.28))
    ribs = np.linspace(front + 0.02, jacket, 8)
    wide = np.where(np.arange(8) % 2 == 0, 0.024, 0.019)
    parts = [
        stock(
            [
                (0.10, -0.030, 0.9 * top, 0.046),
                (0.05, -0.044, top, 0.056),
                (front, -0.044, top, 0.056),
            ],
            metal,
        ),
        stock(
            [(-0.02, 0.5 * top, top + 0.014, 0.060), (-0.17, 0.5 * top, top + 0.014, 0.060)], metal
        ),
        pipe(np.stack([wide, ribs], axis=1), metal, sides=8),
        pipe([(bore, front), (bore, muzzle)], metal, sides=8),
        pipe([(1.4 * bore, muzzle + 0.03), (1.8 * bore, muzzle - 0.03)], metal, sides=8),
        front_sight(muzzle + 0.08, 0.06, metal),
        handle((-0.034, 0.06), 0.10, 0.04, 0.046, 0.033, grip),
        *trigger(-0.042, -0.02, 0.045, metal),
        *bipod(
            -0.01,
            uniform(rng, (0.2, 0.8)) * (muzzle - jacket) + jacket,
            uniform(rng, (0.20, 0.26)),
            0.03,
            metal,
        ),
    ]
    if chance(rng, 0.55):  # belt from a box, or a drum
        size = (0.066, uniform(rng, (0.10, 0.15)), uniform(rng, (0.09, 0.13)))
        box_color = tint(rng, {"olive": 0.6, "gunmetal": 0.4})
        parts.append(box((0, -0.034 - size[1] / 2, -0.11), size, box_color))
    else:
        radius = uniform(rng, (0.065, 0.085))
        parts.append(disc((0, -0.03 - radius, -0.11), radius, 0.048, metal, bevel=0.008, sides=14))
    if chance(rng, 0.5):
        parts.append(carry_handle(0.020, front - 0.02, 0.14, metal))
    return parts + _shoulder(rng, 0.10, top, metal, grip)


def bullpup(rng: np.random.Generator) -> list[Part]:
    """Return a rifle with the magazine behind the grip, in a large stock."""
    body = tint(rng, {"olive": 0.35, "polymer": 0.45, "tan": 0.20})
    metal = tint(rng, {"gunmetal": 1.0})
    length, front = uniform(rng, (0.27, 0.33)), -uniform(rng, (0.22, 0.30))
    top, belly = uniform(rng, (0.030, 0.045)), uniform(rng, (0.07, 0.10))
    grip = -uniform(rng, (0.02, 0.06))
    muzzle = front - uniform(rng, (0.12, 0.24))
    parts = [
        stock(
            [
                (length, -belly, top - 0.01, 0.046),
                (length - 0.06, -belly, top, 0.054),
                (0.08, -0.062, top, 0.056),
                (0.02, -0.045, top, 0.052),
                (grip - 0.10, -0.045, 0.9 * top, 0.052),
                (front, -0.030, 0.6 * top, 0.044),
            ],
            body,
        ),
        pipe([(0.010, front + 0.03), (0.010, muzzle)], metal, sides=8),
        pipe([(0.015, muzzle + 0.04), (0.015, muzzle - 0.01)], metal, sides=8),
        handle((-0.036, grip), 0.105, 0.035, 0.048, 0.036, body),
        *trigger(-0.042, grip - 0.085, grip - 0.01, metal),
        magazine(
            (-0.045, 0.13),
            uniform(rng, (0.12, 0.19)),
            uniform(rng, (0.0, 0.04)),
            0.062,
            0.030,
            metal,
        ),
    ]
    if chance(rng, 0.6):
        parts += scope(top + 0.036, top - 0.012, 0.04, uniform(rng, (0.16, 0.22)), metal)
    else:
        parts.append(carry_handle(top - 0.006, 0.05, uniform(rng, (0.16, 0.22)), metal))
    if chance(rng, 0.4):
        parts.append(
            handle((-0.026, 0.5 * (grip + front) - 0.05), 0.085, -0.01, 0.034, 0.030, metal)
        )
    return parts
