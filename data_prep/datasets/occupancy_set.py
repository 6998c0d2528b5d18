"""Clouds and labelled query points of many objects, in memory, for training in 3D.

A label says whether a point lies inside the object. The procedural shapes are unions of closed
solids whose faces look outwards, so a point is inside where the winding number of the whole mesh is
above zero; solids may overlap. A mesh with sheets or faces that look inwards has no such inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.arrays import Floats
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.training_set import DATA_SEED
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, Mesh, Points

_QUERIES = 4096  # of an object: half of them near its surface
# Standard deviations of the offsets from the surface: about half a pixel of the image, and three.
NEAR = (0.01, 0.05)
BALL = 1.05  # radius of the ball of the other half: a little beyond the objects
_BINS = 64  # a side of the grid that finds the faces above a point
# No face of the shapes is parallel to these but by chance: many are to an axis.
DIRECTIONS = ((0.137, 0.978, 0.157), (0.893, -0.211, 0.398))
_MOST_UNDECIDED = 0.01  # of the points: more, and the mesh has no inside


@dataclass(frozen=True, eq=False)
class OccupancySet:
    """N objects, each with a cloud and Q labelled points.

    clouds   float32 [N, CLOUD_SIZE, 3], unit-sphere coordinates
    queries  float32 [N, Q, 3]
    inside   bool [N, Q]
    """

    clouds: NDArray[np.float32]
    queries: NDArray[np.float32]
    inside: NDArray[np.bool_]


def occupancy_set(
    objects: Sequence[SceneObject], queries: int = _QUERIES, *, quiet: bool = False
) -> OccupancySet:
    """Return clouds and labels of objects; show progress on stderr.

    The clouds are those of `data_prep.datasets.training_set.training_set`. Raises BadInput for an
    object that cannot be loaded.
    """
    count = len(objects)
    clouds = np.empty((count, CLOUD_SIZE, 3), np.float32)
    places = np.empty((count, queries, 3), np.float32)
    inside = np.empty((count, queries), np.bool_)
    with progress("labelling", count, quiet=quiet) as advance:
        for i, obj in enumerate(objects):
            mesh = obj.load()
            key = (DATA_SEED, obj.class_name, obj.object_id)
            clouds[i] = sample_surface(mesh, generator("training cloud", *key)).points
            places[i] = draw_queries(mesh, queries, generator("training queries", *key))
            inside[i] = labels(mesh, places[i], f"{obj.class_name}/{obj.object_id}")
            advance(0)
    return OccupancySet(clouds, places, inside)


def draw_queries(mesh: Mesh, count: int, rng: np.random.Generator) -> Points:
    """Return points [count, 3] in random order, half of them near the surface of a mesh.

    These are points of the surface with Gaussian offsets of the two scales NEAR; the other half is
    uniform in a ball.
    """
    near = sample_surface(mesh, rng, count // 2).points
    near = near + rng.normal(size=near.shape) * rng.choice(NEAR, (len(near), 1))
    direction = rng.normal(size=(count - len(near), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ball = BALL * np.cbrt(rng.random((len(direction), 1))) * direction
    return rng.permutation(np.concatenate([near, ball])).astype(np.float32)


def labels(mesh: Mesh, points: Points, name: str) -> NDArray[np.bool_]:
    """Return whether points [Q, 3] are inside a mesh: whether its winding number is above zero.

    Raises BadInput where rays in two directions disagree about more than _MOST_UNDECIDED of them
    (the mesh is open), or as many numbers are negative (faces look inwards).
    """
    number, other = (winding_numbers(mesh, points, direction) for direction in DIRECTIONS)
    undecided = np.count_nonzero((number != other) | (number < 0)) / len(points)
    if undecided > _MOST_UNDECIDED:
        raise BadInput(
            f"{name}: inside and outside cannot be told apart at {undecided:.0%} of the points; "
            "train on closed solids whose faces look outwards, like --dataset procedural:widened"
        )
    return number > 0


def winding_numbers(
    mesh: Mesh, points: Points, direction: ArrayLike = DIRECTIONS[0]
) -> NDArray[np.int64]:
    """Return how many times the faces of a mesh surround points [Q, 3], by signed crossings.

    A ray goes from each point in one direction: faces that it leaves through count +1, faces that
    it enters through -1. Where the mesh is a union of closed solids that look outwards, the number
    is that of the solids which the point lies in.
    """
    turn = _frame(np.asarray(direction, dtype=np.float64))
    corners = (mesh.vertices.astype(np.float64) @ turn)[mesh.faces]  # [F, 3, 3], the ray along z
    seen = points.astype(np.float64) @ turn
    face, query = _candidates(corners, seen)
    a, b, c = np.moveaxis(corners[face], 1, 0)
    p = seen[query]
    areas = [_cross(u - p, v - p) for u, v in ((b, c), (c, a), (a, b))]
    total = areas[0] + areas[1] + areas[2]
    sign = np.sign(total)
    within = np.logical_and.reduce([area * sign >= 0 for area in areas]) & (sign != 0)
    face_sign, query = sign[within], query[within]
    weights = np.stack(areas, axis=1)[within] / total[within, None]
    height = (weights * np.stack([a, b, c], axis=1)[within, :, 2]).sum(axis=1)
    above = height > seen[query, 2]
    return np.bincount(query[above], face_sign[above], len(points)).astype(np.int64)


def _candidates(corners: Floats, points: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return pairs of a face [F, 3, 3] and a point [Q, 3] that share a bin of the (x, y) plane."""
    low = corners[..., :2].min(axis=(0, 1))
    scale = _BINS / np.maximum(np.ptp(corners[..., :2], axis=(0, 1)), 1e-12)

    def bins(places: Floats) -> NDArray[np.int64]:
        return np.clip((places - low) * scale, 0, _BINS - 1).astype(np.int64)

    first, last = bins(corners[..., :2].min(axis=1)), bins(corners[..., :2].max(axis=1))
    extent = last - first + 1
    face, number = _expanded(extent.prod(axis=1))
    column, row = (
        first[face, 0] + number % extent[face, 0],
        first[face, 1] + number // extent[face, 0],
    )
    cell = column * _BINS + row
    order = np.argsort(cell, kind="stable")
    face, cell = face[order], cell[order]
    at = bins(points[:, :2]) @ (_BINS, 1)
    start, end = np.searchsorted(cell, at, "left"), np.searchsorted(cell, at, "right")
    query, number = _expanded(end - start)
    return face[start[query] + number], query


def _expanded(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each index as often as `counts` says, and the number of the repetition."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _frame(direction: Floats) -> Floats:
    """Return a rotation [3, 3] whose last column is a direction."""
    last = direction / np.linalg.norm(direction)
    first = np.cross(last, (1.0, 0.0, 0.0))
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(last, first), last], axis=1)
