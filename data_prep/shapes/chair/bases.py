"""Bases of chairs: legs, rockers, tubular frames, columns."""

from __future__ import annotations

import math

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.chair.backs import post_path
from data_prep.shapes.chair.seats import Layout, bar_section
from data_prep.shapes.chair.spec import ChairSpec
from data_prep.shapes.solids import (
    Part,
    box,
    fillet,
    hoop,
    lathe,
    loft,
    post,
    rectangle,
    sweep,
    tube,
)


def base_parts(spec: ChairSpec, layout: Layout) -> list[Part]:
    """Return the base of any family but the armchair."""
    if spec.family == "sled":
        return _sled(spec, layout)
    if spec.family == "cantilever":
        return _cantilever(spec, layout)
    if spec.family == "rocker":
        return _rocker(spec, layout)
    if spec.base == "legs":
        return _legs(spec, layout)
    return _column(spec, layout)


def _leg_heads(spec: ChairSpec, layout: Layout) -> Floats:
    """Return the places where the legs meet the seat, [legs, 3], in order round the seat."""
    if spec.legs == 3:
        angle = np.radians([-90.0, 30.0, 150.0])
        reach = 0.62 * spec.seat_width_m / 2
        x, z = reach * np.cos(angle), reach * np.sin(angle)
    else:
        (front_x, front_z), (rear_x, rear_z) = layout.front, layout.post
        if spec.seat == "round":
            rear_x, rear_z = front_x, -front_z
        x = np.array([-front_x, front_x, rear_x, -rear_x])
        z = np.array([front_z, front_z, rear_z, rear_z])
    return np.stack([x, np.full_like(x, layout.middle), z], axis=1)


def _leg_feet(spec: ChairSpec, heads: Floats) -> Floats:
    """Return the legs' feet [legs, 3] on the floor, splayed away from the seat's middle."""
    outwards = heads[:, ::2] / np.linalg.norm(heads[:, ::2], axis=1, keepdims=True)
    feet = heads.copy()
    feet[:, ::2] += outwards * heads[:, 1:2] * math.tan(math.radians(spec.splay_deg))
    feet[:, 1] = 0.0
    return feet


def _posts(spec: ChairSpec, feet: Floats, heads: Floats) -> list[Part]:
    section = bar_section(spec, spec.leg_m)
    return [
        post(foot, head, spec.leg_taper * section, section, spec.frame_color)
        for foot, head in zip(feet, heads, strict=True)
    ]


def _legs(spec: ChairSpec, layout: Layout) -> list[Part]:
    heads = _leg_heads(spec, layout)
    feet = _leg_feet(spec, heads)
    return _posts(spec, feet, heads) + _stretchers(spec, feet, heads)


def _stretchers(spec: ChairSpec, feet: Floats, heads: Floats) -> list[Part]:
    """Return thin bars between neighbouring legs, a third of the way up."""
    if spec.stretchers == "none":
        return []
    radius = 0.26 * spec.leg_m

    def between(a: Floats, b: Floats) -> Part:
        return tube((a, b), radius, spec.frame_color, sides=6)

    # Two heights: bars that met in one place inside a leg would weaken a real chair.
    low, high = (feet + share * (heads - feet) for share in (0.28, 0.38))
    if spec.stretchers == "box":
        count = len(heads)
        ends = [(low, high)[i % 2] for i in range(count)] if count == 4 else [low] * count
        return [between(at[i], at[(i + 1) % count]) for i, at in enumerate(ends)]
    parts = [between(high[0], high[3]), between(high[1], high[2])]
    if spec.stretchers == "h":
        parts.append(between((high[0] + high[3]) / 2, (high[1] + high[2]) / 2))
    return parts


def _rocker(spec: ChairSpec, layout: Layout) -> list[Part]:
    heads = _leg_heads(spec, layout)
    feet = _leg_feet(spec, heads)
    # Splay would twist the runners: each stays in the plane through its two feet.
    width, height, radius = 0.9 * spec.leg_m, 0.8 * spec.leg_m, 4.0 * spec.reach_m
    front, rear = feet[1], feet[2]
    z = np.linspace(front[2] - 0.10, rear[2] + 0.5 * spec.reach_m, 13)
    x = front[0] + (z - front[2]) * (rear[0] - front[0]) / (rear[2] - front[2])
    y = radius - np.sqrt(radius**2 - z**2)
    runner = np.stack([x, y, z], axis=1)
    feet[:, 1] = radius - np.sqrt(radius**2 - feet[:, 2] ** 2)
    parts = _posts(spec, feet, heads) + _stretchers(spec, feet, heads)
    for side in (-1.0, 1.0):
        path = runner * (side, 1.0, 1.0)
        parts.append(sweep(path, rectangle(width, height), spec.frame_color))
    return parts


