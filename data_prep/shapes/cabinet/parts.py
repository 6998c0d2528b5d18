"""Parts of cabinets of all families: doors, drawers, handles, boards and feet.

Lengths are in metres. What stands out does so in steps of a `layer`, a hundredth of the cabinet's
radius: seams and panels are then as visible on a wardrobe as on a nightstand.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.fronts import dial, frame, panel
from data_prep.shapes.furniture import legs
from data_prep.shapes.palettes import shade, shade_of
from data_prep.shapes.random_choices import pick, uniform
from data_prep.shapes.solids import Color, Part, box, rectangle, slab, sweep

_Handle = Literal["knob", "bar", "pull", "none"]
_Leaf = Literal["flat", "framed", "raised"]
Stand = Literal["plinth", "legs", "blocks", "sled"]


@dataclass(frozen=True)
class Finish:
    """The look of a cabinet's surfaces.

    seam    what is seen between two doors
    handle  of doors and drawers; "none" opens by a push
    layer   step in which parts stand out, metres
    """

    body: Color
    front: Color
    seam: Color
    trim: Color
    leaf: _Leaf
    handle: _Handle
    layer: float


@dataclass(frozen=True)
class Field:
    """An upright rectangle in a front, at depth z (smaller is nearer to the viewer)."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float
    z: float

    def split(self, columns: Sequence[float], rows: Sequence[float]) -> list[Field]:
        """Return the fields of a grid, column by column, and each column from below.

        columns, rows  relative widths of the columns, and relative heights of the rows
        """
        xs = self.x_low + (self.x_high - self.x_low) * _steps(columns)
        ys = self.y_low + (self.y_high - self.y_low) * _steps(rows)
        return [
            Field(float(left), float(right), float(low), float(high), self.z)
            for left, right in itertools.pairwise(xs)
            for low, high in itertools.pairwise(ys)
        ]


def _steps(sizes: Sequence[float]) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(sizes)]) / sum(sizes)


def draw_finish(rng: np.random.Generator, body: Color, size: tuple[float, float, float]) -> Finish:
    """Draw a finish that suits a body of this colour and size (width, height, depth in metres)."""
    front = pick(rng, {"same": 0.60, "tone": 0.28, "lacquer": 0.12})
    tone = uniform(rng, (0.72, 0.90))
    colors = {"same": body, "tone": darker(body, tone), "lacquer": shade(rng, "lacquer")}
    return Finish(
        body=body,
        front=colors[front],
        seam=darker(body, 0.45),
        trim=shade_of(rng, {"chrome": 0.40, "dark-metal": 0.35, "brass": 0.25}),
        leaf=pick(rng, {"flat": 0.45, "framed": 0.30, "raised": 0.25}),
        handle=pick(rng, {"knob": 0.40, "bar": 0.35, "pull": 0.17, "none": 0.08}),
        layer=0.011 * math.hypot(*size) / 2,
    )


def carcass(centre: ArrayLike, size: tuple[float, float, float], color: Color) -> Part:
    """Return a closed box whose edges are bevelled by 6 mm."""
    return slab(rectangle(1, 1), centre, size, color, bevel=0.006)


def darker(color: Color, factor: float) -> Color:
    """Return a colour times a factor; no channel falls below 12, the least of any material."""
    red, green, blue = (max(12, round(factor * value)) for value in color)
    return red, green, blue


def doors(finish: Finish, field: Field, count: int) -> list[Part]:
    """Return doors side by side, which open in pairs: their handles are next to each other."""
    parts = [_seam(finish, field)]
    for k, place in enumerate(field.split([1] * count, [1])):
        hinge_left = k % 2 == 0 and count > 1
        parts += _leaf(finish, place)
        inset = 6 * finish.layer
        x = place.x_high - inset if hinge_left else place.x_low + inset
        high = field.y_high - field.y_low
        y = field.y_low + (0.5 if high > 1.0 else 0.62) * high
        parts += _handle(finish, (x, y, field.z), upright=True, room=high)
    return parts


def drawers(finish: Finish, field: Field, rows: Sequence[float], columns: int = 1) -> list[Part]:
    """Return drawers in rows of relative heights, the lowest first."""
    parts = [_seam(finish, field)]
    for place in field.split([1] * columns, rows):
        parts += _leaf(finish, place)
        y = (place.y_low + place.y_high) / 2
        wide = place.x_high - place.x_low
        places = (0.0,) if wide < 75 * finish.layer or finish.handle == "bar" else (-0.27, 0.27)
        for side in places:
            x = (place.x_low + place.x_high) / 2 + side * wide
            parts += _handle(finish, (x, y, field.z), upright=False, room=wide)
    return parts


def glass_doors(finish: Finish, field: Field, count: int, glass: Color) -> list[Part]:
    """Return framed panes side by side."""
    bars = replace(finish, front=glass, leaf="framed")
    parts = [_seam(finish, field)]
    for place in field.split([1] * count, [1]):
        parts += _leaf(bars, place, finish.front)
    return parts


def _seam(finish: Finish, field: Field) -> Part:
    step, width, height = finish.layer, field.x_high - field.x_low, field.y_high - field.y_low
    centre = ((field.x_low + field.x_high) / 2, (field.y_low + field.y_high) / 2, field.z)
    return panel(centre, (width - step, height - step, 2 * step), finish.seam)


