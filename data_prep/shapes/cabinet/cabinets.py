"""Procedural cabinets: chests, sideboards, wardrobes, shelves, hutches and kitchens. Metres."""

from __future__ import annotations

import numpy as np

from data_prep.shapes.cabinet.parts import (
    Field,
    Stand,
    carcass,
    darker,
    doors,
    draw_finish,
    drawers,
    glass_doors,
    rack,
    stand,
)
from data_prep.shapes.furniture import legs
from data_prep.shapes.palettes import CABINET, shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, rectangle, slab, tube

# Ranges of width, height, depth (metres), rows and columns of drawers.
_CHESTS = {
    "dresser": ((0.85, 1.50), (0.70, 1.00), (0.40, 0.55), (3, 4), (2, 3)),
    "tallboy": ((0.50, 0.85), (0.95, 1.45), (0.38, 0.50), (4, 6), (1, 1)),
    "bedside": ((0.38, 0.55), (0.42, 0.66), (0.36, 0.46), (1, 3), (1, 1)),
    "filing": ((0.38, 0.48), (0.66, 1.40), (0.45, 0.65), (2, 4), (1, 1)),
}
_CHEST_WEIGHTS = {"dresser": 0.32, "tallboy": 0.28, "bedside": 0.25, "filing": 0.15}
_MATERIAL_WEIGHTS = {
    "chest": {"wood": 0.78, "lacquer": 0.22},
    "sideboard": {"wood": 0.72, "lacquer": 0.28},
    "wardrobe": {"wood": 0.58, "lacquer": 0.42},
    "shelves": {"wood": 0.66, "lacquer": 0.34},
    "hutch": {"wood": 0.65, "lacquer": 0.35},
}


def _body_color(rng: np.random.Generator, family: str) -> Color:
    return shade_of(rng, _MATERIAL_WEIGHTS[family])


def _top(
    width: float, height: float, depth: float, over: float, thick: float, color: Color
) -> Part:
    """Return a plate on a body of this size, standing out by `over`, but not behind."""
    centre = (0.0, height + thick / 2 - 0.004, -over / 2)
    size = (width + 2 * over, thick, depth + over - 0.012)
    return slab(rectangle(1, 1), centre, size, color, bevel=0.2 * thick)


def chest(rng: np.random.Generator) -> list[Part]:
    """Return drawers from the floor up: a dresser, tallboy, bedside chest or filing cabinet."""
    kind = pick(rng, _CHEST_WEIGHTS)
    widths, heights, depths, row_range, column_range = _CHESTS[kind]
    width, height, depth = uniform(rng, widths), uniform(rng, heights), uniform(rng, depths)
    rows = int(rng.integers(row_range[0], row_range[1] + 1))
    columns = int(rng.integers(column_range[0], column_range[1] + 1))
    steel = kind == "filing"
    body = shade(rng, CABINET["steel"]) if steel else _body_color(rng, "chest")
    finish = draw_finish(rng, body, (width, height, depth))
    kinds: dict[Stand, float] = {"plinth": 0.35, "legs": 0.35, "blocks": 0.30}
    under: Stand = "plinth" if steel else pick(rng, kinds)
    low = uniform(rng, (0.08, 0.22)) if under == "legs" else uniform(rng, (0.04, 0.09))
    parts = [carcass((0, (low + height) / 2, 0), (width, height - low, depth), body)]
    parts += stand(rng, under, (width, low, depth), darker(body, 0.7) if steel else body)
    if not steel and chance(rng, 0.75):
        thick, over = uniform(rng, (0.020, 0.045)), uniform(rng, (0.012, 0.035))
        color = shade(rng, "wood") if chance(rng, 0.2) else body
        parts.append(_top(width, height, depth, over, thick, color))
    edge = uniform(rng, (0.010, 0.035))
    field = Field(edge - width / 2, width / 2 - edge, low + edge, height - edge, -depth / 2)
    heights_up = np.linspace(1.0, uniform(rng, (0.6, 1.0)), rows).tolist()
    if kind == "bedside" and rows > 1 and chance(rng, 0.5):  # a door under a drawer
        below, above = field.split([1], [2, 1])
        return parts + doors(finish, below, 1) + drawers(finish, above, [1])
    return parts + drawers(finish, field, heights_up, columns)


