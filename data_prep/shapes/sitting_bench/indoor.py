"""Benches of halls, churches and waiting rooms. Lengths in metres."""

from __future__ import annotations

import itertools
import math

import numpy as np

from data_prep.shapes.furniture import beam, cushion, run
from data_prep.shapes.palettes import shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    fillet,
    post,
    rectangle,
    rounded,
    sheet,
    slab,
    sweep,
)


def settle(rng: np.random.Generator) -> list[Part]:
    """Return a wide wooden chair: four or six legs, a back of bars or boards."""
    length, depth = uniform(rng, (0.85, 1.7)), uniform(rng, (0.38, 0.50))
    height = uniform(rng, (0.40, 0.48))
    frame = shade_of(rng, {"wood": 0.78, "paint": 0.22})
    thick = uniform(rng, (0.025, 0.05))
    bar = uniform(rng, (0.035, 0.060))
    top = height + uniform(rng, (0.35, 0.60))
    x, z = length / 2 - 0.55 * bar, depth / 2 - 0.6 * bar
    middle = height - thick / 2
    size = (length + 0.02, thick, depth + 0.01)
    outline = rounded(rectangle(size[0], size[2]), 0.015) / (size[0], size[2])
    parts = [slab(outline, (0, middle, 0), size, frame, bevel=0.006)]
    rake = math.radians(uniform(rng, (2, 11)))
    square = rectangle(bar, bar)
    lean = (top - middle) * math.tan(rake)
    for i in (-1, 1):
        parts.append(post((i * x, 0, z), (i * x, middle, z), square, square, frame))
        parts.append(post((i * x, middle - 0.02, z), (i * x, top, z + lean), square, square, frame))
    arms = chance(rng, 0.5)
    arm_y = height + uniform(rng, (0.18, 0.26))
    for i in (-1, 1):
        head = arm_y if arms else middle
        parts.append(post((i * x, 0, -z), (i * x, head, -z), square, square, frame))
        if arms:
            end = z + (arm_y - middle) * math.tan(rake)
            section, ends = rectangle(1.3 * bar, 0.6 * bar), (-z - 0.6 * bar, end)
            parts.append(run(section, ends, frame, at=(i * x, arm_y), axis=2, bevel=0.008))

    def behind(y: float) -> float:
        return z + (y - middle) * math.tan(rake)

    kind = pick(rng, {"ladder": 0.30, "slatted": 0.34, "board": 0.20, "cross": 0.16})
    flat = rectangle(0.5 * bar, 1.4 * bar)
    rail_y = top - 0.8 * bar
    low_y = height + uniform(rng, (0.06, 0.14))
    rails = [rail_y]
    if kind == "ladder":
        rails = np.linspace(rail_y, low_y, int(rng.integers(2, 5))).tolist()
    elif kind != "board":
        rails.append(low_y)
    for y in rails:
        parts.append(run(flat, (-x, x), frame, at=(behind(y), y)))
    if kind == "slatted":
        slim = rectangle(uniform(rng, (0.018, 0.045)), 0.35 * bar)
        for at in np.linspace(-x, x, int(rng.integers(8, 16)))[1:-1]:
            foot, head = (at, low_y, behind(low_y)), (at, rail_y, behind(rail_y))
            parts.append(post(foot, head, slim, slim, frame))
    elif kind == "cross":
        panes = 2 if length < 1.3 else 3
        edges = np.linspace(-x, x, panes + 1)
        for a, b in itertools.pairwise(edges):
            for p, q in ((a, b), (b, a)):
                ends = (p, low_y, behind(low_y)), (q, rail_y, behind(rail_y))
                parts.append(beam(*ends, 0.3 * bar, 0.6 * bar, frame))
    elif kind == "board":
        y = (low_y + rail_y) / 2
        board = rectangle(0.4 * bar, rail_y - low_y)
        board[:, 0] += board[:, 1] * math.tan(rake)
        parts.append(run(board, (-x, x), frame, at=(behind(y), y)))
    if chance(rng, 0.5):
        for i in (-1, 1):
            parts.append(beam((i * x, 0.13, -z), (i * x, 0.13, z), 0.5 * bar, 0.7 * bar, frame))
        parts.append(beam((-x, 0.13, 0), (x, 0.13, 0), 0.5 * bar, 0.7 * bar, frame))
    if chance(rng, 0.35):
        pad = 0.05
        size = (length - 2.4 * bar, pad, depth - 1.5 * bar)
        color = shade(rng, "upholstery")
        parts.append(cushion((0, height - 0.01 + pad / 2, -0.3 * bar), size, color, soft=0.018))
    return parts


