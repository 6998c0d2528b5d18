"""Backs and arms of chairs. Backs are built upright and then leaned by the chair's rake."""

from __future__ import annotations

import math

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.chair.seats import Layout, bar_section
from data_prep.shapes.chair.spec import ChairSpec
from data_prep.shapes.solids import (
    Part,
    box,
    curved_panel,
    moved,
    post,
    rectangle,
    rounded,
    slab,
    sweep,
    tube,
)

_RIB = 0.06  # m, height of top rails and rungs


def back_parts(spec: ChairSpec, layout: Layout) -> list[Part]:
    """Return the back with its posts, in the chair's frame; nothing where the chair has none."""
    if spec.back == "none":
        return []
    build = {
        "solid": _solid,
        "slatted": _slatted,
        "spindle": _spindle,
        "ladder": _ladder,
        "curved": _curved,
    }[spec.back]
    upright = build(spec, layout)
    if _has_posts(spec) and spec.family not in ("sled", "cantilever", "pedestal"):
        x = layout.post[0]
        section = bar_section(spec, spec.leg_m)
        head = section * (0.8 if spec.leg_taper < 0.8 else 1.0)
        for side in (-x, x):
            foot_head = (side, layout.middle - layout.top, 0.0), (side, spec.back_height_m, 0.0)
            upright.append(post(*foot_head, section, head, spec.frame_color))
    offset = (0.0, layout.top, layout.post[1])
    parts = [moved(part, offset, tilt_rad=layout.tilt_rad) for part in upright]
    if spec.family == "pedestal" and spec.posts:
        parts.append(_spine(spec, layout))
    return parts


def _has_posts(spec: ChairSpec) -> bool:
    """Return whether the back hangs between two posts.

    The frame of a sled or cantilever lends them.
    """
    return spec.posts or spec.family in ("sled", "cantilever")


def _half_width(spec: ChairSpec, layout: Layout) -> float:
    """Return half of the width that a back without posts has at its foot."""
    return layout.post[0] + spec.leg_m / 2 if spec.family != "pedestal" else layout.post[0]


def _foot(layout: Layout) -> float:
    return layout.middle - layout.top


def _solid(spec: ChairSpec, layout: Layout) -> list[Part]:
    high = spec.back_height_m
    if _has_posts(spec) and spec.family != "pedestal":
        half = layout.post[0]
        low, high = spec.gap_m, high - 0.012
        thickness, radius = min(spec.back_thickness_m, 0.7 * spec.leg_m), 0.004
    else:
        half = 0.97 * _half_width(spec, layout)
        low = spec.gap_m if spec.posts else _foot(layout)
        thickness, radius = spec.back_thickness_m, 0.06
    width, height = 2 * half, high - low
    outline = rounded(rectangle(width, height), radius) / (width, height)
    lying = slab(
        outline, (0, 0, 0), (width, thickness, height), spec.back_color, bevel=thickness / 5
    )
    return [moved(lying, (0.0, (low + high) / 2, 0.0), tilt_rad=math.pi / 2)]


def _slatted(spec: ChairSpec, layout: Layout) -> list[Part]:
    high, deep = spec.back_height_m, spec.bar_m
    posts = _has_posts(spec)
    half = layout.post[0] if posts else 0.97 * _half_width(spec, layout)
    foot = _foot(layout)
    parts = [box((0, high - _RIB / 2 - 0.01, 0), (2 * half, _RIB, 1.3 * deep), spec.back_color)]
    if posts and spec.gap_m > 0.08:
        foot = min(spec.gap_m, 0.3 * high)
        parts.append(box((0, foot, 0), (2 * half, 0.6 * _RIB, 1.3 * deep), spec.back_color))
    width = min(2.2 * deep, 1.1 * half / spec.bars)
    edge = half * (1 - 1 / (spec.bars + 1) * 1.6) if posts else half - width / 2 - 0.004
    for x in np.linspace(-edge, edge, spec.bars):
        height = high - _RIB / 2 - foot
        parts.append(box((x, foot + height / 2, 0), (width, height, 0.7 * deep), spec.back_color))
    return parts


def _spindle(spec: ChairSpec, layout: Layout) -> list[Part]:
    high, radius = spec.back_height_m, 0.42 * spec.bar_m
    if spec.posts:
        half = layout.post[0]
        crest = box((0, high - _RIB / 2 - 0.01, 0), (2 * half, _RIB, 0.02), spec.back_color)
        clear = half - spec.leg_m / 2
        feet = heads = np.linspace(-clear, clear, spec.bars + 2)[1:-1]
        sag = np.zeros(spec.bars)
    else:
        half = _half_width(spec, layout)
        crest = curved_panel(half + 0.03, 0.45, 0.024, high - _RIB, high, spec.back_color)
        feet = np.linspace(-0.82 * half, 0.82 * half, spec.bars)
        heads = np.linspace(-half, half, spec.bars)
        arc = (half + 0.03) / math.sin(0.45)
        sag = np.sqrt(arc**2 - heads**2) - arc
    parts = [crest]
    for foot, head, z in zip(feet, heads, sag, strict=True):
        path = (foot, _foot(layout), 0.0), (head, high - _RIB / 2, z)
        parts.append(tube(path, radius, spec.back_color, sides=6))
    return parts


