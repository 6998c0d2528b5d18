"""Sofas with an upholstered body: box arms, rolled arms, and those that turn a corner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_prep.shapes.furniture import run, trough
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.sofa.spec import (
    SofaSpec,
    back_cushions,
    back_profile,
    draw_sofa_spec,
    feet,
    seat_cushions,
    throw_pillows,
)
from data_prep.shapes.solids import Part, box, polygon, prism, rounded


def box_arm(rng: np.random.Generator) -> list[Part]:
    """Return arms like boxes, lower than the back or as high."""
    spec = draw_sofa_spec(rng, "box-arm")
    if chance(rng, 0.16):  # arms as high as the back
        spec = replace(spec, arm_top=spec.back_top - 0.012)
    slope = 0.0 if chance(rng, 0.6) else uniform(rng, (0.02, 0.10))
    top = spec.back_top
    between = chance(rng, 0.4)
    reach = spec.inside / 2 + 0.02 if between else spec.half - 0.006
    return [
        _base(spec, spec.arm_top, uniform(rng, (0.10, 0.30)) * spec.arm, slope),
        run(back_profile(spec, top), (-reach, reach), spec.body, bevel=0.02),
        *_upholstery(rng, spec, 0.72),
        *feet(spec, spec.half - 0.07, spec.depth / 2 - 0.07),
    ]


def rolled_arm(rng: np.random.Generator) -> list[Part]:
    """Return arms that end in rolls; the back is a roll, a higher one, or a camel's hump."""
    spec = draw_sofa_spec(rng, "rolled-arm")
    kind = pick(rng, {"level": 0.34, "camel": 0.33, "roll": 0.33})
    roll = uniform(rng, (0.075, 0.115))
    spec = replace(spec, arm=max(0.7 * spec.arm, 1.1 * roll), arm_top=spec.arm_top + 0.02)
    axis_y, axis_x = spec.arm_top - roll, spec.half - 0.45 * spec.arm + 0.15 * roll
    section = polygon(12, roll)
    front, rear = -spec.depth / 2 - 0.02, spec.depth / 2
    parts = [_base(spec, axis_y + 0.3 * roll, 0.1 * spec.arm, 0.0)]
    parts += [
        run(section, (front, rear), spec.body, at=(side * axis_x, axis_y), axis=2)
        for side in (-1, 1)
    ]
    # Stations where the arms' rolls end inside the back.
    end = spec.half - 0.01
    stations = np.array([-end, *np.linspace(-axis_x, axis_x, 9), end])
    if kind == "camel":
        top = spec.back_top
        profile = back_profile(spec, top)
        share = (profile[:, 1] - profile[:, 1].min()) / np.ptp(profile[:, 1])
        bow = np.clip(1 - (stations / axis_x) ** 2, 0.0, None) ** 0.8
        drop = (top - spec.arm_top) * (1 - bow)
        outlines = np.repeat(profile[None], len(stations), axis=0)
        outlines[..., 1] -= drop[:, None] * share
        parts.append(prism(0, outlines, stations, spec.body))
    else:
        top = spec.arm_top if kind == "level" else spec.back_top
        parts.append(run(back_profile(spec, top - 0.4 * roll), tuple(stations), spec.body))
        middle = (rear - 0.1 * roll, top - roll)
        size = 1.0 if kind == "level" else 0.85
        reach = spec.half + (0.5 * roll if kind == "level" else -0.01)
        parts.append(run(size * section, (-reach, 0.0, reach), spec.body, at=middle))
    cushioned = 0.0 if kind != "roll" else 0.8
    parts += _upholstery(rng, spec, cushioned)
    return parts + feet(spec, spec.half - 0.07, spec.depth / 2 - 0.07)


