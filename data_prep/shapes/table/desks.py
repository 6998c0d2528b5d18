"""Tables of boards: desks with drawers, and low tables that are boxes or stand on panels."""

from __future__ import annotations

import itertools

import numpy as np

from data_prep.shapes.furniture import legs
from data_prep.shapes.palettes import shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, post, rectangle, rounded, sheet, slab

_PROUD = 0.014  # m, by which fronts and handles stand out of what carries them


def _plate(
    centre: tuple[float, float, float], size: tuple[float, float, float], color: Color
) -> Part:
    """Return a board with its edges taken off."""
    outline = rounded(rectangle(size[0], size[2]), 0.012) / (size[0], size[2])
    return slab(outline, centre, size, color, bevel=0.004)


def _drawers(
    x: tuple[float, float], y: tuple[float, float], z: float, rows: int, color: Color, handle: Color
) -> list[Part]:
    """Return fronts of drawers, with handles, before a face at `z` that looks towards -z."""
    parts = []
    gap = 0.016
    height = (y[1] - y[0] - gap) / rows
    middle, width = (x[0] + x[1]) / 2, x[1] - x[0] - 2 * gap
    for row in range(rows):
        at = y[0] + gap / 2 + (row + 0.5) * height
        parts.append(box((middle, at, z), (width, height - gap, 2 * _PROUD), color))
        grip = (0.32 * width, 0.020, 3 * _PROUD)
        parts.append(box((middle, at + 0.1 * height, z - _PROUD), grip, handle))
    return parts


def desk(rng: np.random.Generator) -> list[Part]:
    """Return a desk: one or two blocks of drawers, or panels with a screen for the knees.

    It may have a wing.
    """
    width, depth = uniform(rng, (1.05, 1.80)), uniform(rng, (0.55, 0.82))
    height = uniform(rng, (0.71, 0.78))
    wooden = shade_of(rng, {"wood": 0.84, "paint": 0.16})
    body = shade(rng, "laminate") if chance(rng, 0.3) else wooden
    top = body if chance(rng, 0.6) else shade(rng, "wood" if chance(rng, 0.6) else "laminate")
    front = body if chance(rng, 0.6) else shade(rng, "wood" if chance(rng, 0.4) else "paint")
    handle = shade(rng, "dark-metal" if chance(rng, 0.6) else "chrome")
    board = uniform(rng, (0.022, 0.045))
    over = uniform(rng, (0.0, 0.03))
    under = height - board
    kind = pick(rng, {"two-blocks": 0.32, "one-block": 0.38, "panels": 0.30})
    half, back = width / 2 - over - 0.008, depth / 2 - over - 0.008
    head = under + 0.4 * board
    parts = [_plate((0, height - board / 2, 0), (width, board, depth), top)]

    low = 0.0 if chance(rng, 0.6) else uniform(rng, (0.06, 0.14))
    block = uniform(rng, (0.24, 0.32)) * width
    blocks = {"two-blocks": (-1, 1), "one-block": (int(rng.choice([-1, 1])),), "panels": ()}[kind]
    rows = int(rng.integers(2, 5))
    for side in blocks:
        x = sorted((side * half, side * (half - block)))
        size = (block, head - low, 2 * back)
        middle = (x[0] + x[1]) / 2
        parts.append(box((middle, (head + low) / 2, 0), size, body))
        parts += _drawers((x[0], x[1]), (low, under), -back, rows, front, handle)
        if low > 0.0:
            section = rectangle(0.04, 0.04)
            at = (middle, 0.0)
            parts += legs(
                block / 2 - 0.03, back - 0.03, low + 0.02, section, section, handle, centre=at
            )
    for side in sorted({-1, 1} - set(blocks)):
        size = (board, head, 2 * back)
        if kind == "one-block" and low > 0.0:  # legs instead of a panel, as under the block
            section = rectangle(0.04, 0.04)
            for z in (0.03 - back, back - 0.03):
                at = side * (half - 0.03)
                parts.append(post((at, 0.0, z), (at, head, z), section, section, handle))
        else:
            parts.append(box((side * (half - board / 2), head / 2, 0), size, body))
    screen = uniform(rng, (0.35, 0.9)) * under
    inner = half - 0.5 * board
    size = (2 * inner, screen, 0.02)
    parts.append(box((0, head - screen / 2 - 0.003, 0.72 * back), size, body))
    if kind == "panels" and chance(rng, 0.5):  # a flat drawer under the top
        size = (2 * inner, 0.11, 1.6 * back)
        parts.append(box((0, head - 0.058, -0.12 * back), size, body))
        parts += _drawers((-inner, inner), (under - 0.11, under), -0.92 * back, 1, front, handle)
    if chance(rng, 0.16):
        parts += _wing(rng, width, depth, (head, height), board, (top, body))
    return parts


