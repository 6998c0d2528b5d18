"""Training shapes that vary more than a class: parts exchanged, left out, thickened, bent, painted.

What a thing is stays; the generator's habits go. Only trainings use them: the other splits are
untouched. All is decided by the random stream.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.remesh import subdivide_to_size

from data_prep.arrays import Floats
from data_prep.clouds.normalise import normalise
from data_prep.scene import NEUTRAL_GREY, Mesh, in_one_colour
from data_prep.shapes.chair.backs import arm_parts, back_parts
from data_prep.shapes.chair.bases import base_parts
from data_prep.shapes.chair.seats import lay_out, seat_parts
from data_prep.shapes.chair.spec import FAMILY_WEIGHTS, Family, draw_spec_of
from data_prep.shapes.deformations import Deformation, draw_deformation
from data_prep.shapes.palettes import LIGHTEST, MATERIALS, shade
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.shape_class import ShapeClass
from data_prep.shapes.solids import Color, Part, join, signed_volume

PLAIN = 0.2  # of the shapes are as their class draws them
ATTEMPTS = 20
_FLATTEST = 0.04  # smallest over largest extent of what is no thin class of its own
_LEAST_STRETCH = 0.15  # of the mean: below it space is folded, or nearly so
EDGE = 0.3  # longest edge of a face that is deformed, in half extents
_LARGEST_PART = 0.35  # of the surface, of a part that may be left out
_LONG = 4.0  # longest over second extent of a part that may become thicker
_COLOUR_SOURCES = {"kept": 0.4, "material": 0.35, "any": 0.25}
# Half of the mesh files that people have carry one colour or none, which no class draws. Without
# them a network paints whatever it is given.
_PAINTS = {"by part": 0.45, "one colour": 0.15, "none": 0.4}

Split = Callable[[Floats, NDArray[np.int32], float], Any]  # (vertices, faces) of a mesh


class Degenerate(Exception):
    """The error for a random shape that is flat, folded or inside out, and is not trained on."""


def draw_widened(shapes: ShapeClass, rng: np.random.Generator) -> tuple[Mesh, int]:
    """Return a normalised mesh of a class, and how many draws were rejected before it.

    A draw is rejected where it is flat (smallest extent below FLATTEST of the largest, and below
    half of what it was), where a part has no positive volume, and where the deformation stretches
    space somewhere by less than _LEAST_STRETCH of its mean (folds, turns inside out). After
    ATTEMPTS rejected ones the shape is taken as the class draws it.
    """
    for rejected in range(ATTEMPTS):
        try:
            return _draw(shapes, rng), rejected
        except Degenerate:
            continue
    return shapes.draw(rng).mesh(), ATTEMPTS


def _draw(shapes: ShapeClass, rng: np.random.Generator) -> Mesh:
    if chance(rng, PLAIN):
        return shapes.draw(rng).mesh()
    parts = varied_parts(shapes, rng)
    if chance(rng, 0.8):
        parts = deformed(parts, draw_deformation(rng))
    return painted(normalise(join(parts)), rng)


def varied_parts(shapes: ShapeClass, rng: np.random.Generator) -> list[Part]:
    """Return parts of a class: exchanged, some left out, thicker or thinner, of other colours."""
    exchanged = shapes.name == "chair" and chance(rng, 0.3)
    parts = exchanged_chair(rng) if exchanged else list(shapes.draw(rng).parts)
    if chance(rng, 0.3):
        parts = _without_some(parts, rng)
    if chance(rng, 0.5):
        parts = thickened(parts, np.exp(uniform(rng, (-0.5, 0.7))))
    return _recoloured(parts, rng)


def exchanged_chair(rng: np.random.Generator) -> list[Part]:
    """Return a chair whose base, and whose seat and back, are of different families."""
    bases: dict[Family, float] = {k: w for k, w in FAMILY_WEIGHTS.items() if k != "armchair"}
    backs: dict[Family, float] = {k: w for k, w in bases.items() if k != "stool"}
    above, below = draw_spec_of(rng, pick(rng, backs)), draw_spec_of(rng, pick(rng, bases))
    seat = {
        name: getattr(above, name)
        for name in (
            *("seat", "cushion", "posts", "back", "rake_deg", "rear", "seat_width_m"),
            *("seat_depth_m", "seat_thickness_m", "cushion_m", "back_height_m", "gap_m"),
        )
    }
    base = replace(below, **seat)
    layout = lay_out(base)
    upper = replace(above, seat_height_m=base.seat_height_m, leg_m=base.leg_m)
    return [
        *base_parts(base, layout),
        *seat_parts(upper, layout),
        *back_parts(upper, layout),
        *arm_parts(upper, layout),
    ]


def _without_some(parts: Sequence[Part], rng: np.random.Generator) -> list[Part]:
    """Return the parts with one to three small ones left out, but at least one part.

    A part is small if its area is less than the share _LARGEST_PART of that of all parts.
    """
    areas = np.array([_area(part) for part in parts])
    small = np.flatnonzero(areas < _LARGEST_PART * areas.sum())
    count = min(int(rng.integers(1, 4)), len(small), len(parts) - 1)
    gone = set(rng.choice(small, count, replace=False).tolist()) if count else set()
    return [part for i, part in enumerate(parts) if i not in gone]


def thickened(parts: Sequence[Part], factor: float) -> list[Part]:
    """Return the parts with long ones thicker by a factor, about their middle line."""
    changed = []
    for part in parts:
        centre = part.vertices.mean(axis=0)
        _, extents, axes = np.linalg.svd(part.vertices - centre, full_matrices=False)
        if extents[0] < _LONG * extents[1]:
            changed.append(part)
            continue
        along = np.outer(axes[0], axes[0])
        grown = (part.vertices - centre) @ (along + factor * (np.eye(3) - along))
        changed.append(replace(part, vertices=centre + grown))
    return changed


def _recoloured(parts: Sequence[Part], rng: np.random.Generator) -> list[Part]:
    """Return the parts in new colours, where parts of equal colours stay equal.

    A colour stays as it is, or becomes one of another material, or any colour.
    """
    new = {color: _recolour(color, rng) for color in dict.fromkeys(part.color for part in parts)}
    return [replace(part, color=new[part.color]) for part in parts]


def _recolour(color: Color, rng: np.random.Generator) -> Color:
    match pick(rng, _COLOUR_SOURCES):
        case "material":
            return shade(rng, pick(rng, dict.fromkeys(MATERIALS, 1.0)))
        case "any":
            return _any(rng)
    return color


def _any(rng: np.random.Generator) -> Color:
    red, green, blue = rng.integers(12, LIGHTEST + 1, 3).tolist()
    return red, green, blue


def painted(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return the mesh as it is, or in one random colour, or in neutral grey.

    Meshes of files without colours are neutral grey.
    """
    match pick(rng, _PAINTS):
        case "one colour":
            return in_one_colour(mesh, _any(rng))
        case "none":
            return in_one_colour(mesh, NEUTRAL_GREY)
    return mesh


