"""Procedural tables: on legs, on a column, on trestles, on a metal frame, of panels, and desks.

A table has no front, but a desk's drawers and the place for the knees look towards -Z. The longer
side of the top lies along x.
"""

from __future__ import annotations

import math

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.furniture import beam, legs
from data_prep.shapes.palettes import TABLE, shade, shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    fillet,
    lathe,
    loft,
    moved,
    polygon,
    post,
    rectangle,
    rim,
    rounded,
    slab,
    sweep,
)


def _top(shape: str, size: tuple[float, float], y: tuple[float, float], color: Color) -> Part:
    """Return the plate from y[0] to y[1]: `size` is its extent in x and z."""
    length, width = size
    if shape == "round":
        outline = polygon(24, 0.5)
    else:
        corner = {"square": 0.012, "rounded": 0.22 * min(size)}[shape]
        outline = rounded(rectangle(*size), corner) / size
    height = y[1] - y[0]
    return slab(outline, (0, (y[0] + y[1]) / 2, 0), (length, height, width), color, bevel=0.005)


def _turned(height: float, radius: float) -> Floats:
    """Return the profile (radius, y) of a turned leg or column, from the floor to the top."""
    stations = [(0.55, 0.0), (0.7, 0.06), (0.5, 0.12), (0.62, 0.3), (1.0, 0.62), (0.7, 0.74)]
    stations += [(1.0, 0.80), (1.0, 1.0)]
    return np.array(stations) * (radius, height)


def four_leg(rng: np.random.Generator) -> list[Part]:
    """Return a dining, coffee or side table on four legs."""
    kind = pick(rng, {"dining": 0.52, "coffee": 0.30, "side": 0.18})
    shape = pick(rng, {"square": 0.62, "rounded": 0.20, "round": 0.18})
    height = uniform(
        rng, {"dining": (0.70, 0.78), "coffee": (0.34, 0.50), "side": (0.46, 0.66)}[kind]
    )
    length = uniform(
        rng, {"dining": (0.90, 2.10), "coffee": (0.70, 1.30), "side": (0.36, 0.60)}[kind]
    )
    width = {
        "dining": min(uniform(rng, (0.70, 1.00)), length),
        "coffee": length * uniform(rng, (0.45, 0.95)),
        "side": length * uniform(rng, (0.80, 1.00)),
    }[kind]
    frame = shade_of(rng, {"wood": 0.80, "paint": 0.13, "dark-metal": 0.07})
    covering = pick(rng, {"frame": 0.66, "wood": 0.16, "glass": 0.10, "stone": 0.08})
    top = frame if covering == "frame" else shade(rng, TABLE[covering])

    thickness = uniform(rng, (0.020, 0.055))
    under, inside = height - thickness, height - thickness / 2
    thick = uniform(rng, (0.035, 0.060)) * (1.0 if kind == "dining" else 0.85)
    overhang = thick / 2 + uniform(rng, (0.010, 0.07)) * width
    spread = 0.68 if shape == "round" else 1.0  # legs stand inside the circle
    x, z = spread * (length / 2 - overhang), spread * (width / 2 - overhang)
    if shape == "rounded":
        x, z = x - 0.05 * width, z - 0.05 * width

    parts = [_top(shape, (length, width), (under, height), top)]
    style = pick(rng, {"square": 0.42, "round": 0.20, "turned": 0.20, "splayed": 0.18})
    if style == "turned":
        profile = _turned(inside, 0.62 * thick)
        parts += [
            moved(lathe(profile, frame, sides=8), (i * x, 0.0, k * z))
            for i in (-1, 1)
            for k in (-1, 1)
        ]
    else:
        head = rectangle(thick, thick) if style == "square" else polygon(8, thick / 2)
        foot = head * uniform(rng, (0.55, 1.0))
        out = uniform(rng, (0.03, 0.11)) * height if style == "splayed" else 0.0
        parts += legs(x, z, inside, foot, head, frame, out=out)
    if chance(rng, 0.62):
        apron = uniform(rng, (0.05, 0.11)) * (1.0 if kind == "dining" else 0.8)
        ring = polygon(16, 0.5) * 2.3 if shape == "round" else rectangle(2.0, 2.0)
        parts.append(rim(ring * (x, z), under - apron, under + 0.3 * thickness, 0.022, frame))
    if style == "splayed":
        return parts
    low = uniform(rng, (0.12, 0.3)) * height
    bar = 0.55 * thick
    below = pick(rng, {"none": 0.58, "h": 0.16, "box": 0.12, "shelf": 0.14})
    if below == "shelf":
        plate = box((0, low, 0), (2 * x + 0.4 * thick, 0.022, 2 * z + 0.4 * thick), top)
        parts.append(plate)
    elif below != "none":
        sides = [beam((i * x, low, -z), (i * x, low, z), bar, bar, frame) for i in (-1, 1)]
        ends = [0.0] if below == "h" else [-z, z]
        sides += [beam((-x, low, k), (x, low, k), bar, 1.1 * bar, frame) for k in ends]
        parts += sides
    return parts


