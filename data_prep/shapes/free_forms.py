"""Closed forms of no class: smooth and creased hulls, facets, plates, turned shapes and tubes.

One to six of them are combined to an object. A form stands around the origin, some two units wide.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.spatial import ConvexHull

from data_prep.arrays import Floats
from data_prep.shapes.carving import carved
from data_prep.shapes.hulls import pair
from data_prep.shapes.palettes import MATERIALS, shade
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import (
    Color,
    Part,
    box,
    fillet,
    hoop,
    lathe,
    polygon,
    prism,
    rounded,
    sheet,
    slab,
    tube,
)

Form = Callable[[np.random.Generator, Color], list[Part]]

_ARRANGEMENTS = {"stacked": 0.3, "beside": 0.2, "mirrored": 0.3, "grown": 0.2}
COUNTS = {1: 0.3, 2: 0.24, 3: 0.18, 4: 0.12, 5: 0.08, 6: 0.08}


def _superellipsoid(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a body between box and ball, or pinched, of many facets or few."""
    around, upward = (float(np.exp(uniform(rng, (-2.0, 0.25)))) for _ in range(2))
    fine = chance(rng, 0.6)
    sides = int(rng.integers(16, 33)) if fine else 2 * int(rng.integers(3, 7))
    levels = int(rng.integers(9, 17)) if fine else int(rng.integers(4, 7))
    latitude = np.linspace(-1.0, 1.0, levels) * (math.pi / 2 - 0.05)
    angle = (np.arange(sides) + 0.5) * (2 * math.pi / sides)
    outline = np.stack([_power(np.cos(angle), around), _power(np.sin(angle), around)], axis=1)
    radius = _power(np.cos(latitude), upward)[:, None, None]
    return [prism(1, radius * outline, _power(np.sin(latitude), upward), color)]


def _power(values: Floats, exponent: float) -> Floats:
    return np.sign(values) * np.abs(values) ** exponent


