"""Chairs of families that no other split draws, to measure on unseen structures.

None has the structure of a family of `spec`: a seat on four legs, a column, a sled or rockers, or
an upholstered box with arms. Lengths in metres; +Y is up, the front towards -Z.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.furniture import beam, cushion
from data_prep.shapes.palettes import shade_of
from data_prep.shapes.random_choices import chance, uniform
from data_prep.shapes.shape_class import Builder
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    hoop,
    lathe,
    moved,
    post,
    prism,
    rectangle,
    sheet,
    slab,
    tube,
)

FRAME = {"wood": 0.5, "dark-metal": 0.25, "chrome": 0.25}
_BOARD = {"wood": 0.6, "paint": 0.25, "lacquer": 0.15}
CLOTH = {"upholstery": 0.5, "office-fabric": 0.2, "leather": 0.2, "plastic": 0.1}
SIDES = (-1.0, 1.0)


def folding(rng: np.random.Generator) -> list[Part]:
    """Return a chair of crossing legs: at each side a long one, up to the back, and a short one.

    The short one leads up to the seat's front.
    """
    frame = shade_of(rng, FRAME)
    plate = frame if chance(rng, 0.4) else shade_of(rng, CLOTH)
    half, leg = uniform(rng, (0.20, 0.24)), uniform(rng, (0.022, 0.032))
    seat, top = uniform(rng, (0.42, 0.48)), uniform(rng, (0.76, 0.90))
    front, lean = uniform(rng, (-0.28, -0.20)), uniform(rng, (0.42, 0.54))
    depth, thick = uniform(rng, (0.36, 0.42)), uniform(rng, (0.020, 0.035))
    slats, low = int(rng.integers(1, 4)), seat + uniform(rng, (0.12, 0.20))
    behind = uniform(rng, (0.02, 0.10))

    def course(y: float) -> float:
        """Return the place of the long legs at this height."""
        return front + lean * y / top

    inner, rear = half - 1.1 * leg, course(seat)
    foot, head = rear + behind, rear - 0.85 * depth
    section = rectangle(leg, 1.4 * leg)
    parts = [box((0, seat, rear - depth / 2), (2 * half, thick, depth), plate)]
    for side in SIDES:
        outside, inside = side * half, side * inner
        parts += [
            post((outside, 0, front), (outside, top, course(top)), section, section, frame),
            post((inside, 0, foot), (inside, seat, head), section, section, frame),
        ]
    parts += [
        _rod(half, 0.09, course(0.09), 0.3 * leg, frame),
        _rod(inner, 0.12, foot + (head - foot) * 0.12 / seat, 0.3 * leg, frame),
    ]
    tall, tilt = (top - 0.02 - low) / slats, math.atan2(lean, top)
    for y in low + tall * np.arange(slats):
        size = (2 * half, (0.8 if slats > 1 else 1.0) * tall, 0.5 * leg)
        parts.append(_leaning(size, (0, y, course(y)), tilt, plate))
    return parts


def director(rng: np.random.Generator) -> list[Part]:
    """Return legs crossed in front and behind, a sagging seat and a strip of cloth as the back."""
    frame, cloth = shade_of(rng, FRAME), shade_of(rng, CLOTH)
    half, bar = uniform(rng, (0.25, 0.30)), uniform(rng, (0.022, 0.034))
    deep, seat = uniform(rng, (0.19, 0.23)), uniform(rng, (0.42, 0.52))
    arm, top = seat + uniform(rng, (0.18, 0.24)), seat + uniform(rng, (0.40, 0.50))
    strip, sag = uniform(rng, (0.14, 0.24)), uniform(rng, (0.02, 0.06))
    parts: list[Part] = []
    for side in SIDES:
        x = side * half
        parts += [
            box((x, bar / 2, 0), (bar, bar, 2.3 * deep), frame),
            box((x, seat, 0), (bar, bar, 2.3 * deep), frame),
            box((x, arm, 0), (2 * bar, 0.7 * bar, 2.3 * deep), frame),
        ]
        for z, height in ((-deep, arm), (deep, top)):
            upright = (0.8 * bar, height - seat, 0.8 * bar)
            parts.append(box((x, (seat + height) / 2, z), upright, frame))
            ends = (-x, bar / 2, z + 0.3 * side * bar), (x, seat, z + 0.3 * side * bar)
            parts.append(beam(*ends, 0.5 * bar, bar, frame))
    across = np.linspace(-half, half, 9) * 0.99  # its edges are inside the rails
    hang = seat - sag * (1 - (across / half) ** 2)
    faces = [np.stack([across, hang + offset], axis=1) for offset in (0.006, -0.006)]
    parts.append(sheet(2, (faces[0], faces[1]), (-deep, deep), cloth))
    parts.append(box((0, top - 0.02 - strip / 2, deep), (2 * half, strip, 0.012), cloth))
    return parts


def zigzag(rng: np.random.Generator) -> list[Part]:
    """Return four boards: on the floor, up to the front, the seat, the back."""
    color = shade_of(rng, _BOARD)
    width, board = uniform(rng, (0.36, 0.46)), uniform(rng, (0.022, 0.040))
    seat, depth = uniform(rng, (0.40, 0.47)), uniform(rng, (0.36, 0.46))
    back, rake = uniform(rng, (0.28, 0.46)), math.radians(uniform(rng, (0, 12)))
    reach = depth / 2 - board
    high = board * math.hypot(seat, 2 * reach) / (2 * reach)  # the section of a beam is upright
    return [
        _plate((0, board / 2, 0), (width, board, depth), color),
        beam((0, high / 2, reach), (0, seat, -reach), width, high, color),
        _plate((0, seat, 0), (width, board, depth), color),
        _leaning((width, back, board), (0, seat - 0.3 * board, reach + board / 2), rake, color),
    ]


def boards(rng: np.random.Generator) -> list[Part]:
    """Return two boards from the floor to the arms, with the seat and the back between them."""
    outside = shade_of(rng, _BOARD)
    inside = outside if chance(rng, 0.5) else shade_of(rng, CLOTH)
    half, board = uniform(rng, (0.22, 0.30)), uniform(rng, (0.020, 0.045))
    seat, depth = uniform(rng, (0.34, 0.46)), uniform(rng, (0.44, 0.58))
    arm, slant = seat + uniform(rng, (0.04, 0.24)), uniform(rng, (0.0, 0.10))
    back, rake = uniform(rng, (0.34, 0.56)), math.radians(uniform(rng, (2, 16)))
    front, rear = -depth / 2, depth / 2
    outline = np.array([(front, 0), (rear, 0), (rear, arm), (front + slant, arm)])
    between = 2 * half + board
    parts = [
        _plate((0, seat, 0.01), (between, 1.2 * board, depth - 0.06), inside),
        _leaning((between, back, board), (0, seat, rear - 0.07), rake, inside),
    ]
    for side in SIDES:
        edges = [side * half, side * (half + board)]
        parts.append(prism(0, outline, edges, outside))
    if chance(rng, 0.6):
        parts.append(box((0, 0.45 * seat, 0.2 * depth), (between, 0.10, board), outside))
    return parts


def deck(rng: np.random.Generator) -> list[Part]:
    """Return two crossed frames of rods, with a cloth that hangs between them as seat and back."""
    frame, cloth = shade_of(rng, FRAME), shade_of(rng, CLOTH)
    half, rod = uniform(rng, (0.24, 0.31)), uniform(rng, (0.012, 0.019))
    reach, top = uniform(rng, (0.34, 0.44)), uniform(rng, (0.78, 0.98))
    seat, sag = uniform(rng, (0.32, 0.42)), uniform(rng, (0.10, 0.18))
    lean = uniform(rng, (0.30, 0.42))
    inner = half - 2.1 * rod
    parts = [
        _rod(half, top, lean, rod, frame),
        _rod(half, 0.1, 0.1 * (lean + reach) / top - reach, 0.8 * rod, frame),
        _rod(half, seat, -reach, rod, frame),
        _rod(inner, 0.1, reach - 0.2 * reach / seat, 0.8 * rod, frame),
    ]
    for side in SIDES:
        parts += [
            tube([(side * half, 0, -reach), (side * half, top, lean)], rod, frame),
            tube([(side * inner, 0, reach), (side * inner, seat, -reach)], rod, frame),
        ]
    # The frames cross where both are at one height: a rod through both joins them.
    along = 2 * reach * top / (seat * (lean + reach) + 2 * reach * top) * seat
    parts.append(_rod(half, along, along * (lean + reach) / top - reach, 0.6 * rod, frame))
    share = np.linspace(0.0, 1.0, 17)
    line = np.stack(
        [
            (lean + reach) * share - reach,
            seat + (top - seat) * share - 4 * sag * share * (1 - share) ** 1.5,
        ],
        axis=1,
    )
    offset = np.array([0.0, 0.006])
    halves = (-inner + 1.2 * rod, inner - 1.2 * rod)
    parts.append(sheet(0, (line + offset, line - offset), halves, cloth))
    return parts


def bowl(rng: np.random.Generator) -> list[Part]:
    """Return a tilted bowl in a round frame of rods."""
    frame, cloth = shade_of(rng, FRAME), shade_of(rng, CLOTH)
    radius, deep = uniform(rng, (0.38, 0.48)), uniform(rng, (0.16, 0.26))
    wall, tilt = uniform(rng, (0.03, 0.08)), math.radians(uniform(rng, (18, 38)))
    ring, rod = uniform(rng, (0.24, 0.32)), uniform(rng, (0.010, 0.018))
    height, count = uniform(rng, (0.16, 0.28)), int(rng.integers(4, 9))
    angle = np.linspace(0.25, math.pi / 2, 7)
    curve = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    outer, inner = curve * (radius, deep), curve[::-1] * (radius - wall, deep - wall) + (0, wall)
    parts = [
        moved(lathe(np.concatenate([outer, inner]), cloth, sides=24), (0, 0, 0), tilt_rad=-tilt)
    ]
    # The frame's upper ring is sunk into the lowest part of the bowl.
    low = float(parts[0].vertices[:, 1].min())
    parts[0] = moved(parts[0], (0.0, height - low - 0.02, 0.15 * radius))
    parts += [hoop((0, rod, 0), ring, rod, frame), hoop((0, height, 0), 0.7 * ring, rod, frame)]
    for turn in 2 * math.pi * np.arange(count) / count:
        x, z = math.cos(turn), math.sin(turn)
        parts.append(
            tube([(ring * x, rod, ring * z), (0.7 * ring * x, height, 0.7 * ring * z)], rod, frame)
        )
    return parts


def block(rng: np.random.Generator) -> list[Part]:
    """Return upholstered blocks down to the floor: plinth, cushion, back, and up to two arms."""
    body = shade_of(rng, CLOTH)
    seat_color = body if chance(rng, 0.5) else shade_of(rng, CLOTH)
    half, depth = uniform(rng, (0.28, 0.40)), uniform(rng, (0.56, 0.76))
    seat, soft = uniform(rng, (0.32, 0.42)), uniform(rng, (0.10, 0.18))
    back, thick = seat + uniform(rng, (0.16, 0.42)), uniform(rng, (0.14, 0.24))
    arms, arm = rng.random(), uniform(rng, (0.12, 0.20))
    parts = [
        box((0, (seat - soft) / 2, 0), (2 * half, seat - soft, depth), body),
        cushion(
            (0, seat - soft / 2 - 0.01, -0.5 * thick + 0.02),
            (2 * half - 0.02, soft + 0.02, depth - thick),
            seat_color,
            soft=0.03,
        ),
        box((0, back / 2, (depth - thick) / 2 + 0.01), (2 * half - 0.01, back, thick), body),
    ]
    for side in SIDES[: 0 if arms < 0.5 else 1 if arms < 0.75 else 2]:
        size = (arm, seat + 0.12, depth + 0.01)
        parts.append(box((side * (half + 0.4 * arm), size[1] / 2, 0), size, body))
    return parts


FAMILIES: dict[str, tuple[float, Builder]] = {
    "folding": (0.20, folding),
    "director": (0.15, director),
    "zigzag": (0.10, zigzag),
    "boards": (0.15, boards),
    "deck": (0.15, deck),
    "bowl": (0.10, bowl),
    "block": (0.15, block),
}


def _rod(half: float, y: float, z: float, radius: float, color: Color) -> Part:
    """Return a level round bar from side to side."""
    return tube([(-half, y, z), (half, y, z)], radius, color, sides=6)


def _plate(centre: ArrayLike, size: ArrayLike, color: Color) -> Part:
    """Return a level board with bevelled edges."""
    return slab(rectangle(1.0, 1.0), centre, size, color, bevel=0.004)


def _leaning(size: ArrayLike, foot: ArrayLike, rake_rad: float, color: Color) -> Part:
    """Return an upright board of (width, height, thickness) that leans to the rear.

    `foot` [3] is the middle of its lower side.
    """
    height = np.asarray(size, dtype=np.float64)[1]
    return moved(box((0.0, height / 2, 0.0), size, color), foot, tilt_rad=rake_rad)