def pedestal(rng: np.random.Generator) -> list[Part]:
    """Return a top on one column; a long one on two."""
    shape = pick(rng, {"round": 0.66, "square": 0.16, "rounded": 0.18})
    height = uniform(rng, pick(rng, {(0.70, 0.77): 0.62, (0.42, 0.58): 0.22, (0.98, 1.10): 0.16}))
    length = min(uniform(rng, (0.60, 1.35)), 1.5 * height)
    long = shape != "square" and length > 1.1 and chance(rng, 0.5)
    if long:  # two columns carry an oval or boat-shaped top
        length = uniform(rng, (1.6, 2.2))
    width = uniform(rng, (0.85, 1.05)) if long else length * uniform(rng, (0.9, 1.0))
    thickness = uniform(rng, (0.018, 0.045))
    under = height - thickness
    foot_kind = pick(rng, {"disc": 0.46, "feet": 0.34, "block": 0.20})
    wooden = chance(rng, 0.25 if foot_kind == "disc" else 0.6)
    frame = shade(rng, "wood" if wooden else pick(rng, {"dark-metal": 0.6, "chrome": 0.4}))
    top = shade_of(rng, {"wood": 0.55, "glass": 0.15, "stone": 0.18, "paint": 0.12}, TABLE)
    if wooden and chance(rng, 0.7):
        top = frame

    parts = [_top(shape, (length, width), (under, height), top)]
    radius = uniform(rng, (0.030, 0.060)) * (1.3 if wooden else 1.0)
    reach = min(width, length) * uniform(rng, (0.26, 0.34))
    turned = wooden and chance(rng, 0.6)
    count = int(rng.integers(3, 5))
    for x in (-0.27 * length, 0.27 * length) if long else (0.0,):
        plate = [(0.45 * reach, under - 0.018), (0.45 * reach, under + 0.4 * thickness)]
        parts.append(moved(lathe(plate, frame, sides=12), (x, 0.0, 0.0)))
        if foot_kind == "disc":
            rise = uniform(rng, (0.02, 0.06))
            profile = [(reach, 0.0), (reach, 0.018), (radius, 0.018 + rise)]
            profile += [(radius, height - 0.6 * thickness)]
            parts.append(moved(lathe(profile, frame, sides=20), (x, 0.0, 0.0)))
            continue
        if foot_kind == "block":
            edge = (1.7 * reach, 0.05, 1.7 * reach)
            parts.append(box((x, 0.025, 0.0), edge, frame))
            column = rectangle(2.2 * radius, 2.2 * radius)
            parts.append(post((x, 0.02, 0), (x, under + 0.002, 0), column, column, frame))
            continue
        foot_y = 0.10 if wooden else 0.05
        profile = _turned(under, 1.4 * radius) if turned else [(radius, 0.0), (radius, under)]
        profile = np.array(profile) * (1.0, 1 - foot_y / under) + (0.0, foot_y + 0.002)
        parts.append(moved(lathe(profile, frame, sides=12), (x, 0.0, 0.0)))
        parts += _claws(x, reach, radius, foot_y, 2 if long else count, frame)
    return parts


def _claws(
    x: float, reach: float, radius: float, foot_y: float, count: int, color: Color
) -> list[Part]:
    """Return feet around a column, falling to the floor; two of them lie across the table."""
    parts = []
    for k in range(count):
        angle = 2 * math.pi * k / count + (math.pi / 2 if count == 2 else math.pi / 4)
        way = np.array([math.cos(angle), 0.0, math.sin(angle)])
        aside = np.array([-way[2], 0.0, way[0]])
        rings = np.empty((4, 4, 3))
        stations = [(0.0, 2.4, 0.0), (0.35, 1.8, 0.35), (0.85, 0.0, 0.0), (1.0, 0.0, 0.0)]
        for ring, (out, up, low) in zip(rings, stations, strict=True):
            y = np.array([low, low, up, up]) * foot_y + (0.0, 0.0, 0.03, 0.03)
            side = np.array([-1, 1, 1, -1])[:, None] * (0.7 - 0.25 * out) * radius * aside
            ring[:] = (x, 0.0, 0.0) + out * reach * 1.25 * way + side
            ring[:, 1] = y
        parts.append(loft(rings, color))
    return parts


