"""The training data of the up-sampler: clouds, places near them, and where these belong.

A place belongs at the nearest point of the surface. Making the data of a cloud takes a fifth of a
second, so all are made once, before the training.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from baselines.reconstruction.denoised import perpendicular
from baselines.upsampler.network import Surroundings
from baselines.upsampler.surroundings import surroundings
from data_prep.arrays import Floats
from data_prep.clouds.sampling import sample_faces
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.training_set import DATA_SEED
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import CLOUD_SIZE
from learning.clouds import CLEAN_SHARE, MAX_NOISE

PLACES = 4096  # places near the cloud of an object
# With probability _USUAL a cloud has CLOUD_SIZE points. Otherwise their number lies between _FEWEST
# and _MOST, and its logarithm is uniformly distributed.
_FEWEST, _MOST = 192, 4096
_USUAL = 0.5
# A place lies in a disc around a point of the cloud, or above or below it. Its disc has one of the
# radii _ASIDE, and its height one of the standard deviations _ABOVE, in spacings of the points. In
# use, places that a cloud is filled up with have small heights, and corners of a wrap larger ones.
_ASIDE = (1.0, 2.0)
_ABOVE = (0.1, 0.5)
_DENSE = 20_000  # random points of the surface, by which the faces near a place are found
_FACES = 4  # faces that are tried for a place: those of its nearest points of the surface


@dataclass(frozen=True, eq=False)
class UpsamplerSet:
    """The clouds of M objects, one after the other in one array, and Q places near each.

    clouds   the surroundings of the points of all clouds
    first    int64 [M + 1]: the row of the first point of each cloud, and the number of all points
    places   float32 [M, Q, 3]
    nearest  int64 [M, Q]: the index, within its cloud, of the point nearest to each place
    targets  float32 [M, Q, 3]: the point of the surface nearest to each place
    normals  float32 [M, Q, 3]: unit normals of the surface at the targets
    """

    clouds: Surroundings
    first: Tensor
    places: Tensor
    nearest: Tensor
    targets: Tensor
    normals: Tensor


def upsampler_set(objects: Sequence[SceneObject], *, quiet: bool = False) -> UpsamplerSet:
    """Return a cloud of each object with places near it; show progress on standard error.

    Two clouds in five have no noise.

    Raises BadInput for an object that cannot be loaded.
    """
    clouds: list[Surroundings] = []
    labelled: list[_LabelledPlaces] = []
    with progress("clouds", len(objects), quiet=quiet) as advance:
        for obj in objects:
            rng = generator("upsampler", DATA_SEED, obj.class_name, obj.object_id)
            corners = _corners(obj)
            clouds.append(_cloud(corners, rng))
            labelled.append(_places_and_targets(clouds[-1], corners, rng))
            advance(0)
    sizes = [len(cloud.points) for cloud in clouds]
    return UpsamplerSet(
        clouds=joined(clouds),
        first=torch.tensor([0, *sizes]).cumsum(0),
        places=torch.stack([some.places for some in labelled]),
        nearest=torch.stack([some.nearest for some in labelled]),
        targets=torch.stack([some.targets for some in labelled]),
        normals=torch.stack([some.normals for some in labelled]),
    )


class _LabelledPlaces(NamedTuple):
    """The places near one cloud, as `UpsamplerSet` has them for all, without its first axis."""

    places: Tensor
    nearest: Tensor
    targets: Tensor
    normals: Tensor


def joined(clouds: Sequence[Surroundings]) -> Surroundings:
    """Return several clouds as one; `neighbours` are still row numbers within each cloud."""
    parts = {}
    for field in fields(Surroundings):
        parts[field.name] = torch.cat([getattr(cloud, field.name) for cloud in clouds])
    return Surroundings(**parts)


def _corners(obj: SceneObject) -> Floats:
    """Return the corners of an object's triangles, [F, 3, 3]."""
    mesh = obj.load()
    return mesh.vertices.astype(np.float64)[mesh.faces]


def _cloud(corners: Floats, rng: np.random.Generator) -> Surroundings:
    """Return the surroundings of a cloud with a random number of points and random noise.

    corners  [F, 3, 3], of the triangles that it is sampled from
    """
    count = CLOUD_SIZE
    if rng.random() >= _USUAL:
        count = round(_FEWEST * (_MOST / _FEWEST) ** rng.random())
    points, _, _ = sample_faces(corners, rng, count)
    if rng.random() >= CLEAN_SHARE:
        points = points + rng.normal(size=points.shape) * rng.random() * MAX_NOISE
    return surroundings(np.unique(points.astype(np.float32), axis=0))[0]


def _places_and_targets(
    seen: Surroundings, corners: Floats, rng: np.random.Generator
) -> _LabelledPlaces:
    """Return places near a cloud, with the surface of triangles [F, 3, 3] as their target."""
    places = _places(seen, rng)
    _, nearest = cKDTree(seen.points.numpy()).query(places)
    targets, normals = nearest_on_surface(corners, places, rng)
    return _LabelledPlaces(
        places=torch.from_numpy(places.astype(np.float32)),
        nearest=torch.from_numpy(nearest),
        targets=torch.from_numpy(targets.astype(np.float32)),
        normals=torch.from_numpy(normals.astype(np.float32)),
    )


def _places(seen: Surroundings, rng: np.random.Generator) -> Floats:
    """Return places [PLACES, 3] near random points: in, above and below a disc around each."""
    point = rng.integers(len(seen.points), size=PLACES)
    distance = rng.choice(_ASIDE, PLACES) * np.sqrt(rng.random(PLACES))
    angle = 2 * np.pi * rng.random(PLACES)
    height = rng.normal(size=PLACES) * rng.choice(_ABOVE, PLACES)
    normal = seen.normals[point].numpy().astype(np.float64)
    along = perpendicular(normal)
    aside = np.cross(normal, along)
    offset = (distance * np.cos(angle))[:, None] * along
    offset = offset + (distance * np.sin(angle))[:, None] * aside
    offset = offset + height[:, None] * normal
    return seen.points[point].numpy() + offset * seen.radius[point].numpy()[:, None]


def nearest_on_surface(
    corners: Floats, places: Floats, rng: np.random.Generator, count: int = _DENSE
) -> tuple[Floats, Floats]:
    """Return the points of triangles nearest to places, [Q, 3], and the unit normals there, [Q, 3].

    corners  [F, 3, 3], of the triangles
    places   [Q, 3]
    count    of random points of the surface

    For each place only _FACES triangles are tried: those on which the nearest of these random
    points lie.
    """
    from trimesh.triangles import closest_point

    dense, faces, _ = sample_faces(corners, rng, count)
    tried = faces[cKDTree(dense).query(places, k=_FACES)[1]]  # [Q, _FACES]
    on = closest_point(corners[tried.ravel()], np.repeat(places, _FACES, axis=0))
    on = on.reshape(len(places), _FACES, 3)
    best = np.linalg.norm(on - places[:, None], axis=2).argmin(axis=1)
    row = np.arange(len(places))
    edges = np.diff(corners[tried[row, best]], axis=1)
    normals = np.cross(edges[:, 0], edges[:, 1])
    return on[row, best], normals / np.linalg.norm(normals, axis=1, keepdims=True)
