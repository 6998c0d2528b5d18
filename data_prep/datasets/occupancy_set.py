"""Clouds and labelled query points of many objects, in memory, for training in 3D.

A label says whether a point lies inside the object. The procedural shapes are unions of closed
solids whose faces look outwards, so a point is inside where the winding number of the whole mesh
(Jacobson et al. 2013, by libigl) is one or more; solids may overlap. A mesh with sheets or faces
that look inwards has no such inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.training_set import DATA_SEED
from data_prep.failures import BadInput, MissingDependency
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE, Mesh, Points

_QUERIES = 4096  # of an object: half of them near its surface
# Standard deviations of the offsets from the surface: about half a pixel of the image, and three.
NEAR = (0.01, 0.05)
BALL = 1.05  # radius of the ball of the other half: a little beyond the objects
# From the nearest whole number: of closed meshes the approximation of libigl stays well below.
_MOST_APART = 0.1
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
    object that cannot be loaded, and as `labels`.
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

    Raises BadInput where at more than _MOST_UNDECIDED of them the number is not whole (the mesh is
    open) or negative (faces look inwards), and MissingDependency where libigl is not installed.
    """
    numbers = winding_numbers(mesh, points)
    whole = np.round(numbers)
    is_undecided = (np.abs(numbers - whole) > _MOST_APART) | (whole < 0)
    undecided = np.count_nonzero(is_undecided) / len(points)
    if undecided > _MOST_UNDECIDED:
        raise BadInput(
            f"{name}: inside and outside cannot be told apart at {undecided:.0%} of the points; "
            "train on closed solids whose faces look outwards, like --dataset procedural:widened"
        )
    return whole > 0


def winding_numbers(mesh: Mesh, points: Points) -> Floats:
    """Return how many times the faces of a mesh surround points [Q, 3], float64.

    Where the mesh is a union of closed solids that look outwards, the number is that of the solids
    which the point lies in, but for an approximation of some 0.01. Raises MissingDependency where
    libigl is not installed.
    """
    try:
        import igl
    except ImportError as error:
        raise MissingDependency(
            "labels of places need libigl; install it with: pip install 'pc2pix-bench[train]'"
        ) from error
    vertices, places = mesh.vertices.astype(np.float64), points.astype(np.float64)
    numbers = igl.fast_winding_number(vertices, mesh.faces.astype(np.int64), places)
    return np.asarray(numbers, dtype=np.float64)