def _ladder(spec: ChairSpec, layout: Layout) -> list[Part]:
    half, angle, high = layout.post[0], 0.25, spec.back_height_m
    thickness = 0.7 * spec.bar_m
    sag = half / math.sin(angle) * (1 - math.cos(angle))
    lowest = min(spec.gap_m, 0.35 * high) + _RIB / 2
    parts = []
    for y in np.linspace(lowest, high - _RIB / 2 - 0.012, spec.bars):
        rung = min(_RIB, 0.7 * (high - lowest) / spec.bars) / 2
        bent = curved_panel(half, angle, thickness, y - rung, y + rung, spec.back_color, steps=6)
        parts.append(moved(bent, (0, 0, sag)))
    return parts


def curve(spec: ChairSpec, layout: Layout) -> tuple[float, float]:
    """Return half width and half angle of a curved back that grows out of the seat."""
    angle = min(spec.bend_rad, 0.42 / spec.back_height_m)  # a tall one bends less: no half pipes
    if spec.seat == "round":  # it follows the seat's edge
        angle = max(angle, 0.75)
        return 0.94 * spec.seat_width_m / 2 * math.sin(angle), angle
    return 0.97 * _half_width(spec, layout), angle


def _curved(spec: ChairSpec, layout: Layout) -> list[Part]:
    high, thickness, color = spec.back_height_m, spec.back_thickness_m, spec.back_color
    if _has_posts(spec) and spec.family != "pedestal":
        half, angle = layout.post[0], min(spec.bend_rad, 0.55)
        sag = half / math.sin(angle) * (1 - math.cos(angle))
        panel = curved_panel(
            half, angle, min(thickness, 0.7 * spec.leg_m), spec.gap_m, high - 0.012, color
        )
        return [moved(panel, (0, 0, sag))]
    half, angle = curve(spec, layout)
    station = np.linspace(-angle, angle, 11)
    z = half / math.sin(angle) * (np.cos(station) - 1)
    # The ends stand forward of the leaning plane: they have to reach further down to the seat.
    low = (spec.gap_m if spec.posts else _foot(layout)) + z * math.tan(layout.tilt_rad)
    top = high * (1 - 0.35 * (angle - 0.35) * (station / angle) ** 2)
    return [curved_panel(half, angle, min(thickness, 0.03), low, top, color)]


def _spine(spec: ChairSpec, layout: Layout) -> Part:
    """Return the bar that carries a pedestal chair's back, from under the seat upwards."""
    thick = min(spec.back_thickness_m, 0.03) if spec.back == "curved" else spec.back_thickness_m
    behind = thick / 2 + 0.004
    top = spec.gap_m + 0.4 * (spec.back_height_m - spec.gap_m)
    head, knee = layout.from_back([(0, top, behind), (0, 0, behind + 0.03)])
    under = (0.0, layout.bottom, layout.post[1] - 0.14)
    corner = (0.0, layout.bottom - 0.005, knee[2] - 0.01)
    return sweep([under, corner, knee, head], rectangle(0.07, 0.016), spec.frame_color)


def arm_parts(spec: ChairSpec, layout: Layout) -> list[Part]:
    """Return both arms.

    They are joined to the back and propped on the seat; those of a pedestal chair stand on the seat
    alone.
    """
    if not spec.arms:
        return []
    if spec.family == "pedestal":
        return [part for side in (-1.0, 1.0) for part in _side_arm(spec, layout, side)]
    x, z = layout.post[0], 0.0
    if spec.back == "curved" and not _has_posts(spec):
        x, angle = curve(spec, layout)
        z = x / math.sin(angle) * (math.cos(angle) - 1)
    start = layout.from_back((x, spec.arm_height_m / math.cos(layout.tilt_rad), z))
    front_x, front_z = layout.front
    end = np.array([max(front_x, x), start[1] + 0.008, 0.8 * front_z])
    prop = bar_section(spec, 0.75 * spec.leg_m)
    parts = []
    for side in (-1.0, 1.0):
        mirror = np.array([side, 1.0, 1.0])
        beyond = end - np.array([0.0, 0.0, 0.03])
        pad = rectangle(spec.arm_width_m, 0.022)
        parts.append(sweep(np.stack([start, beyond]) * mirror, pad, spec.frame_color))
        foot = np.array([front_x, layout.middle, 0.8 * front_z])
        parts.append(post(foot * mirror, end * mirror, prop, prop, spec.frame_color))
    return parts


def _side_arm(spec: ChairSpec, layout: Layout, side: float) -> list[Part]:
    out: float = np.ptp(layout.outline[:, 0]) / 2 + 0.02
    height = layout.top + spec.arm_height_m
    low = layout.bottom - 0.006
    path = np.array([(0.55 * out, low, 0.02), (out, low, 0.02), (out, height, 0.02)])
    path[:, 0] *= side
    bracket = sweep(path, rectangle(0.045, 0.018), spec.frame_color)
    pad = rounded(rectangle(1.0, 1.0), 0.2)
    size = (spec.arm_width_m + 0.02, 0.028, 0.24)
    return [bracket, slab(pad, (side * out, height, 0.0), size, spec.frame_color, bevel=0.006)]


def post_path(spec: ChairSpec, layout: Layout, side: float) -> Floats:
    """Return the course [2, 3] of one post of a tubular frame, from the seat's height up."""
    x = side * layout.post[0]
    return layout.from_back([(x, 0.0, 0.0), (x, spec.back_height_m, 0.0)])