def sectional(rng: np.random.Generator) -> list[Part]:
    """Return a sofa with a chaise, or a corner sofa with a second back.

    `side` is where it turns.
    """
    spec = draw_sofa_spec(rng, "sectional")
    side = int(rng.choice([-1, 1]))
    corner = chance(rng, 0.4)
    long = uniform(rng, (0.9, 1.5) if corner else (0.50, 0.85))
    wing = spec.depth if corner else spec.seat + uniform(rng, (0.05, 0.30))
    half, rear, arm = spec.half + 0.1, spec.depth / 2, spec.arm
    front, far = -spec.depth / 2, -spec.depth / 2 - long
    deck, low = spec.deck, spec.low
    middle = (deck + low) / 2
    turn = side * (half - wing / 2)
    parts = [
        box((0, middle, 0), (2 * half - 0.012, deck - low, spec.depth), spec.body),
        box(
            (turn, middle, (rear + far) / 2),
            (wing, deck - low - 0.006, rear - far - 0.01),
            spec.body,
        ),
        run(back_profile(spec, spec.back_top), (-half, half), spec.body, bevel=0.02),
    ]
    arm_corners = np.array(
        [(0, low + 0.01), (arm, low + 0.01), (arm, spec.arm_top), (0, spec.arm_top)]
    )
    section = rounded(arm_corners, 0.2 * arm, steps=2)

    def arm_at(x: float, z: float) -> Part:
        return run(section, (z, rear - 0.02), spec.body, at=(x, 0.0), axis=2, bevel=0.01)

    other = arm_at(-half + 0.004 if side > 0 else half - arm - 0.004, front - 0.006)
    parts.append(other)
    inner = side * (half - (spec.wall if corner else 0.0))  # where the turned seat ends
    if corner:
        profile = back_profile(spec, spec.back_top - 0.004)
        along_z = profile * (side, 1.0)
        at = (side * (half - rear), 0.0)
        ends = (far - 0.01, rear - 0.02)
        parts.append(run(along_z, ends, spec.body, at=at, axis=2, bevel=0.02))
    elif chance(rng, 0.7):
        parts.append(arm_at(half - arm - 0.004 if side > 0 else -half + 0.004, front + 0.2))
        inner = side * (half - arm)
    edge = side * (half - wing)  # of the turned part, towards the middle
    back = spec.back_front(spec.sitting) + 0.04
    straight = sorted((-side * (half - arm), edge))
    across = sorted((edge, inner))
    count = max(1, round((straight[1] - straight[0]) / spec.seat))
    parts += seat_cushions(spec, (straight[0], straight[1]), (front - 0.014, back), count)
    parts += seat_cushions(spec, (across[0], across[1]), (far - 0.014, back), 1)
    tall = spec.back_top - spec.sitting + uniform(rng, (-0.02, 0.06))
    leaning = uniform(rng, (0.12, 0.17))
    parts += back_cushions(spec, (straight[0], straight[1]), count, tall, leaning)
    if not corner:
        parts += back_cushions(spec, (across[0], across[1]), 1, tall, leaning)
    parts += throw_pillows(rng, spec, 0.8 * half, spec.back_front(spec.sitting) - leaning)
    parts += feet(spec, half - 0.08, rear - 0.08)
    z = (far + front) / 2
    return parts + feet(spec, wing / 2 - 0.08, long / 2 - 0.08, centre=(turn, z))


def _base(spec: SofaSpec, arm_top: float, edge: float, slope: float) -> Part:
    heights = (spec.low, spec.deck, arm_top)
    return trough(spec.half, spec.arm, heights, edge, spec.depth, spec.body, slope=slope)


def _upholstery(rng: np.random.Generator, spec: SofaSpec, cushioned: float) -> list[Part]:
    """Return cushions of the seat, and of the back as often as `cushioned` says."""
    inside = spec.inside / 2 - 0.006
    merged = 1 if chance(rng, 0.14) else spec.seats
    front, rear = -spec.depth / 2 - 0.014, spec.back_front(spec.sitting) + 0.04
    parts = seat_cushions(spec, (-inside, inside), (front, rear), merged)
    leaning = 0.0
    if chance(rng, cushioned):
        leaning = uniform(rng, (0.12, 0.18))
        height = spec.back_top - spec.sitting + uniform(rng, (-0.03, 0.09))
        parts += back_cushions(spec, (-inside, inside), spec.seats, height, leaning)
    return parts + throw_pillows(rng, spec, inside, spec.back_front(spec.sitting) - 0.75 * leaning)