def sideboard(rng: np.random.Generator) -> list[Part]:
    """Return a low, wide row of bays: doors, drawers or open."""
    width, height, depth = (uniform(rng, r) for r in ((1.10, 2.10), (0.45, 0.90), (0.36, 0.50)))
    body = _body_color(rng, "sideboard")
    finish = draw_finish(rng, body, (width, height, depth))
    kinds: dict[Stand, float] = {"legs": 0.55, "sled": 0.20, "plinth": 0.25}
    under = pick(rng, kinds)
    low = uniform(rng, (0.04, 0.08)) if under == "plinth" else uniform(rng, (0.10, 0.26))
    metal = under == "sled" or chance(rng, 0.2)
    parts = stand(rng, under, (width, low, depth), shade(rng, "dark-metal") if metal else body)
    board = uniform(rng, (0.022, 0.045))
    bays = int(rng.integers(2, 5))
    sizes = [1.0, *(pick(rng, {1.0: 0.6, 1.5: 0.4}) for _ in range(bays - 2)), 1.0]
    kind: list[str] = [pick(rng, {"doors": 0.5, "drawers": 0.3, "open": 0.2}) for _ in range(bays)]
    if set(kind) == {"open"}:
        kind[0] = "doors"
    whole = Field(-width / 2, width / 2, low, height, -depth / 2)
    rows = [2 if what == "open" else 1 for what in kind]
    parts += rack(whole, depth, board, sizes, rows, body, darker(body, 0.8))
    inside = Field(
        board / 2 - width / 2,
        width / 2 - board / 2,
        low + board / 2,
        height - board / 2,
        -depth / 2,
    )
    for bay, what in zip(inside.split(sizes, [1]), kind, strict=True):
        if what == "open":
            continue
        x, y = (bay.x_low + bay.x_high) / 2, (bay.y_low + bay.y_high) / 2
        wide, high = bay.x_high - bay.x_low, bay.y_high - bay.y_low
        parts.append(box((x, y, -0.02 * depth), (wide, high, 0.955 * depth), body))
        if what == "doors":
            parts += doors(finish, bay, 2 if wide > 1.1 * high else 1)
        else:
            parts += drawers(finish, bay, [1.0] * int(rng.integers(2, 4)))
    return parts


def wardrobe(rng: np.random.Generator) -> list[Part]:
    """Return a cabinet as tall as a person, with one to four doors.

    It may have drawers below and a cornice.
    """
    height, depth = uniform(rng, (1.65, 2.30)), uniform(rng, (0.48, 0.66))
    count = pick(rng, {1: 0.12, 2: 0.50, 3: 0.22, 4: 0.16})
    width = count * uniform(rng, (0.42, 0.56))
    body = _body_color(rng, "wardrobe")
    finish = draw_finish(rng, body, (width, height, depth))
    kinds: dict[Stand, float] = {"plinth": 0.55, "legs": 0.15, "blocks": 0.30}
    low = uniform(rng, (0.06, 0.14))
    parts = stand(rng, pick(rng, kinds), (width, low, depth), body)
    parts.append(carcass((0, (low + height) / 2, 0), (width, height - low, depth), body))
    if chance(rng, 0.5):  # a cornice
        over = uniform(rng, (0.03, 0.07))
        thick = uniform(rng, (0.05, 0.10))
        parts.append(_top(width, height, depth, over, thick, body))
        parts.append(_top(width, height - 0.6 * thick, depth, 0.5 * over, thick, body))
    edge = uniform(rng, (0.02, 0.05))
    field = Field(edge - width / 2, width / 2 - edge, low + edge, height - edge, -depth / 2)
    if chance(rng, 0.35):
        below, field = field.split([1], [uniform(rng, (0.2, 0.35)), 1])
        parts += drawers(finish, below, [1.0] * int(rng.integers(1, 3)), min(count, 2))
    if chance(rng, 0.25):
        return parts + glass_doors(finish, field, count, shade(rng, CABINET["glass"]))
    return parts + doors(finish, field, count)


