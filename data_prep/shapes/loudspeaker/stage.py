"""Loudspeakers of a stage: with a horn, on a tripod, or lying as a monitor. Metres."""

from __future__ import annotations

import math

import numpy as np

from data_prep.shapes.fronts import panel
from data_prep.shapes.loudspeaker.drivers import draw_drivers, horn, woofer
from data_prep.shapes.loudspeaker.living_room import cabinet, cabinet_color, plan_of
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Color, Part, box, moved, prism, tube


def stage(rng: np.random.Generator) -> list[Part]:
    """Return a public-address box: a trapezium with a horn above a woofer.

    It stands on a tripod, or lies as a monitor wedge.
    """
    kind = pick(rng, {"top": 0.45, "tripod": 0.30, "wedge": 0.25})
    width = uniform(rng, (0.34, 0.50))
    size = (width, width * uniform(rng, (1.25, 1.8)), width * uniform(rng, (0.75, 1.0)))
    color = cabinet_color(rng, "stage")
    drivers = draw_drivers(rng, color, 1)
    step = 0.006 * math.hypot(*size)
    tilt = math.radians(uniform(rng, (35.0, 55.0))) if kind == "wedge" else 0.0
    upright = cabinet(plan_of("tapered"), size, 0.0, color)
    parts = [_wedge(size, tilt, color) if kind == "wedge" else upright]
    z, height = -size[2] / 2, size[1]
    if chance(rng, 0.3):  # a steel grille before everything
        plate = (0.92 * width, 0.93 * height, 5 * step)
        parts.append(
            panel((0, height / 2, z), plate, drivers.cloth, corner=0.05 * width, bevel=step)
        )
        parts.append(
            box((0, 0.06 * height, z - 3 * step), (0.14 * width, 0.02, 2 * step), drivers.cone)
        )
    else:
        parts += horn(drivers, (0, 0.78 * height, z), (0.72 * width, 0.26 * height), step)
        radius = min(0.42 * width, 0.30 * height)
        parts += woofer(drivers, (0, 0.05 * height + radius, z), radius, step)
    for x in (-0.43 * width, 0.43 * width):  # handles
        size_of_grip = (0.11 * width, 0.05 * height, 0.22 * size[2])
        parts.append(box((x, 0.55 * height, -0.15 * size[2]), size_of_grip, drivers.baffle))
    if kind == "wedge":
        return [moved(part, (0, 0, 0), tilt_rad=tilt) for part in parts]
    if kind == "tripod":
        low = uniform(rng, (0.80, 1.20))
        parts = [moved(part, (0, low, 0)) for part in parts]
        parts += _tripod(low, 0.55 * width + 0.2, drivers.baffle)
    return parts


def _wedge(size: tuple[float, float, float], tilt_rad: float, color: Color) -> Part:
    """Return a monitor's cabinet with its baffle upright: leaned by `tilt_rad` it lies level."""
    width, height, depth = size
    cos, sin = math.cos(tilt_rad), math.sin(tilt_rad)
    top = 0.35 * depth
    # As it lies, (y, z) from the baffle's lower edge on: floor, rear, top.
    lying = np.array(
        [
            (0, 0),
            (0, height * sin + 0.7 * top),
            (height * cos, height * sin + top),
            (height * cos, height * sin),
        ]
    )
    outline = np.stack([lying @ (-sin, cos) - depth / 2, lying @ (cos, sin)], axis=1)
    return prism(0, outline, (-width / 2, width / 2), color)


def _tripod(height: float, reach: float, color: Color) -> list[Part]:
    parts = [tube([(0, 0.12, 0), (0, height + 0.03, 0)], 0.020, color)]
    hub = 0.55 * height
    for angle in np.radians([90, 210, 330]):
        x, z = reach * np.cos(angle), reach * np.sin(angle)
        parts.append(tube([(0, hub, 0), (x, 0, z)], 0.014, color, sides=6))
        brace = 0.55
        end = (brace * x, hub * (1 - brace), brace * z)
        parts.append(tube([(0, 0.16, 0), end], 0.010, color, sides=5))
    return parts
