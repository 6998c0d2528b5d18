"""Sofas on an open frame, without arms, or bent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from data_prep.shapes.furniture import beam, cushion, legs, run
from data_prep.shapes.palettes import shade_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.sofa.spec import (
    SofaSpec,
    back_cushions,
    back_profile,
    draw_sofa_spec,
    seat_cushions,
    throw_pillows,
)
from data_prep.shapes.solids import (
    Part,
    box,
    curved_panel,
    moved,
    polygon,
    post,
    prism,
    rectangle,
    rounded,
    slab,
    tube,
)


def open_frame(rng: np.random.Generator) -> list[Part]:
    """Return cushions on a frame of wood, or within a cage of tubes."""
    spec = draw_sofa_spec(rng, "open-frame")
    metal = chance(rng, 0.4)
    frame = shade_of(rng, {"chrome": 0.7, "dark-metal": 0.3} if metal else {"wood": 1.0})
    spec = replace(spec, feet=frame, cushions=spec.body)
    front, rear = -spec.depth / 2, spec.depth / 2
    if metal:
        return _caged(rng, spec)
    bar = uniform(rng, (0.035, 0.060))
    half = spec.inside / 2 + bar / 2 + 0.004
    deck = spec.deck
    parts = [box((0, deck - 0.025, 0), (2 * half, 0.05, spec.depth - 2 * bar), frame)]
    arm_y = spec.arm_top
    square = rectangle(bar, bar)
    lean = (spec.back_top - deck) * math.tan(spec.rake_rad)
    for side in (-1, 1):
        x = side * half
        parts.append(
            post((x, 0, front + bar), (x, arm_y, front + bar), 0.7 * square, square, frame)
        )
        foot, knee = (x, 0.0, rear - 0.5 * bar), (x, deck - 0.03, rear - bar)
        parts.append(post(foot, knee, 0.8 * square, square, frame))
        head = (x, spec.back_top, rear - bar + lean)
        parts.append(post((x, deck - 0.06, rear - bar), head, square, 0.8 * square, frame))
        arm = run(
            rounded(rectangle(1.7 * bar, 0.6 * bar), 0.15 * bar, steps=1),
            (front - 0.01, rear - bar + 0.5 * lean),
            frame,
            at=(x, arm_y),
            axis=2,
        )
        parts.append(arm)
    for share in (0.45, 0.95):
        y, z = deck + share * (spec.back_top - deck), rear - bar + share * lean
        parts.append(beam((-half, y, z), (half, y, z), 0.6 * bar, 1.4 * bar, frame))
    spec = replace(spec, wall=bar * 1.2)
    inside = spec.inside / 2
    parts += seat_cushions(spec, (-inside, inside), (front, rear - 1.3 * bar), spec.seats)
    height = spec.back_top - spec.sitting + uniform(rng, (-0.02, 0.08))
    thickness = uniform(rng, (0.10, 0.15))
    parts += back_cushions(spec, (-inside, inside), spec.seats, height, thickness)
    z = spec.back_front(spec.sitting) - thickness
    return parts + throw_pillows(rng, spec, inside, z)


def _caged(rng: np.random.Generator, spec: SofaSpec) -> list[Part]:
    """Return thick cushions, also as arms, held by tubes.

    The model is Le Corbusier, Jeanneret, Perriand: LC2.
    """
    radius = uniform(rng, (0.013, 0.020))
    arm = max(spec.arm, 0.12)
    half = spec.inside / 2 + arm
    low, top = uniform(rng, (0.09, 0.15)), spec.arm_top + 0.06
    front, rear = -spec.depth / 2, spec.depth / 2
    deck = low + 0.02
    parts = [box((0, deck, 0), (2 * half, 0.03, spec.depth - 0.02), spec.feet)]
    for side in (-1, 1):
        x = side * (half - arm / 2)
        size = (arm - 0.012, top - deck - 0.02, spec.depth - 0.04)
        centre = (x, deck + 0.006 + size[1] / 2, -0.01)
        parts.append(cushion(centre, size, spec.body, soft=0.03, corner=0.04))
        out = side * (half - 0.2 * radius)
        for z in (front, rear):
            parts.append(tube(((out, 0, z), (out, top - 0.02, z)), radius, spec.feet))
        parts += [
            tube(((out, y, front), (out, y, rear)), radius, spec.feet) for y in (deck, top - 0.04)
        ]
    for y, z in ((deck, front), (deck, rear), (top - 0.04, rear)):
        parts.append(tube(((-half, y, z), (half, y, z)), radius, spec.feet))
    spec = replace(spec, deck=deck + 0.16, thick=spec.thick)
    inside = spec.inside / 2
    size = (spec.inside, 0.18, spec.depth - 0.06)
    parts.append(cushion((0, deck + 0.09, 0), size, spec.body, soft=0.02, corner=0.03))
    parts += seat_cushions(spec, (-inside, inside), (front + 0.01, rear - 0.06), spec.seats)
    back = replace(spec, wall=0.08, rake_rad=0.04)
    height = top - spec.sitting + uniform(rng, (0.03, 0.12))
    return parts + back_cushions(back, (-inside, inside), spec.seats, height, 0.15)


def armless(rng: np.random.Generator) -> list[Part]:
    """Return a futon, a daybed with one raised end, or a chaise longue with half a back."""
    spec = draw_sofa_spec(rng, "armless")
    spec = replace(spec, seats=max(spec.seats, 2), low=max(spec.low, 0.10))
    kind = pick(rng, {"futon": 0.42, "longue": 0.33, "daybed": 0.25})
    half, depth = spec.inside / 2, spec.depth * (0.8 if kind == "longue" else 1.0)
    low, top = spec.low, spec.deck + 0.10
    soft = 0.3 * (top - low)
    seat = cushion(
        (0, (low + top) / 2, 0),
        (2 * half, top - low, depth),
        spec.body,
        soft=0.25 * soft,
        corner=0.06,
    )
    section = polygon(8, 0.025)
    parts = [seat]
    out = uniform(rng, (0.0, 0.05))
    parts += legs(
        half - 0.12, depth / 2 - 0.1, low + 0.03, 0.6 * section, section, spec.feet, out=out
    )
    if kind == "futon":
        profile = back_profile(replace(spec, low=low + 0.02, wall=0.13, deck=top), spec.back_top)
        parts.append(run(profile, (-half + 0.01, 0.0, half - 0.01), spec.body, bevel=0.02))
        lying = replace(spec, deck=top, thick=0.08)
        rear = depth / 2 - 0.12
        if chance(rng, 0.6):
            parts += seat_cushions(lying, (-half, half), (-depth / 2, rear), spec.seats)
        return parts
    side = int(rng.choice([-1, 1]))
    rise = uniform(rng, (0.26, 0.40))
    # The raised end leans outwards; its section (x, y) runs along z.
    near, far = half - 0.16, half + 0.02 + 0.4 * rise
    end = np.array(
        [(near, top - 0.08), (half - 0.02, top - 0.08), (far, top + rise), (far - 0.12, top + rise)]
    )
    end = rounded(end, 0.03, steps=2) * (side, 1)
    parts.append(run(end, (-depth / 2 + 0.004, depth / 2 - 0.004), spec.body, axis=2, bevel=0.02))
    if kind == "longue":  # a back that falls from the raised end towards the other
        stations = np.linspace(-0.1, 1.0, 8) * (half - 0.05) * side
        share = np.linspace(0.0, 1.0, 8) ** 1.5
        z, low = depth / 2, np.full(8, top - 0.05)
        high = top + 0.03 + 0.9 * rise * share
        corners = ((z - 0.10, low), (z - 0.05, high), (z + 0.03, high), (z - 0.01, low))
        outlines = np.stack([np.stack([np.full(8, at), y], axis=1) for at, y in corners], axis=1)
        parts.append(prism(0, outlines, stations, spec.body))
    at, ends = (side * (near - 0.02), top + 0.07), (-0.36 * depth, 0.36 * depth)
    parts.append(run(polygon(10, 0.085), ends, spec.pillows, at=at, axis=2, bevel=0.02))
    return parts


def curved(rng: np.random.Generator) -> list[Part]:
    """Return a tub with a rounded back, or an arc of seats around a table that is not there."""
    spec = draw_sofa_spec(rng, "curved")
    low = max(spec.low, 0.04)
    wall = uniform(rng, (0.10, 0.16))
    if chance(rng, 0.45):
        angle = uniform(rng, (0.6, 1.35))
        half_width = 0.5 * max(spec.seats, 2) * spec.seat + 0.1
        seat_depth = 0.62
        seat = curved_panel(
            half_width, angle, seat_depth, low, spec.sitting, spec.cushions, steps=14
        )
        radius = half_width / math.sin(min(angle, math.pi / 2))
        outside = radius + seat_depth / 2
        back_width = outside * math.sin(min(angle, math.pi / 2))
        top = spec.back_top - 0.05
        shell = curved_panel(back_width, angle + 0.02, wall, low + 0.01, top, spec.body, steps=14)
        parts = [seat, moved(shell, (0.0, 0.0, outside - radius))]
        angles = np.array([-0.85, 0.0, 0.85]) * angle
        section = polygon(8, 0.03)
        for r in (radius - 0.2, radius + 0.2):
            for a in angles:
                x, z = r * math.sin(a), r * math.cos(a) - radius
                parts.append(post((x, 0, z), (x, low + 0.03, z), 0.7 * section, section, spec.feet))
        return parts
    wide = uniform(rng, (1.0, 1.2)) if spec.seats == 1 else uniform(rng, (1.6, 2.5))
    radius = uniform(rng, (0.38, 0.44))
    angle = uniform(rng, (1.75, 2.2))
    station = np.linspace(-1.0, 1.0, 17)
    rise = np.clip(1.45 - 1.5 * np.abs(station), 0.0, 1.0)
    rise = rise**2 * (3 - 2 * rise)
    arm, back = spec.arm_top, max(spec.back_top - 0.06, spec.arm_top)
    shell = moved(
        curved_panel(radius, angle, wall, low, arm + (back - arm) * rise, spec.body, steps=16),
        (0.0, 0.0, radius),
    )
    inner = radius - wall / 2 + 0.02
    outline = polygon(24, 0.5)
    outline[:, 1] = np.maximum(outline[:, 1], 0.5 * math.cos(angle) - 0.10)  # straight in front
    thick = spec.sitting - low - 0.02
    seat = slab(
        outline,
        (0.0, spec.sitting - thick / 2, 0.0),
        (2 * inner, thick, 2 * inner),
        spec.cushions,
        bevel=0.02,
    )
    stretch = np.array([wide, 1.0, 1.0])
    parts = [Part(part.vertices * stretch, part.faces, part.color) for part in (shell, seat)]
    section = polygon(8, 0.028)
    x, z = 0.62 * radius * wide, 0.24 * radius
    return parts + legs(x, z, low + 0.06, 0.7 * section, section, spec.feet)