def trestle(rng: np.random.Generator) -> list[Part]:
    """Return a top on two trestles that a beam ties: A-shaped, crossed or T-shaped."""
    height, length = uniform(rng, (0.70, 0.78)), uniform(rng, (1.2, 2.3))
    width = uniform(rng, (0.65, 0.95))
    thickness = uniform(rng, (0.025, 0.06))
    frame = shade_of(rng, {"wood": 0.85, "paint": 0.10, "dark-metal": 0.05})
    top = frame if chance(rng, 0.6) else shade(rng, "wood")
    under, inside = height - thickness, height - 0.5 * thickness
    x = length / 2 - uniform(rng, (0.10, 0.22)) * length
    bar = uniform(rng, (0.045, 0.085))
    kind = pick(rng, {"a": 0.36, "x": 0.34, "t": 0.30})
    parts = [_top("square", (length, width), (under, height), top)]
    foot_z = width / 2 - 0.04
    head_z = {"a": 0.30, "x": 0.95, "t": 0.0}[kind] * foot_z
    low = uniform(rng, (0.18, 0.40)) * height
    section = rectangle(0.8 * bar, bar)
    for side in (-x, x):
        if kind == "t":
            wide = rectangle(bar, 2.6 * bar)
            parts.append(post((side, 0.02, 0), (side, inside, 0), wide, wide, frame))
            for y, half in ((0.5 * bar, foot_z), (under - 0.3 * bar, 0.85 * foot_z)):
                parts.append(box((side, y, 0), (1.3 * bar, bar, 2 * half), frame))
            continue
        for k in (-1, 1):
            # Crossing legs pass each other side by side, as two boards would.
            shift = 0.35 * k * bar if kind == "x" else 0.0
            head = -k * head_z if kind == "x" else k * head_z
            at = side + shift
            parts.append(post((at, 0, k * foot_z), (at, inside, head), section, section, frame))
        if kind == "a":
            half = foot_z + (head_z - foot_z) * low / inside
            parts.append(beam((side, low, -half), (side, low, half), 0.5 * bar, bar, frame))
        support = (side, under - 0.3 * bar, 0)
        parts.append(box(support, (0.9 * bar, bar, 2 * max(head_z, 0.3 * foot_z)), frame))
    y = {"a": low, "x": 0.5 * inside, "t": low}[kind]
    parts.append(beam((-x, y, 0), (x, y, 0), 0.6 * bar, 1.1 * bar, frame))
    return parts


def metal_frame(rng: np.random.Generator) -> list[Part]:
    """Return a top on a frame of thin metal bars: loops, hairpins or the edges of a box."""
    dining = chance(rng, 0.45)
    height = uniform(rng, (0.70, 0.76) if dining else (0.34, 0.50))
    length = uniform(rng, (1.1, 1.9) if dining else (0.7, 1.3))
    width = length * uniform(rng, (0.45, 0.62) if dining else (0.5, 1.0))
    thickness = uniform(rng, (0.012, 0.035))
    frame = shade_of(rng, {"chrome": 0.45, "dark-metal": 0.55})
    top = shade_of(rng, {"glass": 0.45, "wood": 0.35, "stone": 0.20}, TABLE)
    under = height - thickness
    bar = uniform(rng, (0.018, 0.034))
    x, z = length / 2 - bar, width / 2 - bar
    kind = pick(rng, {"loop": 0.45, "hairpin": 0.20, "cube": 0.35})
    parts = [_top("square", (length, width), (under, height), top)]
    if kind == "hairpin":
        head_y, rod = height - 0.5 * thickness, polygon(6, 0.4 * bar)
        for i in (-1, 1):
            for k in (-1, 1):
                foot = (i * (x - 0.03), 0.0, k * (z - 0.03))
                for dx, dz in ((0.16, 0.03), (0.03, 0.16)):
                    head = (i * (x - dx), head_y, k * (z - dz))
                    parts.append(post(foot, head, rod, rod, frame))
        return parts
    if kind == "cube":
        section = rectangle(bar, bar)
        parts += legs(x, z, under + 0.3 * thickness, section, section, frame)
        low = bar / 2 + (0.0 if chance(rng, 0.5) else 0.15 * height)
        for y in (low, under - 0.3 * bar):
            parts += [beam((-x, y, k), (x, y, k), 0.9 * bar, bar, frame) for k in (-z, z)]
            parts += [beam((i, y, -z), (i, y, z), 0.9 * bar, bar, frame) for i in (-x, x)]
        if chance(rng, 0.4):
            size = (2 * x - 0.3 * bar, 0.5 * thickness + 0.008, 2 * z - 0.3 * bar)
            parts.append(box((0.0, low + 0.3 * bar, 0.0), size, top))
        return parts
    inset = uniform(rng, (0.0, 0.16)) * length
    head_y = under + 0.3 * thickness
    path = [(0, head_y, -z), (0, bar / 2, -z), (0, bar / 2, z), (0, head_y, z)]
    path = fillet(path, 2.0 * bar) if chance(rng, 0.5) else np.array(path, dtype=float)
    for i in (-1, 1):
        path[:, 0] = i * (x - inset)
        parts.append(sweep(path, rectangle(1.6 * bar, bar), frame, up=(0, 0, 1)))
    at = x - inset
    y = under - 0.3 * bar
    parts += [beam((-at, y, k), (at, y, k), bar, bar, frame) for k in (-0.8 * z, 0.8 * z)]
    parts += [beam((i, y, -z), (i, y, z), bar, bar, frame) for i in (-at, at)]
    return parts
