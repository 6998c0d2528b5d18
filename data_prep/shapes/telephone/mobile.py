"""Telephones for the hand, standing upright. Lengths are in centimetres."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.solids import Part, box, moved
from data_prep.shapes.telephone.parts import antenna, key_color, keypad, leaned, plate, tint


def smartphone(rng: np.random.Generator) -> list[Part]:
    """Return a thin slab that is almost all screen; one in seven is a tablet."""
    height = uniform(rng, (11.0, 16.5))
    tablet = chance(rng, 0.15)
    width = height * uniform(rng, (0.64, 0.76) if tablet else (0.46, 0.58))
    thick = uniform(rng, (0.7, 1.25))
    corner = uniform(rng, (0.3, 1.1))
    body = tint(rng, {"black": 0.48, "silver": 0.22, "white": 0.20, "coloured": 0.10})
    face = tint(rng, {"glass": 0.65, "lit": 0.35})
    front = -thick / 2 - 0.12  # of the screen, which stands out
    head, chin = uniform(rng, (0.35, 1.6)), uniform(rng, (0.35, 1.9))
    middle = (chin - head) / 2
    size = width - uniform(rng, (0.35, 0.8)), height - head - chin
    screen = plate((0, middle, front + 0.25), (*size, 0.5), 0.15, face)
    parts = [plate((0, 0, 0), (width, height, thick), corner, body, bevel=0.25 * thick), screen]
    detail = key_color(rng, body)
    if chin > 1.0:
        button = (uniform(rng, (0.9, 1.8)), 0.45) if chance(rng, 0.5) else (0.75, 0.75)
        parts.append(plate((0, (chin - height) / 2, front + 0.16), (*button, 0.5), 0.2, detail))
    if head > 0.8:
        parts.append(plate((0, (height - head) / 2, front + 0.16), (1.5, 0.24, 0.5), 0.08, detail))
    lens_x = 0.0 if chance(rng, 0.4) else 0.28 * width
    lens = (lens_x, 0.5 * height - uniform(rng, (1.2, 1.8)), thick / 2 + 0.02)
    parts.append(plate(lens, (1.0, uniform(rng, (1.0, 2.0)), 0.4), 0.3, tint(rng, {"glass": 1.0})))
    side = box((width / 2, 0.2 * height, 0), (0.3, uniform(rng, (0.9, 1.9)), 0.4 * thick), detail)
    return [*parts, side]


def keypad_phone(rng: np.random.Generator) -> list[Part]:
    """Return a screen above keys, or above a keyboard."""
    height, thick = uniform(rng, (10.0, 13.0)), uniform(rng, (1.4, 2.4))
    width = height * uniform(rng, (0.38, 0.48))
    body = tint(rng, {"black": 0.40, "silver": 0.30, "coloured": 0.22, "white": 0.08})
    keys, lit = key_color(rng, body), tint(rng, {"lit": 0.8, "glass": 0.2})
    front = -thick / 2
    wide = chance(rng, 0.22)  # a keyboard below a wide screen
    if wide:
        width = height * uniform(rng, (0.52, 0.62))
    share = uniform(rng, (0.30, 0.44))
    parts = [plate((0, 0, 0), (width, height, thick), 0.25 * width, body, bevel=0.28 * thick)]
    frame = 0.80 * width, share * height
    top = 0.5 * height - 0.12 * height - frame[1] / 2
    glass = tint(rng, {"glass": 1.0})
    parts.append(plate((0, top, front + 0.2), (*frame, 0.55), 0.3, glass))
    parts.append(
        plate((0, top + 0.05, front + 0.15), (0.82 * frame[0], 0.76 * frame[1], 0.6), 0.1, lit)
    )
    columns, rows = (8, 4) if wide else (3, 4)
    floor = -0.45 * height
    ceiling = top - frame[1] / 2 - 0.03 * height
    pad = 0.16 * (ceiling - floor)
    parts.append(
        plate((0, ceiling - 0.5 * pad, front + 0.15), (0.34 * width, 0.9 * pad, 0.6), 0.2, keys)
    )
    parts += keypad(
        (-0.36 * width, 0.36 * width), (floor, ceiling - 1.15 * pad), (columns, rows), front, keys
    )
    parts.append(
        plate((0, 0.5 * height - 0.06 * height, front + 0.2), (1.2, 0.22, 0.6), 0.08, keys)
    )
    if chance(rng, 0.3):
        parts.append(
            antenna(
                (0.36 * width, 0.47 * height, 0.1 * thick),
                uniform(rng, (1.2, 4.0)),
                0.17 * thick,
                body,
            )
        )
    return parts


def flip(rng: np.random.Generator) -> list[Part]:
    """Return two halves, half open, on a hinge."""
    height, thick = uniform(rng, (7.8, 9.6)), uniform(rng, (0.9, 1.4))
    width = height * uniform(rng, (0.50, 0.60))
    body = tint(rng, {"silver": 0.34, "black": 0.30, "coloured": 0.28, "white": 0.08})
    inside = body if chance(rng, 0.5) else tint(rng, {"silver": 0.6, "black": 0.4})
    keys, lit = key_color(rng, inside), tint(rng, {"lit": 0.8, "glass": 0.2})
    front = -thick / 2
    lean = uniform(rng, (0.12, 0.75))  # between the halves, in radians: 0 is flat open

    def shell(y: float) -> list[Part]:
        outer = plate((0, y, 0.18), (width, height, thick - 0.3), 0.22 * width, body, bevel=0.2)
        lining = plate(
            (0, y, front + 0.3), (0.95 * width, 0.96 * height, 0.6), 0.20 * width, inside
        )
        return [outer, lining]

    half = height / 2 - 0.1
    glass = tint(rng, {"glass": 1.0})
    lower = shell(-half)
    pad = 0.20 * height
    lower.append(
        plate((0, -0.6 * pad - 0.5, front + 0.02), (0.42 * width, 0.8 * pad, 0.3), 0.3, keys)
    )
    lower += keypad(
        (-0.38 * width, 0.38 * width), (-0.93 * height, -1.15 * pad - 0.5), (3, 4), front, keys
    )
    upper = shell(half)
    upper.append(
        plate((0, half + 0.2, front + 0.06), (0.78 * width, 0.66 * height, 0.35), 0.2, glass)
    )
    upper.append(
        plate((0, half + 0.25, front + 0.03), (0.66 * width, 0.54 * height, 0.4), 0.1, lit)
    )
    upper.append(plate((0, 0.93 * height, front + 0.02), (1.1, 0.2, 0.3), 0.06, keys))
    upper.append(
        plate((0, half + 0.1 * height, thick / 2), (0.5 * width, 0.3 * height, 0.3), 0.2, glass)
    )
    hinge = leaned(antenna((0, 0, 0), 0.86 * width, 0.52 * thick, body), (-0.43 * width, 0, 0.05))
    if chance(rng, 0.3):
        lower.append(antenna((0.42 * width, -0.8, 0.25 * thick), 2.6, 0.3, body))
    # The lower half stands more upright than the upper.
    return [
        *(moved(part, (0, 0, 0), tilt_rad=0.35 * lean) for part in lower),
        *(moved(part, (0, 0, 0), tilt_rad=-0.65 * lean) for part in upper),
        hinge,
    ]