def body(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a body along z like that of a car or vessel, with creases; sometimes with a cabin."""
    section = _section(rng)
    count = int(rng.integers(5, 10))
    places = np.linspace(-1.0, 1.0, count)
    places[1:-1] += rng.uniform(-0.25, 0.25, count - 2) / count
    blunt = rng.uniform(0.25, 0.95, 2)  # width of the ends
    swell = uniform(rng, (1.5, 5.0))
    ends = np.where(places < 0, blunt[0], blunt[1])
    widths = 1 - (1 - ends) * np.abs(places) ** swell
    top = 1 - rng.uniform(0.0, 0.55, 2)[(places > 0).astype(int)] * np.abs(places) ** swell
    if chance(rng, 0.5):  # hood and boot: steps of the upper edge
        top *= np.where(np.abs(places - uniform(rng, (-0.2, 0.3))) < 0.5, 1.0, 0.72)
    floor = rng.uniform(0.0, 0.4, 2)[(places > 0).astype(int)] * np.abs(places) ** (swell + 1)
    outlines = np.empty((count, *section.shape))
    outlines[..., 0] = uniform(rng, (0.35, 0.8)) * widths[:, None] * section[:, 0]
    outlines[..., 1] = floor[:, None] + (top - floor)[:, None] * section[:, 1]
    outlines[..., 1] *= uniform(rng, (0.4, 1.0))
    solids = [prism(2, outlines, places, color)]
    if chance(rng, 0.4):
        height = outlines[..., 1].max()
        cabin = np.stack([outlines[count // 2], outlines[count // 2] * (0.85, 1.0)])
        cabin = cabin * (uniform(rng, (0.5, 0.9)), uniform(rng, (0.5, 0.9))) + (0, 0.3 * height)
        length, middle = uniform(rng, (0.2, 0.5)), uniform(rng, (-0.3, 0.3))
        rings = [cabin[1] * (0.8, 0.75) + (0, 0.25 * height * 0.75), *cabin[::-1], cabin[1]]
        at = np.array([-1.0, -0.6, 0.5, 1.0]) * length + middle
        solids.append(prism(2, np.array(rings), at, color))
    return solids


def _section(rng: np.random.Generator) -> Floats:
    """Return a convex section [n, 2], x -1..1 and y 0..1, with tumblehome, sharp or rounded."""
    belt, sill = uniform(rng, (0.35, 0.7)), uniform(rng, (0.08, 0.25))
    right = np.array(
        [
            (uniform(rng, (0.45, 0.85)), 0.0),
            (uniform(rng, (0.9, 0.97)), sill),
            (1.0, belt),
            (uniform(rng, (0.7, 0.93)), uniform(rng, (0.85, 0.93))),
            (uniform(rng, (0.35, 0.6)), 1.0),
        ]
    )
    section = np.concatenate([right, right[::-1] * (-1, 1)])
    if chance(rng, 0.5):
        edges = np.linalg.norm(section - np.roll(section, -1, axis=0), axis=1)
        section = rounded(section, 0.45 * edges.min(), 2)
    return section


def _faceted(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return the convex hull of random points, on a ball or in a box, often with a mirror image."""
    points = rng.normal(size=(int(rng.integers(8, 40)), 3))
    if chance(rng, 0.6):
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    else:
        points = rng.uniform(-1.0, 1.0, points.shape)
    if chance(rng, 0.5):
        points = np.concatenate([points, points * (-1, 1, 1)])
    hull = ConvexHull(points)
    kept = points[hull.vertices]
    numbers = np.zeros(len(points), np.int32)
    numbers[hull.vertices] = np.arange(len(kept))
    a, b, c = (points[hull.simplices[:, i]] for i in range(3))
    inwards = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces = numbers[hull.simplices]
    faces[inwards] = faces[inwards, ::-1]
    return [Part(kept, faces, color)]


def panelled(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a block with bevels, panels, grooves or knobs."""
    return carved(box((0, 0, 0), rng.uniform(0.5, 2.0, 3), color), rng)


def plate(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a thin plate: flat with bevelled edges, or bent in an arc or a wave."""
    thickness = uniform(rng, (0.03, 0.15))
    width, depth = uniform(rng, (0.8, 2.0)), uniform(rng, (0.5, 2.0))
    if chance(rng, 0.5):
        outline = polygon(int(rng.integers(3, 20)), 0.5)
        if chance(rng, 0.6):
            outline = rounded(
                [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)], uniform(rng, (0.02, 0.4)), 3
            )
        bevel = 0.3 * thickness if chance(rng, 0.6) else 0.0
        # The edges of a plate of many sides are short; the bevel stays below half of them.
        return [slab(outline, (0, 0, 0), (width, thickness, depth), color, bevel=min(bevel, 0.03))]
    x = np.linspace(-1.0, 1.0, int(rng.integers(7, 17)))
    crease = np.abs(x - uniform(rng, (-0.4, 0.4)))
    curve = pick(rng, {"arc": 0.4, "wave": 0.3, "crease": 0.3})
    y = {"arc": 1 - x**2, "wave": np.sin(2.5 * x), "crease": crease}[curve]
    line = np.stack([x * width / 2, uniform(rng, (0.1, 0.6)) * y], axis=1)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    sides = (line - thickness / 2 * normal, line + thickness / 2 * normal)
    return [sheet(2, sides, (-depth / 2, depth / 2), color)]


def _turned_shape(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a shape turned about the vertical, with sharp rims and steps."""
    count = int(rng.integers(3, 8))
    heights = np.cumsum(rng.uniform(0.1, 1.0, count))
    heights = 2 * (heights - heights[0]) / np.ptp(heights) - 1
    radii = rng.uniform(0.2, 1.0, count)
    profile: list[tuple[float, float]] = [(float(radii[0]), float(heights[0]))]
    for radius, height in zip(radii[1:].tolist(), heights[1:].tolist(), strict=True):
        if chance(rng, 0.45):  # straight up, then a level rim
            profile.append((profile[-1][0], height))
        profile.append((radius, height))
    return [lathe(profile, color, sides=int(rng.integers(8, 29)))]


def pipe(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a round or angular tube along a path with soft or sharp turns, or a ring."""
    if chance(rng, 0.25):
        steps = int(rng.integers(12, 25))
        return [hoop((0, 0, 0), 0.8, uniform(rng, (0.06, 0.25)), color, steps=steps)]
    radius = uniform(rng, (0.05, 0.16))
    steps = rng.normal(size=(int(rng.integers(1, 5)), 3)) * 0.35 + (0.7, 0, 0)
    path = np.concatenate([[(0.0, 0.0, 0.0)], np.cumsum(steps, axis=0)])
    path = path - (path.min(axis=0) + path.max(axis=0)) / 2
    shortest = float(np.linalg.norm(np.diff(path, axis=0), axis=1).min())
    if chance(rng, 0.6):
        path = fillet(path, 0.4 * shortest, 4)
    return [tube(path, min(radius, 0.3 * shortest), color, sides=int(rng.integers(4, 13)))]


FORMS: dict[Form, float] = {
    _superellipsoid: 0.22,
    body: 0.22,
    _faceted: 0.1,
    panelled: 0.22,
    plate: 0.1,
    _turned_shape: 0.09,
    pipe: 0.05,
}


def free_form(rng: np.random.Generator) -> list[Part]:
    """Return the solids of an object of one to six forms, in one to three colours."""
    materials = [pick(rng, dict.fromkeys(MATERIALS, 1.0)) for _ in range(int(rng.integers(1, 4)))]
    colors = [shade(rng, material) for material in materials]
    count = pick(rng, COUNTS)
    forms = [_standing(rng, colors[i % len(colors)]) for i in range(count)]
    arrangement = pick(rng, _ARRANGEMENTS)
    combined = forms[0]
    for form in forms[1:]:
        combined = _added(combined, form, arrangement, rng)
    stretched = np.exp(rng.uniform(-0.5, 0.5, 3))
    return [Part(part.vertices * stretched, part.faces, part.color) for part in combined]


def _standing(rng: np.random.Generator, color: Color) -> list[Part]:
    """Return a form, any way up, centred, of extents of its own."""
    parts = pick(rng, FORMS)(rng, color)
    turn = np.eye(3)
    if chance(rng, 0.4):  # cyclic exchanges of the axes turn a shape
        turn = np.roll(turn, int(rng.integers(1, 3)), axis=0)
    low, high = _bounds(parts)
    scale = np.exp(rng.uniform(-0.4, 0.4, 3)) / np.ptp([low, high], axis=0).max()
    middle = (low + high) / 2
    return [Part((p.vertices - middle) * scale @ turn, p.faces, p.color) for p in parts]


def _bounds(parts: list[Part]) -> tuple[Floats, Floats]:
    every = np.concatenate([part.vertices for part in parts])
    return every.min(axis=0), every.max(axis=0)


def _moved(parts: list[Part], offset: Floats, scale: float) -> list[Part]:
    return [Part(scale * part.vertices + offset, part.faces, part.color) for part in parts]


def _added(
    combined: list[Part], form: list[Part], arrangement: str, rng: np.random.Generator
) -> list[Part]:
    """Return an object and one more form, which overlaps it a little."""
    low, high = _bounds(combined)
    middle, extent = (low + high) / 2, high - low
    scale = uniform(rng, (0.3, 1.0)) * float(extent.max())
    half = scale * np.ptp(np.stack(_bounds(form)), axis=0) / 2
    overlap = uniform(rng, (0.02, 0.3))
    offset = middle + rng.uniform(-0.2, 0.2, 3) * extent
    if arrangement in ("stacked", "mirrored"):
        offset[0] = middle[0]
    axis = {"stacked": 1, "beside": int(rng.integers(2)) * 2, "mirrored": 0}.get(
        arrangement, int(rng.integers(3))
    )
    way = 1.0 if arrangement == "stacked" or chance(rng, 0.5) else -1.0
    if arrangement == "mirrored" and chance(rng, 0.6):
        # On both sides of the plane x = 0, on which the first form is centred.
        offset[0] = extent[0] / 2 + half[0] - overlap * 2 * min(half[0], extent[0] / 2)
        return [*combined, *pair(*_moved(form, offset, scale))]
    if arrangement == "mirrored":
        axis = 1 + int(rng.integers(2))
    reach = extent[axis] / 2 + half[axis] - overlap * 2 * min(half[axis], extent[axis] / 2)
    offset[axis] = middle[axis] + way * reach
    return [*combined, *_moved(form, offset, scale)]