def _leaf(finish: Finish, field: Field, frame_color: Color | None = None) -> list[Part]:
    """Return a door or a drawer's front, two layers in front of the field."""
    step = finish.layer
    width = field.x_high - field.x_low - 1.4 * step
    height = field.y_high - field.y_low - 1.4 * step
    x, y = (field.x_low + field.x_high) / 2, (field.y_low + field.y_high) / 2
    size = (width, height, 3 * step)
    bevel = 0.3 * step if finish.leaf == "flat" else 0.0
    parts = [panel((x, y, field.z - step), size, finish.front, bevel=bevel)]
    border = min(0.16 * min(width, height), 7 * step)
    front = (x, y, field.z - 2.25 * step)
    if finish.leaf == "framed":
        color = frame_color or finish.front
        inside = 0.3 * step  # a frame flush with its panel would flicker where colours differ
        size = (width - inside, height - inside, 2.5 * step)
        parts.append(frame(front, size, border, color))
    elif finish.leaf == "raised":
        size = (width - 2 * border, height - 2 * border, 2.5 * step)
        parts.append(panel(front, size, finish.front, bevel=step))
    return parts


def _handle(
    finish: Finish, place: tuple[float, float, float], *, upright: bool, room: float
) -> list[Part]:
    """Return a handle at a place of the covered field; `room` is the leaf's length there."""
    step, (x, y, z) = finish.layer, place
    if finish.handle == "none":
        return []
    if finish.handle == "knob":
        profile = np.array([(0.9, 1.5), (0.9, 4.2), (2.3, 5.0), (1.8, 6.8)])
        return [dial(place, profile * step, finish.trim, sides=7)]
    length = min(14 * step, 0.5 * room)
    if finish.handle == "pull":
        size = (2 * step, length, 3 * step) if upright else (length, 2 * step, 3 * step)
        return [panel((x, y, z - 3.2 * step), size, finish.trim, bevel=0.5 * step)]
    ends = np.array([(-0.5, 1.5), (-0.5, 5.5), (0.5, 5.5), (0.5, 1.5)]) * (length, -step)
    path = np.empty((4, 3))
    path[:] = place
    path[:, 1 if upright else 0] += ends[:, 0]
    path[:, 2] += ends[:, 1]
    up = (1, 0, 0) if upright else (0, 1, 0)
    return [sweep(path, rectangle(1.3 * step, 1.3 * step), finish.trim, up=up)]


def rack(
    field: Field,
    depth: float,
    board: float,
    columns: Sequence[float],
    rows: Sequence[int],
    color: Color,
    back: Color | None,
) -> list[Part]:
    """Return boards around open bays: sides, top, bottom, uprights, shelves, and a back.

    There is no back where `back` is None.

    field    the front, outside measures
    board    thickness
    columns  relative widths of the bays
    rows     how many openings each bay has, one above the other
    """
    x, y = (field.x_low + field.x_high) / 2, (field.y_low + field.y_high) / 2
    wide, high = field.x_high - field.x_low, field.y_high - field.y_low
    z = field.z + depth / 2

    def plate(centre: tuple[float, float, float], size: tuple[float, float, float]) -> Part:
        return slab(rectangle(1, 1), centre, size, color, bevel=0.08 * board)

    parts = [plate((x + side * (wide - board) / 2, y, z), (board, high, depth)) for side in (-1, 1)]
    # Ends lie in the middle of the board that they meet.
    for side in (-1, 1):
        centre = (x, y + side * (high - 1.1 * board) / 2, z)
        parts.append(plate(centre, (wide - board, board, 0.996 * depth)))
    bays = Field(
        field.x_low + board / 2, field.x_high - board / 2, field.y_low, field.y_high, field.z
    ).split(columns, [1])
    for bay, count in zip(bays, rows, strict=True):
        if bay is not bays[-1]:
            size = (board, high - board, 0.99 * depth)
            parts.append(plate((bay.x_high, y, z), size))
        for low in np.linspace(field.y_low + board / 2, field.y_high - board / 2, count + 1)[1:-1]:
            centre = ((bay.x_low + bay.x_high) / 2, low, z)
            size = (bay.x_high - bay.x_low, 0.8 * board, 0.95 * depth)
            parts.append(plate(centre, size))
    if back is not None:
        size = (wide - 1.2 * board, high - 1.2 * board, 0.04 * depth)
        parts.append(box((x, y, z + 0.465 * depth), size, back))
    return parts


def stand(
    rng: np.random.Generator, kind: Stand, size: tuple[float, float, float], color: Color
) -> list[Part]:
    """Return the parts that carry a body above a floor at y = 0.

    size  width and depth of the body and how high its underside is
    """
    width, height, depth = size
    top = height + 0.012
    if kind == "plinth":
        box_size = (0.95 * width, top, 0.88 * depth)
        return [box((0, top / 2, 0.03 * depth), box_size, color)]
    if kind == "sled":
        bar = rectangle(0.024, 0.024)
        x, z = 0.42 * width, 0.40 * depth
        return [
            sweep(
                [(s, top, -z), (s, 0.012, -z), (s, 0.012, z), (s, top, z)], bar, color, up=(1, 0, 0)
            )
            for s in (-x, x)
        ]
    thick = min(uniform(rng, (0.030, 0.055)), 0.12 * depth)
    taper, splay = uniform(rng, (0.45, 1.0)), uniform(rng, (0.0, 0.15))
    if kind == "blocks":
        thick, taper, splay = min(2.2 * thick, 0.2 * depth), 0.85, 0.0
    head = rectangle(thick, thick)
    x, z = width / 2 - 0.7 * thick, depth / 2 - 0.7 * thick
    out = min(splay * height, 0.5 * thick)
    return legs(x, z, top, taper * head, head, color, out=out)
