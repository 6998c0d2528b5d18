"""Procedural displays: monitors, televisions, tubes and signs. Metres; the screen looks to -Z."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from data_prep.shapes.display.parts import (
    Head,
    Look,
    column,
    curved_head,
    draw_look,
    flat_head,
    foot,
)
from data_prep.shapes.fronts import panel
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Part,
    box,
    fillet,
    moved,
    post,
    rectangle,
    rounded,
    slab,
    sweep,
    tube,
    turned,
)

_OFFICE = {"black": 0.60, "silver": 0.18, "grey": 0.10, "white": 0.07, "beige": 0.05}
_LIVING = {"black": 0.72, "silver": 0.18, "grey": 0.10}
_SCREEN_ON = {"off": 0.48, "glare": 0.24, "lit": 0.28}


def _monitor_head(rng: np.random.Generator) -> Head:
    aspect = pick(rng, {1.78: 0.45, 1.6: 0.20, 1.25: 0.20, 2.35: 0.15})
    height = uniform(rng, (0.27, 0.37))
    width = aspect * height
    chin = uniform(rng, (0.008, 0.040)) if chance(rng, 0.45) else 0.0
    return Head(
        width=width,
        height=height + chin,
        thickness=uniform(rng, (0.014, 0.045)),
        border=uniform(rng, (0.010, 0.030)),
        chin=chin,
        corner=uniform(rng, (0.003, 0.007) if chance(rng, 0.45) else (0.010, 0.030)),
        bulge=uniform(rng, (0.020, 0.060)),
        bulge_share=uniform(rng, (0.35, 0.75)),
    )


def _stood(head_parts: list[Part], y: float, tilt_rad: float, under: list[Part]) -> list[Part]:
    """Return a head leaned back and raised to y, with what it stands on."""
    return [moved(part, (0, y, 0), tilt_rad=tilt_rad) for part in head_parts] + under


def monitor(rng: np.random.Generator) -> list[Part]:
    """Return a flat or curved head on a column and a foot."""
    head = _monitor_head(rng)
    look = draw_look(rng, _OFFICE, _SCREEN_ON)
    portrait = chance(rng, 0.06)
    tilt = math.radians(uniform(rng, (0.0, 12.0)))
    curved = head.width > 2 * head.height and chance(rng, 0.7)
    if curved:
        parts = curved_head(head, look, uniform(rng, (0.25, 0.50)))
    else:
        if portrait:
            head = replace(head, width=head.height, height=head.width, chin=0.0)
        parts = flat_head(head, look)
    clearance = uniform(rng, (0.06, 0.16))
    wide = uniform(rng, (0.20, 0.30))
    under, top = foot(rng, wide, uniform(rng, (0.16, 0.22)), look.stand)
    y = top + clearance + head.height / 2
    # Behind the head's middle, where the bulge is; nearer to the front it would pierce the screen.
    behind = head.thickness / 2 + 0.5 * head.bulge
    neck = (uniform(rng, (0.035, 0.10)), 0.9 * head.bulge)
    rise = y + 0.12 * head.height
    lean = behind + 0.12 * head.height * math.sin(tilt)
    is_round = chance(rng, 0.35)
    under = [moved(part, (0, 0, behind)) for part in under]
    section = (neck[1], neck[1]) if is_round else neck
    under.append(column((0.4 * top, rise), lean, section, look.stand, is_round=is_round))
    return _stood(parts, y, tilt, under)


def television(rng: np.random.Generator) -> list[Part]:
    """Return a wide head on a pedestal, on two feet or on a wall."""
    width = uniform(rng, (0.75, 1.50))
    height = width * uniform(rng, (0.56, 0.62))
    look = draw_look(rng, _LIVING, _SCREEN_ON)
    chin = uniform(rng, (0.03, 0.09)) * width if chance(rng, 0.35) else 0.0
    head = Head(
        width=width,
        height=height + chin,
        thickness=uniform(rng, (0.025, 0.070)),
        border=uniform(rng, (0.010, 0.035)) * width,
        chin=chin,
        corner=uniform(rng, (0.004, 0.008) if chance(rng, 0.5) else (0.015, 0.030)) * width,
        bulge=uniform(rng, (0.02, 0.07)),
        bulge_share=uniform(rng, (0.50, 0.80)),
    )
    parts = flat_head(head, look)
    kind = pick(rng, {"pedestal": 0.48, "feet": 0.37, "wall": 0.15})
    if kind == "wall":
        plate = (0.30 * width, 0.40 * height, 0.03)
        rear = head.thickness / 2 + head.bulge
        return [*parts, panel((0, 0, rear + 0.005), plate, look.stand)]
    clearance = uniform(rng, (0.04, 0.09))
    y = clearance + head.height / 2 + 0.02
    if kind == "feet":
        return _stood(parts, y, 0.0, _blades(rng, head, y, look))
    if chance(rng, 0.22):  # loudspeakers at both sides
        size = (0.10 * width, 0.96 * head.height, 0.8 * head.thickness + 0.01)
        for side in (-1, 1):
            x = side * (width / 2 + 0.045 * width)
            parts.append(panel((x, 0, 0.006), size, look.stand, bevel=0.006))
    base = (uniform(rng, (0.32, 0.58)) * width, 0.024, uniform(rng, (0.20, 0.30)))
    outline = rounded(rectangle(1, 1), uniform(rng, (0.03, 0.35)), steps=3)
    behind = head.thickness / 2
    under = [slab(outline, (0, 0.012, behind), base, look.stand, bevel=0.006)]
    neck = (uniform(rng, (0.10, 0.34)) * width, 0.8 * head.thickness)
    under.append(column((0.006, y - 0.2 * head.height), behind, neck, look.stand))
    return _stood(parts, y, 0.0, under)


def _blades(rng: np.random.Generator, head: Head, y: float, look: Look) -> list[Part]:
    """Return two feet like an inverted V, seen from the side, below the case."""
    x, reach = uniform(rng, (0.28, 0.44)) * head.width, uniform(rng, (0.09, 0.15))
    bar, under = 0.014 * head.width + 0.006, y - head.height / 2 + 0.02
    spread = uniform(rng, (0.0, 0.05))
    section = rectangle(bar, bar)
    return [
        post((i * (x + spread), 0, k * reach), (i * x, under, 0), section, section, look.stand)
        for i in (-1, 1)
        for k in (-1, 1)
    ]


def all_in_one(rng: np.random.Generator) -> list[Part]:
    """Return a computer behind its screen: a thin case with a chin, on a bent sheet of metal."""
    width = uniform(rng, (0.46, 0.66))
    height = width * uniform(rng, (0.60, 0.66))
    look = draw_look(rng, {"silver": 0.62, "white": 0.26, "black": 0.12}, _SCREEN_ON)
    look = replace(look, stand=look.case)
    head = Head(
        width=width,
        height=height,
        thickness=uniform(rng, (0.014, 0.030)),
        border=uniform(rng, (0.030, 0.045)) * width,
        chin=uniform(rng, (0.10, 0.20)) * height,
        corner=uniform(rng, (0.015, 0.035)) * width,
        bulge=uniform(rng, (0.018, 0.040)),
        bulge_share=uniform(rng, (0.45, 0.80)),
    )
    tilt = math.radians(uniform(rng, (2.0, 9.0)))
    y = uniform(rng, (0.08, 0.14)) + height / 2
    wide, thick = uniform(rng, (0.28, 0.42)) * width, 0.010
    rear = head.thickness / 2 + 0.6 * head.bulge
    if chance(rng, 0.6):  # the sheet: forwards on the desk, up behind the case
        path = [(0, 0.006, -0.10), (0, 0.006, 0.11), (0, 0.85 * y, rear)]
        bent = fillet(path, 0.03, 3)
        under = [sweep(bent, rectangle(wide, thick), look.stand)]
    else:  # a bail: a bent rod with its ends in the case
        half = 0.75 * wide
        path = [(-half, y, 0), (-half, 0.008, 0.16), (half, 0.008, 0.16), (half, y, 0)]
        under = [tube(fillet(path, 0.04, 3), 0.008, look.stand)]
        low = -height / 2 + 0.01
        foot_z = low * math.sin(tilt)
        section = rectangle(0.03, 0.012)
        for x in (-0.36 * width, 0.36 * width):
            ends = (x, 0, foot_z - 0.05), (x, y + low, foot_z)
            under.append(post(*ends, section, section, look.stand))
    return _stood(flat_head(head, look), y, tilt, under)


def monitor_pair(rng: np.random.Generator) -> list[Part]:
    """Return two equal monitors on one column, turned towards each other."""
    head = replace(_monitor_head(rng), bulge_share=0.45)
    if head.width > 1.8 * head.height:
        head = replace(head, width=1.7 * head.height)
    look = draw_look(rng, _OFFICE, _SCREEN_ON)
    yaw = math.radians(uniform(rng, (4.0, 22.0)))
    top = uniform(rng, (0.018, 0.030))
    y = uniform(rng, (0.10, 0.18)) + head.height / 2
    reach = 0.5 * head.width * math.cos(yaw) + 0.012
    rear = head.thickness / 2 + 0.6 * head.bulge
    nearer = 0.5 * head.width * math.sin(yaw)
    parts = []
    for side in (-1, 1):
        head_parts = [turned(part, side * yaw) for part in flat_head(head, look)]
        parts += [moved(part, (side * reach, y, -nearer)) for part in head_parts]
    arm_z = rear + 0.05
    size = (uniform(rng, (0.28, 0.45)), top, uniform(rng, (0.20, 0.28)))
    outline = rounded(rectangle(1, 1), 0.1, steps=2)
    parts.append(slab(outline, (0, top / 2, 0.02), size, look.stand, bevel=0.2 * top))
    neck = (0.3 * top, y + 0.05)
    parts.append(column(neck, arm_z, (0.045, 0.045), look.stand, is_round=True))
    for side in (-1, 1):
        behind = rear * np.array([side * math.sin(yaw), 0, math.cos(yaw)])
        end = np.array([side * reach, y, -nearer]) + behind
        parts.append(tube(np.stack([(0.0, y, arm_z), end]), 0.016, look.stand, sides=6))
    return parts


def sign(rng: np.random.Generator) -> list[Part]:
    """Return a display as tall as a person: an upright slab, or a wide head on a trolley."""
    cases = {"black": 0.55, "silver": 0.25, "white": 0.20}
    look = draw_look(rng, cases, {"off": 0.3, "glare": 0.2, "lit": 0.5})
    if chance(rng, 0.55):
        width, height = uniform(rng, (0.50, 0.85)), uniform(rng, (1.5, 2.0))
        head = Head(
            width=width,
            height=height,
            thickness=uniform(rng, (0.05, 0.14)),
            border=0.05 * width,
            chin=uniform(rng, (0.08, 0.35)) * height,
            corner=uniform(rng, (0.02, 0.07)) * width,
            bulge=0.0,
            bulge_share=0.0,
        )
        base = (uniform(rng, (1.05, 1.5)) * width, 0.04, uniform(rng, (0.35, 0.60)))
        plate = slab(rectangle(1, 1), (0, 0.02, 0), base, look.stand, bevel=0.008)
        return _stood(flat_head(head, look), 0.02 + height / 2, 0.0, [plate])
    width = uniform(rng, (1.0, 1.6))
    height = 0.59 * width
    head = Head(
        width=width,
        height=height,
        thickness=uniform(rng, (0.05, 0.09)),
        border=0.025 * width,
        chin=0.0,
        corner=0.01 * width,
        bulge=0.05,
        bulge_share=0.6,
    )
    y = uniform(rng, (1.25, 1.50))
    x, z = uniform(rng, (0.16, 0.30)) * width, head.thickness / 2 + 0.04
    section = rectangle(0.06, 0.05)
    under: list[Part] = []
    for side in (-x, x):
        ends = (side, 0.04, z), (side, y + 0.2 * height, z)
        under.append(post(*ends, section, section, look.stand))
        under.append(box((side, 0.04, 0.02), (0.07, 0.07, uniform(rng, (0.6, 0.8))), look.stand))
    under.append(box((0, 0.45 * y, z), (2 * x, 0.035, 0.36), look.stand))
    return _stood(flat_head(head, look), y, 0.0, under)
