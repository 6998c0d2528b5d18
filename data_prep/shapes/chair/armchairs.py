"""Upholstered armchairs: a box with arms, or a tub."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.chair.seats import bar_section
from data_prep.shapes.chair.spec import ChairSpec
from data_prep.shapes.furniture import legs, trough
from data_prep.shapes.solids import Part, curved_panel, moved, polygon, rectangle, rounded, slab


def armchair_parts(spec: ChairSpec) -> list[Part]:
    """Return all parts of an armchair; a curved back makes it a tub."""
    return _tub(spec) if spec.back == "curved" else _boxy(spec)


def _feet(spec: ChairSpec, x: float, z: float, height: float) -> list[Part]:
    section = bar_section(spec, spec.leg_m)
    out = height * math.tan(math.radians(spec.splay_deg))
    return legs(x, z, height, spec.leg_taper * section, section, spec.frame_color, out=out)


def _boxy(spec: ChairSpec) -> list[Part]:
    half, depth = spec.seat_width_m / 2, spec.seat_depth_m
    arm = 2.6 * spec.arm_width_m
    low = spec.reach_m - 0.20
    deck = spec.seat_height_m - (spec.cushion_m if spec.cushion else 0.0)
    top = spec.seat_height_m + 0.85 * spec.arm_height_m
    parts = [trough(half, arm, (low, deck, top), 0.22 * arm, depth, spec.back_color)]

    thickness = 0.06 + 2.6 * spec.back_thickness_m
    inside = 2 * (half - arm)
    if spec.posts:  # behind the arms, as wide as both
        rear, tilt, width, sunk = depth / 2 + 0.2 * thickness, 0.5, 2 * half - 0.012, deck - low
    else:  # between the arms
        rear, tilt, width, sunk = depth / 2 - 0.55 * thickness, 1.0, inside + 0.016, 0.02
    height = spec.back_height_m + spec.seat_height_m - deck + sunk
    outline = rounded(rectangle(1.0, 1.0), 0.12)
    lying = slab(outline, (0, 0, 0), (width, thickness, height), spec.back_color, bevel=0.02)
    standing = moved(lying, (0.0, height / 2 - sunk, 0.0), tilt_rad=math.pi / 2)
    tilt_rad = math.radians(tilt * spec.rake_deg)
    parts.append(moved(standing, (0.0, deck, rear), tilt_rad=tilt_rad))
    if spec.cushion:
        front, behind = -depth / 2 - 0.012, rear - 0.3 * thickness
        size = (inside - 0.008, spec.cushion_m + 0.03, behind - front)
        centre = (0.0, deck - 0.006 + size[1] / 2, (front + behind) / 2)
        cushion = slab(
            rounded(rectangle(1.0, 1.0), 0.08), centre, size, spec.seat_color, bevel=0.018
        )
        parts.append(cushion)
    inset = 0.5 * spec.leg_m + 0.03
    return parts + _feet(spec, half - inset, depth / 2 - inset, low + 0.012)


def _tub(spec: ChairSpec) -> list[Part]:
    wall = 1.6 * spec.arm_width_m
    radius = 0.46 * spec.seat_width_m
    seat_thickness = 0.10 + 0.4 * spec.cushion_m
    low = spec.seat_height_m - seat_thickness - 0.02 - 1.8 * (spec.reach_m - 0.26)
    angle = 1.80 + 0.35 * spec.bend_rad
    station = np.linspace(-1.0, 1.0, 17)
    arm_top, back_top = 0.8 * spec.arm_height_m, 0.8 * spec.back_height_m
    rise = np.clip(1.45 - 1.5 * np.abs(station), 0.0, 1.0)
    rise = rise**2 * (3 - 2 * rise)
    top = spec.seat_height_m + arm_top + (max(back_top, arm_top) - arm_top) * rise
    shell = curved_panel(radius, angle, wall, low, top, spec.back_color, steps=16)
    inner = radius - wall / 2 + 0.012
    outline = polygon(24, 0.5)
    outline[:, 1] = np.maximum(outline[:, 1], 0.5 * math.cos(angle) - 0.06)  # straight in front
    seat = slab(
        outline,
        (0.0, spec.seat_height_m - seat_thickness / 2, 0.0),
        (2 * inner, seat_thickness, 2 * inner),
        spec.seat_color,
        bevel=0.02,
    )
    legs = _feet(spec, 0.62 * radius, 0.36 * radius, spec.seat_height_m - 0.7 * seat_thickness)
    return [moved(shell, (0.0, 0.0, radius)), seat, *legs]