def _sled(spec: ChairSpec, layout: Layout) -> list[Part]:
    radius = spec.leg_m / 2
    front = 0.92 * layout.front[1]
    parts = []
    for side in (-1.0, 1.0):
        seat, top = post_path(spec, layout, side)
        x = side * layout.post[0]
        path = [
            (x, layout.middle, front),
            (x, radius, front - 0.04),
            (x, radius, seat[2] + 0.03),
            seat,
            top,
        ]
        parts.append(tube(fillet(path, 0.07), radius, spec.frame_color))
    x = layout.post[0]
    for z in (front, 0.75 * layout.post[1]):
        y = layout.bottom + 0.4 * radius
        bar = [(-x, y, z), (x, y, z)]
        parts.append(tube(bar, 0.8 * radius, spec.frame_color))
    return parts


def _cantilever(spec: ChairSpec, layout: Layout) -> list[Part]:
    radius = spec.leg_m / 2
    half = layout.post[0]
    _, top = post_path(spec, layout, 1.0)
    cos = math.cos(layout.tilt_rad)
    knee = layout.from_back((half, (layout.middle - layout.top) / cos, 0.0))
    front = -spec.seat_depth_m / 2 - 0.01
    right = np.array(
        [
            top,
            knee,
            (half, layout.middle, front),
            (half, radius, front + 0.02),
            (half, radius, 0.45 * spec.seat_depth_m),
        ]
    )
    left = right[::-1] * (-1.0, 1.0, 1.0)
    path = fillet(np.concatenate([right, left]), 0.08)
    return [tube(path, radius, spec.frame_color)]


def _column(spec: ChairSpec, layout: Layout) -> list[Part]:
    """Return a column on a star or a disc, with the plate that carries the seat."""
    radius, high, color = spec.leg_m / 2, layout.bottom, spec.frame_color
    plate = box((0, high - 0.01, 0), (0.20, 0.024, 0.20), color)
    if spec.base == "disc":
        reach = 0.75 * spec.reach_m
        profile = [(reach, 0.0), (reach, 0.012), (0.5 * reach, 0.026), (1.3 * radius, 0.045)]
        profile += [(radius, 0.09), (radius, high - 0.012)]
        parts = [lathe(profile, color, sides=20), plate]
        if spec.family == "bar-stool":
            height, ring = 0.32 * high, 0.55 * reach + 0.04
            parts.append(hoop((0, height, 0), ring, 0.009, color))
            parts.append(tube([(-ring, height, 0), (ring, height, 0)], 0.009, color, sides=6))
        return parts
    casters = spec.base == "star-5"
    hub, tip = (0.092, 0.061) if casters else (0.075, 0.014)
    # Two thicknesses: the cover of the gas spring is as wide as the hub.
    split = 0.55 * high
    profile = [(1.5 * radius, hub - 0.03), (1.5 * radius, hub + 0.03), (radius, hub + 0.04)]
    profile += [(radius, split), (0.7 * radius, split + 0.01), (0.7 * radius, high - 0.012)]
    parts = [lathe(profile, color, sides=12), plate]
    count = 5 if casters else 4
    for i in range(count):
        angle = 2 * math.pi * i / count + (math.pi / 2 if casters else math.pi / 4)
        outwards = np.array([math.cos(angle), 0.0, math.sin(angle)])
        aside = np.array([-outwards[2], 0.0, outwards[0]])
        rings = []
        for reach, y, width, height in ((0.01, hub, 0.05, 0.034), (spec.reach_m, tip, 0.032, 0.02)):
            section = rectangle(width, height)
            centre = reach * outwards + (0.0, y, 0.0)
            rings.append(centre + section[:, :1] * aside + section[:, 1:] * (0.0, 1.0, 0.0))
        parts.append(loft(rings, color))
        if casters:
            wheel = (spec.reach_m - 0.012) * outwards + (0.0, 0.028, 0.0)
            parts.append(tube((wheel - 0.018 * aside, wheel + 0.018 * aside), 0.028, color))
    return parts
