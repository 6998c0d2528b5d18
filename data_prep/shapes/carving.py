"""Relief worked into single solids: bevels, rounded edges, panels, frames, grooves and knobs.

A solid is taken apart into the rings that it was lofted through, and lofted again through more of
them. The result is one closed solid again; panels and knobs are further solids that are sunk into
the first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from data_prep.arrays import Floats
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.solids import Part, loft, polygon, rounded, signed_volume

_Level = tuple[float, float]  # distance from the end of a solid, length drawn in there

# How the ends of a solid are worked. All lengths are shares of its narrowest width.
ENDS = {"plain": 0.15, "bevel": 0.25, "round": 0.2, "recess": 0.2, "raised": 0.1, "frame": 0.1}
CORNERS = {0: 0.35, 1: 0.25, 3: 0.4}  # steps of the curves at the corners of a block: sharp, cut
LEAST_KEPT = 0.4  # of the volume of a solid: what loses more stays as it was
_THINNEST = 1e-3  # width over length of a solid that is worked


def carved(part: Part, rng: np.random.Generator) -> list[Part]:
    """Return a solid with relief, and the panels and knobs on it.

    A solid that is no loft, is thin as a wire, or loses too much of itself stays as it was.
    """
    rings = rings_of(part)
    if rings is None:
        return [part]
    count, sides = rings.shape[:2]
    block = (count, sides) == (2, 4)
    if block:
        rings = _seen_along_one_axis(rings, rng)
    width = _width(rings)
    if width < _THINNEST * np.ptp(part.vertices, axis=0).max():
        return [part]
    carving = _block if block else _column if count == 2 else _bar
    worked = loft(carving(rings, width, rng), part.color)
    volumes = [signed_volume(solid.vertices, solid.faces) for solid in (worked, part)]
    if not volumes[0] > LEAST_KEPT * volumes[1]:
        return [part]
    return [worked, *(_panels(rings, width, part, rng) if block and chance(rng, 0.4) else [])]


def rings_of(part: Part) -> Floats | None:
    """Return the rings [S, n, 3] that a solid with caps was lofted through, None for others."""
    sides = int(part.faces[0].max()) - 1
    if sides < 3 or len(part.vertices) % sides or len(part.vertices) < 2 * sides:
        return None
    rings = part.vertices.reshape(-1, sides, 3)
    if len(part.faces) != 2 * sides * (len(rings) - 1) + 2 * (sides - 2):
        return None
    faces = loft(rings, part.color).faces
    same = any(np.array_equal(part.faces, way) for way in (faces, faces[:, ::-1]))
    return rings if same else None


def _seen_along_one_axis(rings: Floats, rng: np.random.Generator) -> Floats:
    """Return a block's rings across one of its three axes, mostly that of its largest faces."""
    (a0, a1, a2, a3), (b0, b1, b2, b3) = rings
    ways = (
        rings,
        np.array([[a0, a1, b1, b0], [a3, a2, b2, b3]]),
        np.array([[a0, a3, b3, b0], [a1, a2, b2, b1]]),
    )
    areas = [np.linalg.norm(np.cross(way[0, 2] - way[0, 0], way[0, 3] - way[0, 1])) for way in ways]
    return ways[int(np.argmax(areas)) if chance(rng, 0.65) else int(rng.integers(3))]


def _width(rings: Floats) -> float:
    """Return the narrowest width of all rings: shortest edge of quads, else that of the ring."""
    if rings.shape[1] == 4:
        return float(np.linalg.norm(rings - np.roll(rings, -1, axis=1), axis=2).min())
    return 2 * float(np.linalg.norm(rings - rings.mean(axis=1, keepdims=True), axis=2).min())