def _wing(
    rng: np.random.Generator,
    width: float,
    depth: float,
    y: tuple[float, float],
    board: float,
    colors: tuple[Color, Color],
) -> list[Part]:
    """Return a second top at right angles, towards the sitter: an L from above."""
    side = float(rng.choice([-1, 1]))
    length, breadth = uniform(rng, (0.5, 0.9)), uniform(rng, (0.42, 0.55))
    head, height = y
    x = side * (width - breadth) / 2
    # A little lower and thinner, so that the two tops do not share a plane.
    top_y = height - board / 2
    top = _plate(
        (x, top_y, -(depth + length) / 2 + 0.01), (breadth, board, length + 0.02), colors[0]
    )
    panel = box((x, head / 2, -depth / 2 - length + 0.05), (0.94 * breadth, head, board), colors[1])
    return [top, panel]


def panel_table(rng: np.random.Generator) -> list[Part]:
    """Return a low table of boards: a bent sheet, a box with shelves, or a closed block."""
    kind = pick(rng, {"sheet": 0.30, "shelves": 0.40, "block": 0.30})
    length = uniform(rng, (0.75, 1.40))
    width = uniform(rng, (0.45, 0.80)) * length
    height = uniform(rng, (0.30, 0.50))
    if kind == "sheet" and chance(rng, 0.45):  # as high as a dining table or a console
        height, length, width = 0.75, uniform(rng, (1.1, 2.0)), uniform(rng, (0.38, 0.90))
    board = uniform(rng, (0.025, 0.055))
    body = shade_of(rng, {"wood": 0.70, "paint": 0.30})
    accent = body if chance(rng, 0.5) else shade(rng, "wood" if chance(rng, 0.5) else "laminate")
    x, z = length / 2, width / 2
    if kind == "sheet":
        lean = uniform(rng, (0.0, 0.16)) * height if chance(rng, 0.5) else 0.0
        outer = np.array([(-x - lean, 0), (-x, height), (x, height), (x + lean, 0)])
        inner = np.array([(-x - lean + board, 0), (-x + board, height - board)])
        inner = np.concatenate([inner, inner[::-1] * (-1, 1)])
        parts = [sheet(2, (outer, inner), (-z, z), body)]
        shelf = uniform(rng, (0.25, 0.5)) * height
        reach = x + lean * (1 - shelf / height) - 0.4 * board
        size = (2 * reach, 0.8 * board, 1.9 * z)
        parts.append(_plate((0, shelf, 0.0), size, accent))
        return parts
    over = uniform(rng, (0.006, 0.05))
    parts = [_plate((0, height - board / 2, 0), (length, board, width), accent)]
    low = uniform(rng, (0.03, 0.10))
    inside = height - 0.6 * board
    if kind == "shelves":
        left, front = x - over, z - over
        for side in (-1, 1):
            centre = (side * (left - board / 2), (inside + low) / 2, 0)
            parts.append(box(centre, (board, inside - low, 2 * front), body))
        middle = (low + height) / 2
        for y in (low + board / 2 + 0.01, middle)[: 1 + chance(rng, 0.5)]:
            parts.append(box((0, y, 0), (2 * left - board, board, 1.97 * front), body))
        if chance(rng, 0.6):
            parts.append(box((0, (inside + low) / 2, 0), (board, inside - low, 1.95 * front), body))
        section = rectangle(0.05, 0.05)
        parts += legs(left - 0.04, front - 0.04, low + 0.5 * board, section, section, body)
        return parts
    body_z = z - over
    size = (2 * (x - over), inside - low, 2 * body_z)
    parts.append(box((0, (inside + low) / 2, 0), size, body))
    plinth = (size[0] - 0.08, low + 0.02, size[2] - 0.08)
    parts.append(box((0, low / 2 + 0.01, 0), plinth, shade(rng, "dark-metal")))
    columns = int(rng.integers(1, 4))
    edges = np.linspace(-size[0] / 2, size[0] / 2, columns + 1)
    handle = shade(rng, "dark-metal" if chance(rng, 0.5) else "chrome")
    rows = int(rng.integers(1, 3))
    for a, b in itertools.pairwise(edges):
        parts += _drawers((a, b), (low, height - board), -body_z, rows, accent, handle)
    return parts