def deformed(
    parts: Sequence[Part], deformation: Deformation, split: Split = subdivide_to_size
) -> list[Part]:
    """Return all parts moved by the same deformation, with faces small enough to bend.

    split  divides the faces of a mesh until no edge is longer than a given length

    Raises Degenerate where the result is flat or folded, as `draw_widened` says.
    """
    every = np.concatenate([part.vertices for part in parts])
    low, high = every.min(axis=0), every.max(axis=0)
    centre, half = (low + high) / 2, (high - low).max() / 2
    fine = [split((p.vertices - centre) / half, p.faces, EDGE) for p in parts]
    if (
        deformation.smallest_stretch(np.concatenate([triangles[0] for triangles in fine]))
        < _LEAST_STRETCH
    ):
        raise Degenerate("folded")
    bent = [
        Part(deformation(triangles[0]), triangles[1].astype(np.int32), part.color)
        for part, triangles in zip(parts, fine, strict=True)
    ]
    if not all(signed_volume(part.vertices, part.faces) > 0 for part in bent):
        raise Degenerate("inside out")
    if _flatness(bent) < min(_FLATTEST, _flatness(parts) / 2):
        raise Degenerate("flat")
    return bent


def _flatness(parts: Sequence[Part]) -> float:
    """Return the smallest over the largest extent."""
    extents = np.ptp(np.concatenate([part.vertices for part in parts]), axis=0)
    return float(extents.min() / extents.max())


def _area(part: Part) -> Floats:
    a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