def pew(rng: np.random.Generator) -> list[Part]:
    """Return two ends of board, a seat between them and a closed back.

    It may be closed below, too.
    """
    length, depth = uniform(rng, (0.9, 2.3)), uniform(rng, (0.40, 0.54))
    height, top = uniform(rng, (0.41, 0.47)), uniform(rng, (0.82, 1.05))
    wood = shade_of(rng, {"wood": 0.85, "paint": 0.15})
    ends = wood if chance(rng, 0.7) else shade(rng, "wood")
    thick, rake = uniform(rng, (0.03, 0.06)), uniform(rng, (0.02, 0.16))
    front, rear = -depth / 2, depth / 2
    half = length / 2
    low_end = uniform(rng, (0.55, 0.72)) if chance(rng, 0.6) else top + 0.02
    # Seen from the side, an end is a board whose front edge falls back from the arm upwards.
    end = [(front - 0.02, 0.0), (rear + rake + 0.05, 0.0), (rear + rake + 0.05, top + 0.02)]
    end += [(rear + rake - 0.10, top + 0.02), (front - 0.02, min(low_end, top))]
    profile = rounded(end, 0.03, steps=4)
    parts = [
        run(profile, (side * half - thick / 2, side * half + thick / 2), ends) for side in (-1, 1)
    ]
    seat, rail = (rounded(rectangle(*size), 0.012) for size in ((depth, 0.045), (0.07, 0.05)))
    back = [(rear - 0.02, height - 0.03), (rear + rake, top)]
    back += [(z + 0.04, y) for z, y in back[::-1]]
    parts += [
        run(seat, (-half, half), wood, at=(0.0, height - 0.022)),
        run(rounded(back, 0.015), (-half, half), wood),
        run(rail, (-half, half), wood, at=(rear + rake + 0.01, top - 0.01)),
    ]
    if chance(rng, 0.5):  # a chest under the seat
        size = (2 * half, height - 0.05, 0.9 * depth)
        parts.append(box((0, 0.02 + size[1] / 2, 0.02), size, wood))
    if chance(rng, 0.4):
        color = shade(rng, "upholstery")
        size = (length - thick - 0.01, 0.06, 0.92 * depth)
        parts.append(cushion((0, height + 0.018, -0.01), size, color, soft=0.02, corner=0.03))
    return parts


def row(rng: np.random.Generator) -> list[Part]:
    """Return shells side by side on a beam, as in waiting rooms."""
    seats = int(rng.integers(2, 6))
    pitch = uniform(rng, (0.50, 0.60))
    height, depth = uniform(rng, (0.41, 0.46)), uniform(rng, (0.42, 0.50))
    width = pitch - uniform(rng, (0.02, 0.07))
    frame = shade_of(rng, {"chrome": 0.55, "dark-metal": 0.45})
    material = pick(rng, {"plastic": 0.45, "office-fabric": 0.25, "chrome": 0.15, "leather": 0.15})
    color = shade(rng, material)
    thick = 0.03 if material in ("plastic", "chrome") else uniform(rng, (0.05, 0.08))
    rake, top = uniform(rng, (0.12, 0.30)), uniform(rng, (0.34, 0.48))
    half = seats * pitch / 2
    middles = [(k + 0.5) * pitch - half for k in range(seats)]
    parts = [_shell(x, width, depth, height, top, rake, thick, color) for x in middles]
    section = rectangle(0.07, 0.05)
    y = height - thick - 0.012
    parts.append(run(section, (0.06 - half, *middles, half - 0.06), frame, at=(0.04, y)))
    feet = np.linspace(-half + 0.22, half - 0.22, 2 if seats < 5 else 3)
    square = rectangle(0.05, 0.06)
    for x in feet:
        parts.append(post((x, 0.02, 0.04), (x, y, 0.04), square, square, frame))
        parts.append(box((x, 0.02, 0.02), (0.06, 0.04, uniform(rng, (0.42, 0.56))), frame))
    if chance(rng, 0.5):
        arm_y = height + 0.18
        for x in np.arange(seats + 1) * pitch - half:
            at = np.clip(x, 0.08 - half, half - 0.08)
            line = [(at, y - 0.01, 0.05), (at, arm_y, 0.16), (at, arm_y, -0.42 * depth)]
            parts.append(sweep(line, rectangle(0.028, 0.028), frame, up=(1, 0, 0)))
    return parts


def _shell(
    x: float,
    width: float,
    depth: float,
    seat_y: float,
    back: float,
    lean: float,
    thick: float,
    color: Color,
) -> Part:
    """Return a bent sheet, seat and back in one, of that width about `x`; open towards -z.

    The seat's upper side lies at `seat_y`; the back rises by `back` and leans by `lean` (m).
    """
    line = np.array(
        [
            (0, seat_y - 0.03, -depth / 2 - 0.02),
            (0, seat_y, -depth / 2 + 0.04),
            (0, seat_y - 0.01, depth / 2),
            (0, seat_y + back, depth / 2 + lean),
        ]
    )
    path = fillet(line, 0.035, steps=3)
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([0 * along[:, 0], along[:, 2], -along[:, 1]], axis=1)
    below = path - thick * normal
    ends = (x - 0.5 * width, x + 0.5 * width)
    return sheet(0, (path[:, :0:-1], below[:, :0:-1]), ends, color)
