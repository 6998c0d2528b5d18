"""Displays with an image tube: deep cases that narrow to the rear. Metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.display.parts import Look, draw_look
from data_prep.shapes.fronts import dial, frame, panel
from data_prep.shapes.palettes import DISPLAY_CASES, shade
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    lathe,
    moved,
    post,
    prism,
    rectangle,
    rounded,
    sections,
    slab,
    tube,
)

_TUBE_LIT = {"tube": 0.60, "off": 0.15, "lit": 0.25}


def tube_monitor(rng: np.random.Generator) -> list[Part]:
    """Return a computer's tube on a swivel foot, or a television's without one."""
    look = draw_look(rng, {"beige": 0.52, "grey": 0.16, "black": 0.22, "white": 0.10}, _TUBE_LIT)
    width = uniform(rng, (0.34, 0.46))
    height = width * uniform(rng, (0.80, 0.94))
    depth = width * uniform(rng, (0.85, 1.08))
    low = uniform(rng, (0.05, 0.09)) if chance(rng, 0.8) else 0.0
    y = low + height / 2
    face = uniform(rng, (0.16, 0.40)) * depth  # the front part, of full size
    corner = uniform(rng, (0.02, 0.05)) * width
    size, rear = (width, height, depth), uniform(rng, (0.50, 0.75))
    parts = [_funnel(size, y, face, corner, rear, look.case)]
    parts += _tube_screen((width, height), (0.0, y, -depth / 2), look, uniform(rng, (0.0, 0.10)))
    if low > 0.0:
        radius = uniform(rng, (0.30, 0.40)) * width
        profile = np.array([(1.0, 0.0), (1.0, 0.25), (0.55, 0.55), (0.7, 1.6)])
        parts.append(lathe(profile * (radius, low), look.case, sides=20))
    tilt = math.radians(uniform(rng, (0.0, 8.0))) if low > 0.0 else 0.0
    head, under = parts[:-1] if low > 0.0 else parts, parts[-1:] if low > 0.0 else []
    return [moved(part, (0, 0, 0), tilt_rad=tilt) for part in head] + under


def _funnel(
    size: tuple[float, float, float],
    y: float,
    face: float,
    corner: float,
    rear: float,
    color: Color,
) -> Part:
    """Return a case of full section for `face` metres, then narrowing to `rear` of it."""
    width, height, depth = size
    outline = rounded(rectangle(width, height), corner, steps=2)
    front = -depth / 2
    stations = [(front, 0.97, 0.0), (front + 0.04 * depth, 1.0, 0.0), (front + face, 1.0, 0.0)]
    drop = -0.10 * (1 - rear) * height
    stations += [(front + face + 0.03 * depth, 0.92, drop / 4), (0.40 * depth, rear, drop)]
    stations += [(0.5 * depth, 0.9 * rear, drop)]
    z, scale, lower = np.array(stations).T
    centres = np.stack([np.zeros_like(lower), y + lower], axis=1)
    return prism(2, sections(outline, centres, scale[:, None]), z, color)


def _tube_screen(
    size: tuple[float, float], centre: tuple[float, float, float], look: Look, chin: float
) -> list[Part]:
    """Return a frame around a bulging screen, a strip of knobs or buttons below it."""
    width, height = size
    x, y, z = centre
    step = 0.005 * math.hypot(width, height) * 1.2
    chin *= height
    outside = (0.93 * width, 0.92 * height - chin)
    border = 0.07 * width
    middle = y + chin / 2
    parts = [
        frame((x, middle, z - step), (*outside, 4 * step), border, look.border, corner=0.03 * width)
    ]
    glass = rounded(
        rectangle(outside[0] - 1.4 * border, outside[1] - 1.4 * border), 0.05 * width, steps=2
    )
    scale, forward = np.array([(1.0, 0.7), (1.0, -1.0), (0.80, -2.2), (0.45, -2.8)]).T
    bulge = sections(glass, [(x, middle)], scale[:, None])
    parts.append(prism(2, bulge, z + forward * step, look.screen))
    if chin > 0.04 * height:
        size_ = (0.12 * width, 0.4 * chin, 2.4 * step)
        dark: Color = (40, 40, 42)
        parts.append(panel((x - 0.3 * width, y - 0.47 * height + 0.5 * chin, z), size_, dark))
    return parts


def old_television(rng: np.random.Generator) -> list[Part]:
    """Return a box, often of wood, with dials beside the screen; on legs, or with an aerial."""
    wood = chance(rng, 0.65)
    look = draw_look(rng, {"black": 0.45, "grey": 0.25, "beige": 0.30}, {"tube": 0.85, "lit": 0.15})
    case = shade(rng, "wood" if wood else DISPLAY_CASES["enamel"])
    width = uniform(rng, (0.45, 0.75))
    height, depth = width * uniform(rng, (0.62, 0.80)), width * uniform(rng, (0.55, 0.80))
    kind = pick(rng, {"legs": 0.45, "blocks": 0.55})
    low = uniform(rng, (0.20, 0.45)) if kind == "legs" else 0.025
    y, front = low + height / 2, -depth / 2
    step = 0.006 * width
    outline = rounded(rectangle(1, 1), 0.04, steps=2)
    parts = [slab(outline, (0, y, 0), (width, height, depth), case, bevel=0.02 * width)]
    back = (0.62 * width, 0.66 * height, 0.3 * depth)  # the tube's neck
    parts.append(panel((0, y, depth / 2), back, look.border, bevel=0.1 * depth))
    side = uniform(rng, (0.20, 0.28)) * width  # the controls, to the viewer's right
    parts.append(panel((0, y, front), (0.92 * width, 0.88 * height, 3 * step), look.border))
    screen_size = (0.92 * width - side, 0.88 * height)
    rim = Look(case=case, border=look.border, screen=look.screen, stand=look.stand)
    parts += _tube_screen(screen_size, (side / 2, y, front - 1.4 * step), rim, 0.0)
    metal = shade(rng, ((196, 190, 170), (150, 150, 150), (60, 58, 56)))
    x = side / 2 - 0.45 * width
    for k in range(2):
        place = (x, y + (0.28 - 0.24 * k) * height, front - 1.4 * step)
        radius = 0.28 * side
        profile = np.array([(1.0, -1.0), (1.0, 2.0), (0.8, 3.5)]) * (radius, step)
        parts.append(dial(place, profile, metal, sides=12))
        grip = np.array([(0.4, -0.8), (0.4, 5.0), (0.3, 6.0)]) * (radius, step)
        parts.append(dial(place, grip, look.border, sides=8))
    for k in range(3):  # slots of the loudspeaker
        place = (x, y - (0.16 + 0.09 * k) * height, front - 1.4 * step)
        parts.append(panel(place, (0.66 * side, 0.04 * height, 2.6 * step), metal))
    wide, deep = 0.40 * width, 0.34 * depth
    thick = 0.035 * width if kind == "legs" else 0.08 * width
    section = rectangle(thick, thick)
    out = 0.25 * low if kind == "legs" else 0.0
    leg = case if wood else metal
    for i in (-1, 1):
        for k in (-1, 1):
            ends = (i * (wide + out), 0, k * (deep + 0.4 * out)), (i * wide, low + 0.03, k * deep)
            parts.append(post(*ends, 0.6 * section, section, leg))
    if chance(rng, 0.7 if kind == "blocks" else 0.35):
        parts += _aerial(rng, low + height, 0.9 * width, metal, look.border)
    return parts


def _aerial(
    rng: np.random.Generator, y: float, length: float, rod: Color, base: Color
) -> list[Part]:
    """Return two rods that spread from a small block."""
    block = 0.10 * length
    parts = [box((0, y + 0.2 * block, 0), (1.8 * block, block, block), base)]
    for side in (-1.0, 1.0):
        angle = math.radians(uniform(rng, (22.0, 52.0)))
        reach = length * uniform(rng, (0.55, 0.9))
        x = side * 0.4 * block
        tip = (x + side * reach * math.sin(angle), y + reach * math.cos(angle), 0.0)
        rod_path = (x, y + 0.4 * block, 0.0), tip
        parts.append(tube(rod_path, 0.009 * length, rod, sides=6))
    return parts