def _block(rings: Floats, width: float, rng: np.random.Generator) -> Floats:
    length = float(np.linalg.norm((rings[1] - rings[0]).mean(axis=0)))
    steps = pick(rng, CORNERS)
    radius = uniform(rng, (0.05, 0.4)) * width
    worked = []
    for share, inset in _levels(length, width, rng):
        ring = _drawn_in(rings[0] + (rings[1] - rings[0]) * share, inset)
        if steps:
            longest = 0.45 * np.linalg.norm(ring - np.roll(ring, -1, axis=0), axis=1).min()
            ring = rounded(ring, min(max(radius - inset, 0.3 * radius), longest), steps)
        worked.append(ring)
    return np.array(worked)


def _drawn_in(quad: Floats, inset: float) -> Floats:
    """Return a quad [4, 3] whose edges have moved inwards by a length."""
    after, before = np.roll(quad, -1, axis=0) - quad, np.roll(quad, 1, axis=0) - quad
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(after, before), axis=1, keepdims=True)
    return quad + inset * (after + before) / np.maximum(sine, 0.3)


def _column(rings: Floats, width: float, rng: np.random.Generator) -> Floats:
    length = float(np.linalg.norm((rings[1] - rings[0]).mean(axis=0)))
    return np.array(
        [
            _shrunk(rings[0] + (rings[1] - rings[0]) * share, inset / (width / 2))
            for share, inset in _levels(length, width, rng)
        ]
    )


def _shrunk(ring: Floats, share: float) -> Floats:
    centre = ring.mean(axis=0)
    return centre + (1 - share) * (ring - centre)


def _bar(rings: Floats, width: float, rng: np.random.Generator) -> Floats:
    """Return the rings of a long or curved solid: cut edges, panel lines and bevelled ends."""
    if rings.shape[1] == 4 and chance(rng, 0.7):
        steps = 1 if chance(rng, 0.5) else 2
        radius = uniform(rng, (0.1, 0.4)) * width
        rings = np.array([rounded(ring, radius, steps) for ring in rings])
    lined = chance(rng, 0.4) and len(rings) < 16
    depth, bevel = uniform(rng, (0.02, 0.08)), uniform(rng, (0.05, 0.3))
    bevelled = [_shrunk(rings[0], bevel)]
    for first, second in pairwise(rings):
        bevelled.append(first + (0.12 if len(bevelled) == 1 else 0.0) * (second - first))
        if lined:
            bevelled += [
                _shrunk(first + place * (second - first), share)
                for place, share in ((0.44, 0.0), (0.46, depth), (0.54, depth), (0.56, 0.0))
            ]
    bevelled += [rings[-2] + 0.88 * (rings[-1] - rings[-2]), _shrunk(rings[-1], bevel)]
    return np.array(bevelled)


def _levels(length: float, width: float, rng: np.random.Generator) -> list[_Level]:
    """Return levels from one end to the other: place as a share of the length, and inset."""
    first = _end(length, width, rng)
    last = first if chance(rng, 0.5) else _end(length, width, rng)
    low, high = max(at for at, _ in first), length - max(at for at, _ in last)
    grooves: list[_Level] = []
    count = int(rng.integers(1, 5)) if chance(rng, 0.3) else 0
    pitch, depth = (high - low) / (count + 1), uniform(rng, (0.02, 0.12)) * width
    half = uniform(rng, (0.05, 0.35)) * pitch
    slope = uniform(rng, (0.1, 0.5)) * half
    for i in range(count):
        middle = low + (i + 1) * pitch
        grooves += [
            *((middle - half, 0.0), (middle - half + slope, depth)),
            *((middle + half - slope, depth), (middle + half, 0.0)),
        ]
    levels = [*first[::-1], *grooves, *((length - at, inset) for at, inset in last)]
    return [(at / length, inset) for at, inset in levels]


