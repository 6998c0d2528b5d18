"""Training shapes with relief: widened shapes with carved parts, and free closed forms.

Widened shapes are made of plain boxes, prisms and lofts. Real meshes have smooth closed hulls,
bevels, panels, creases and thin plates, which a network has to have seen to keep them. All is
decided by the random stream.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats
from data_prep.clouds.normalise import normalise
from data_prep.scene import NEUTRAL_GREY, Mesh, in_one_colour
from data_prep.shapes.augmentation import (
    ATTEMPTS,
    Degenerate,
    deformed,
    draw_widened,
    painted,
    varied_parts,
)
from data_prep.shapes.carving import carve_some
from data_prep.shapes.deformations import LATTICE, Deformation, draw_deformation
from data_prep.shapes.free_forms import free_form
from data_prep.shapes.palettes import LIGHTEST
from data_prep.shapes.random_choices import chance, pick, uniform
from data_prep.shapes.shape_class import ShapeClass
from data_prep.shapes.solids import Color, join

KINDS = {"carved": 0.275, "free": 0.3, "widened": 0.425}
MOST_FACES = 6000  # of a mesh: more take too long to render
# Of the shapes that are not neutral grey. Few colours that are drawn evenly are light or dark.
_EXTREME_COLOURS = {"kept": 0.68, "light": 0.16, "dark": 0.16}


class _FastDeformation(Deformation):
    """A deformation that computes its free form as a product of matrices, ten times as fast.

    The result differs in the last digits, so `draw_widened`, whose shapes must not change, does not
    use it.
    """

    def _free_form(self, points: Floats) -> Floats:
        if not self.offsets.any():
            return np.zeros_like(points)
        t = np.clip((points + 1) / 2, 0.0, 1.0)
        s = 1 - t
        x, y, z = np.stack([s**3, 3 * t * s**2, 3 * t**2 * s, t**3], axis=-1).transpose(1, 0, 2)
        weights = (x[:, :, None] * y[:, None]).reshape(-1, LATTICE**2)
        along_z = (weights @ self.offsets.reshape(LATTICE**2, -1)).reshape(-1, LATTICE, 3)
        return (z[:, :, None] * along_z).sum(axis=1)


def draw_relief(shapes: ShapeClass, rng: np.random.Generator) -> tuple[Mesh, str]:
    """Return a normalised mesh and its kind, a key of KINDS; free forms are of no class.

    A draw is rejected as `draw_widened` rejects it, and where it has more than MOST_FACES faces.
    After ATTEMPTS rejected ones the shape is taken as the class draws it.
    """
    kind = pick(rng, KINDS)
    for _ in range(ATTEMPTS):
        try:
            return _with_extreme_colours(_draw(shapes, kind, rng), rng), kind
        except Degenerate:
            continue
    return shapes.draw(rng).mesh(), kind


def _draw(shapes: ShapeClass, kind: str, rng: np.random.Generator) -> Mesh:
    if kind == "widened":
        return _small_enough(draw_widened(shapes, rng)[0])
    if kind == "free":
        parts, share = free_form(rng), 0.5
    else:
        parts, share = carve_some(varied_parts(shapes, rng), rng), 0.8
    if chance(rng, share):
        deformation = _FastDeformation(**vars(draw_deformation(rng)))
        parts = deformed(parts, deformation, split_long_edges)
    return painted(normalise(_small_enough(join(parts))), rng)


def _small_enough(mesh: Mesh) -> Mesh:
    if len(mesh.faces) > MOST_FACES:
        raise Degenerate("too many faces")
    return mesh


def _with_extreme_colours(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return the mesh as it is, or, where it is not neutral grey, in one light or dark colour."""
    if (mesh.face_colors == NEUTRAL_GREY).all():
        return mesh
    match pick(rng, _EXTREME_COLOURS):
        case "light":
            return in_one_colour(mesh, _tinted(rng, (200.0, 222.0), 8.0))
        case "dark":
            return in_one_colour(mesh, _tinted(rng, (30.0, 70.0), 18.0))
    return mesh


def _tinted(rng: np.random.Generator, brightness: tuple[float, float], tint: float) -> Color:
    values = uniform(rng, brightness) + rng.uniform(-tint, tint, 3)
    red, green, blue = np.clip(values.astype(int), 12, LIGHTEST).tolist()
    return red, green, blue


def split_long_edges(
    vertices: Floats, faces: NDArray[np.int32], longest: float
) -> tuple[Floats, NDArray[np.int32]]:
    """Return a mesh whose edges longer than a length are halved until none is left.

    Both faces of an edge are divided at the same vertex, so a closed mesh stays closed, and the
    long narrow faces of bevels become few: only their long edges are halved.
    """
    while True:
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
        ends = vertices[edges]
        long = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2) > longest
        if not long.any():
            return vertices, faces
        count = len(vertices)
        keys, place = np.unique(
            edges[long].astype(np.int64) @ np.array([count, 1]), return_inverse=True
        )
        middle = np.full(faces.shape, -1, np.int64)
        middle[long] = count + place.reshape(-1)
        vertices = np.concatenate(
            [vertices, (vertices[keys // count] + vertices[keys % count]) / 2]
        )
        faces = _divided(faces, middle).astype(np.int32)


def _divided(faces: NDArray[np.int32], middle: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return faces divided at the middles of their edges [F, 3], -1 where an edge stays whole."""
    number = (middle >= 0).sum(axis=1)
    pieces = [faces[number == 0].astype(np.int64)]
    # Turned so that the edge that differs from the others comes first or last.
    starts = {1: np.argmax(middle >= 0, axis=1), 2: np.argmin(middle >= 0, axis=1) + 1, 3: None}
    for halved, start in starts.items():
        chosen = number == halved
        turn = np.zeros(chosen.sum(), int) if start is None else start[chosen]
        order = (turn[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[chosen], order, axis=1).astype(np.int64).T
        ab, bc, ca = np.take_along_axis(middle[chosen], order, axis=1).T
        corners = {
            1: [(a, ab, c), (ab, b, c)],
            2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
            3: [(a, ab, ca), (ab, b, bc), (bc, c, ca), (ab, bc, ca)],
        }[halved]
        pieces += [np.stack(triangle, axis=1) for triangle in corners]
    return np.concatenate(pieces)
