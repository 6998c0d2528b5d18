"""Parts of lamps: shades, bowls, globes, stems; and their colours."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from data_prep.shapes.palettes import LAMP, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, lathe, moved, prism, tube, turned

METAL = {"dark-metal": 0.40, "chrome": 0.35, "brass": 0.25}  # of what is made of metal indoors


tint = partial(shade_of, palette=LAMP)


def ball(centre: ArrayLike, radius: float, color: Color, *, sides: int = 10) -> Part:
    """Return a globe whose poles are cut off at a sixth of its radius.

    A rod thicker than that holds it.
    """
    latitude = np.radians([-80, -50, -18, 18, 50, 80])
    profile = radius * np.stack([np.cos(latitude), np.sin(latitude)], axis=1)
    return moved(lathe(profile, color, sides=sides), centre)


def rod(foot_y: float, head_y: float, radius: float, color: Color) -> Part:
    """Return a round upright bar on the axis."""
    return lathe([(radius, foot_y), (radius, head_y)], color, sides=8)


def bowl(
    radius: float,
    depth: float,
    color: Color,
    *,
    apex: float = 0.2,
    curve: float,
    sides: int = 14,
) -> Part:
    """Return a reflector that opens downwards: top at the origin, rim `depth` below.

    The top is the outer one.

    apex   radius of the top over that of the rim
    curve  1 a cone, below 1 a dome (it widens soon)
    """
    fall = np.linspace(0.0, 1.0, 2 if curve == 1.0 else 5)
    outer = np.stack([radius * (apex + (1 - apex) * fall**curve), -depth * fall], axis=1)
    wall = 0.05 * radius
    inner = outer - (wall, 0.0)
    inner[:-1, 1] -= wall
    return lathe(np.concatenate([outer, inner[::-1]]), color, sides=sides)


def open_shade(
    low_high: tuple[float, float], y: tuple[float, float], color: Color, *, sides: int, waist: float
) -> list[Part]:
    """Return a shade open above and below, and the bar across it.

    A stem or cord on the axis holds the bar.

    low_high  radius at its lower and its upper edge
    y         height of these
    waist     radius half-way up, over that of a straight wall
    """
    (low, high), (y_low, y_high) = low_high, y
    wall = 0.045 * low
    level = np.array([0.0, 0.5, 1.0])
    radii = (low + (high - low) * level) * (1.0, waist, 1.0)
    heights = y_low + (y_high - y_low) * level
    section = np.concatenate(
        [np.stack([radii, heights], 1), np.stack([radii - wall, heights], 1)[::-1]]
    )
    angle = np.arange(sides) * (2 * math.pi / sides)  # a corner on x, where the bar ends in it
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    walls = prism(1, section[:, :1, None] * around, section[:, 1], color, closed=True)
    bar_y = bar_height(y)
    reach = float(np.interp(bar_y, heights, radii)) - wall / 2
    bar = tube([(-reach, bar_y, 0), (reach, bar_y, 0)], 0.3 * wall, LAMP["dark-metal"][1])
    parts = [walls, bar]
    # Square and triangular shades look along the axes, not across them.
    return [turned(part, math.pi / sides) for part in parts] if sides < 6 else parts


def bar_height(y: tuple[float, float]) -> float:
    """Return the height of the bar that holds an open shade between these heights."""
    return y[1] - 0.12 * (y[1] - y[0])


def fabric_shade(rng: np.random.Generator, radius: float, y_low: float) -> tuple[list[Part], float]:
    """Return an open shade of any usual form, lower radius `radius`, and the height of its bar."""
    form = pick(rng, {"drum": 0.34, "cone": 0.34, "bell": 0.14, "square": 0.12, "hexagon": 0.06})
    top, waist, sides = {
        "drum": (uniform(rng, (0.88, 1.0)), 1.0, 16),
        "cone": (uniform(rng, (0.40, 0.70)), 1.0, 16),
        "bell": (uniform(rng, (0.35, 0.55)), uniform(rng, (0.80, 0.90)), 16),
        "square": (uniform(rng, (0.55, 1.0)), 1.0, 4),
        "hexagon": (uniform(rng, (0.45, 0.80)), 1.0, 6),
    }[form]
    y = y_low, y_low + radius * uniform(rng, (0.95, 1.9))
    color = tint(rng, {"linen": 0.66, "dyed": 0.24, "amber": 0.10})
    if form == "square":
        radius *= 1.2
    return open_shade((radius, top * radius), y, color, sides=sides, waist=waist), bar_height(y)


def shaded_stem(
    rng: np.random.Generator, foot_y: float, y_low: float, radius: float, color: Color
) -> list[Part]:
    """Return a stem from `foot_y` up into a fabric shade with a bulb, from `y_low` on."""
    parts, held_y = fabric_shade(rng, radius, y_low)
    stem = 0.05 * radius + 0.002
    bulb = ball((0, y_low + 0.5 * (held_y - y_low), 0), 5 * stem, LAMP["milk-glass"][1])
    knob = [ball((0, held_y + 2.4 * stem, 0), 2.2 * stem, color)] if chance(rng, 0.5) else []
    return [*parts, rod(foot_y, held_y + 1.2 * stem, stem, color), bulb, *knob]


def to_a_side(rng: np.random.Generator, parts: list[Part]) -> list[Part]:
    """Return the parts turned about the axis by none to three right angles."""
    yaw_rad = int(rng.integers(4)) * math.pi / 2
    return [turned(part, yaw_rad) for part in parts]