def _end(length: float, width: float, rng: np.random.Generator) -> list[_Level]:
    """Return the levels of an end, from the sides of the solid to the middle of its cap."""
    size = min(length, width)
    bevel = uniform(rng, (0.06, 0.42)) * size
    margin, slope = uniform(rng, (0.05, 0.2)) * width, uniform(rng, (0.0, 0.04)) * width
    depth = min(uniform(rng, (0.1, 0.4)) * length, uniform(rng, (0.03, 0.2)) * width)
    match pick(rng, ENDS):
        case "bevel":
            levels = [(bevel, 0.0), (0.0, bevel * uniform(rng, (0.4, 1.0)))]
        case "round":
            angles = np.linspace(0.0, math.pi / 2, int(rng.integers(3, 6)))
            levels = [(bevel * (1 - math.sin(t)), bevel * (1 - math.cos(t))) for t in angles]
        case "recess":
            levels = [(0.0, 0.0), (0.0, margin), (depth, margin + slope)]
        case "raised":
            levels = [(depth, 0.0), (depth, margin), (0.0, margin + slope)]
        case "frame":
            inner = margin + 0.1 * width
            levels = [(0.0, 0.0), (0.0, margin), (depth, margin), (depth, inner), (0.0, inner)]
        case _:
            levels = [(0.0, 0.0)]
    return levels


def _panels(rings: Floats, width: float, part: Part, rng: np.random.Generator) -> list[Part]:
    """Return panels or knobs in rows on an end of a block, sunk into it."""
    inner, outer = rings if chance(rng, 0.5) else rings[::-1]
    through = (outer - inner).mean(axis=0)
    length = float(np.linalg.norm(through))
    along, across = outer[1] - outer[0], outer[3] - outer[0]
    normal = np.cross(along, across)
    normal /= np.linalg.norm(normal)
    normal *= np.sign(normal @ through)
    if normal @ through < 0.5 * length:
        return []
    height = min(uniform(rng, (0.03, 0.12)) * width, 0.3 * length)
    # Deeper than the relief of the end, so that no panel floats above a recess.
    sunk = min(0.45 * length, 0.25 * width)
    columns, rows = (int(n) for n in rng.integers(1, 4, 2))
    round_ones = chance(rng, 0.35)
    filled, taper = uniform(rng, (0.3, 0.75)), uniform(rng, (0.75, 1.0))
    color = part.color
    if chance(rng, 0.4):
        red, green, blue = (int(0.6 * value) for value in color)
        color = (red, green, blue)
    shape = polygon(10, 0.5) if round_ones else np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
    panels = []
    for column in range(columns):
        for row in range(rows):
            u, v = 0.16 + 0.68 * (column + 0.5) / columns, 0.16 + 0.68 * (row + 0.5) / rows
            centre = (1 - u) * (1 - v) * outer[0] + u * (1 - v) * outer[1]
            centre = centre + u * v * outer[2] + (1 - u) * v * outer[3]
            first, second = 0.68 * filled / columns * along, 0.68 * filled / rows * across
            if round_ones:
                sizes = [np.linalg.norm(side) for side in (first, second)]
                first, second = (
                    min(sizes) / s * side for s, side in zip(sizes, (first, second), strict=True)
                )
            outline = shape[:, :1] * first + shape[:, 1:] * second
            panels.append(
                loft(
                    [centre - sunk * normal + outline, centre + height * normal + taper * outline],
                    color,
                )
            )
    return panels


def carve_some(parts: Sequence[Part], rng: np.random.Generator, most: int = 8) -> list[Part]:
    """Return the parts, of which the largest ones, at most `most`, have relief.

    Equal parts stay alike: each kind of equal size is worked with the same random numbers.
    """
    sizes = [tuple(np.round(np.ptp(part.vertices, axis=0), 6)) for part in parts]
    order = sorted(range(len(parts)), key=lambda i: -float(np.prod(np.sort(sizes[i])[1:])))
    seed = int(rng.integers(2**32))
    share = uniform(rng, (0.5, 1.0))
    worked: dict[int, list[Part]] = {}
    for i in order[:most]:
        key = [seed, len(parts[i].vertices), *(int(1e6 * s) for s in sizes[i])]
        part_rng = np.random.default_rng(key)
        if chance(part_rng, share):
            worked[i] = carved(parts[i], part_rng)
    return [solid for i, part in enumerate(parts) for solid in worked.get(i, [replace(part)])]