def shelving(rng: np.random.Generator) -> list[Part]:
    """Return open shelves, perhaps with doors in front of the lowest; or boards between posts."""
    width, height, depth = (uniform(rng, r) for r in ((0.45, 1.70), (0.75, 2.20), (0.24, 0.42)))
    color = _body_color(rng, "shelves")
    rows = max(2, round(height / uniform(rng, (0.28, 0.48))))
    if chance(rng, 0.28):
        return _etagere(rng, (width, height, depth), rows, color)
    columns = max(1, round(width / uniform(rng, (0.42, 0.90))))
    board = uniform(rng, (0.020, 0.042))
    whole = Field(-width / 2, width / 2, 0.0, height, -depth / 2)
    tone = pick(rng, {1.0: 0.5, 0.8: 0.3, 0.62: 0.2})
    back = darker(color, tone) if chance(rng, 0.72) else None
    parts = rack(whole, depth, board, [1] * columns, [rows] * columns, color, back)
    if rows > 2 and chance(rng, 0.35):  # doors in front of the lowest shelves
        finish = draw_finish(rng, color, (width, height, depth))
        shut = 1 if rows < 5 else 2
        top = board / 2 + (height - board) * shut / rows
        size = (width - board, top - 0.02, 0.94 * depth)
        parts.append(box((0, 0.02 + (top - 0.02) / 2, -0.02 * depth), size, color))
        field = Field(-width / 2, width / 2, 0.02, top, -0.5 * depth)
        parts += doors(finish, field, max(1, round(width / 0.45)))
    return parts


def _etagere(
    rng: np.random.Generator, size: tuple[float, float, float], rows: int, color: Color
) -> list[Part]:
    """Return boards between four posts, without sides."""
    width, height, depth = size
    thick = uniform(rng, (0.018, 0.034))
    metal = shade_of(rng, {"dark-metal": 0.6, "chrome": 0.25, "wood": 0.15})
    section = rectangle(thick, thick)
    # A board's corners lie inside the posts.
    x, z = width / 2 - 0.2 * thick, depth / 2 - 0.2 * thick
    parts = legs(x, z, height, section, section, metal)
    board = uniform(rng, (0.018, 0.036))
    for y in np.linspace(uniform(rng, (0.06, 0.22)), height - board, rows + 1):
        parts.append(
            slab(rectangle(1, 1), (0, y, 0), (2 * x, board, 2 * z), color, bevel=0.08 * board)
        )
    if chance(rng, 0.5):
        for side in (-x, x):
            ends = (side, 0.08, z), (-side, height - 0.04, z)
            parts.append(tube(ends, 0.35 * thick, metal, sides=6))
    return parts


def hutch(rng: np.random.Generator) -> list[Part]:
    """Return a cabinet with a shallower one on it, of glass doors or shelves."""
    width, waist, height = (uniform(rng, r) for r in ((0.80, 1.60), (0.72, 0.95), (1.70, 2.20)))
    depth = uniform(rng, (0.40, 0.56))
    body = _body_color(rng, "hutch")
    finish = draw_finish(rng, body, (width, height, depth))
    kinds: dict[Stand, float] = {"plinth": 0.45, "blocks": 0.55}
    low = uniform(rng, (0.05, 0.12))
    parts = stand(rng, pick(rng, kinds), (width, low, depth), body)
    parts.append(carcass((0, (low + waist) / 2, 0), (width, waist - low, depth), body))
    top = shade(rng, "wood") if chance(rng, 0.35) else body
    parts.append(_top(width, waist, depth, 0.02, 0.03, top))
    count = max(2, round(width / 0.45))
    field = Field(0.02 - width / 2, width / 2 - 0.02, low + 0.02, waist - 0.02, -depth / 2)
    below, above = field.split([1], [2.4, 1])
    parts += doors(finish, below, count) + drawers(finish, above, [1], count)

    shallow = uniform(rng, (0.55, 0.75)) * depth
    narrow = width - uniform(rng, (0.0, 0.10)) - 0.01
    front = depth / 2 - shallow - 0.012
    upper = Field(-narrow / 2, narrow / 2, waist, height, front)
    if chance(rng, 0.45):
        centre = (0, (waist + height) / 2, front + shallow / 2)
        size = (narrow, height - waist, shallow)
        parts.append(carcass(centre, size, body))
        panes = Field(0.02 - narrow / 2, narrow / 2 - 0.02, waist + 0.08, height - 0.03, front)
        parts += glass_doors(finish, panes, count, shade(rng, CABINET["glass"]))
    else:
        columns = int(rng.integers(1, 3))
        back = darker(body, uniform(rng, (0.6, 0.85)))
        shelves = [int(rng.integers(3, 5))] * columns
        parts += rack(upper, shallow, 0.03, [1] * columns, shelves, body, back)
    if chance(rng, 0.6):  # a cornice
        size = (narrow + 0.09, 0.06, shallow + 0.03)
        centre = (0, height + 0.02, front + shallow / 2 - 0.03)
        parts.append(slab(rectangle(1, 1), centre, size, body, bevel=0.02))
    return parts
