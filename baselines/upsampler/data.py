"""The data of the training: noisy clouds, places near them, and the nearest points of the surface.

A cloud takes a fifth of a second, so all are made once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

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

PLACES = 4096  # of an object
# With probability _USUAL a cloud has CLOUD_SIZE points. Otherwise their number lies between _FEWEST
# and _MOST, and its logarithm is uniformly distributed.
_FEWEST, _MOST = 192, 4096
_USUAL = 0.5
# Spacings: radii of the discs around points in which places lie, and standard deviations of their
# heights above them. Those that the cloud is filled up with lie low, corners of a wrap higher.
_ASIDE = (1.0, 2.0)
_ABOVE = (0.1, 0.5)
_DENSE = 20_000  # points of the surface by which the faces near a place are found
_FACES = 4  # tried for a place: those of its four nearest dense points


@dataclass(frozen=True, eq=False)
class UpsamplerSet:
    """Clouds of M objects, one after the other, and Q places of each.

    clouds   the surroundings of all points
    first    int64 [M + 1]: the first point of each cloud, and the number of all
    places   float32 [M, Q, 3]
    nearest  int64 [M, Q]: the index, within its cloud, of the point nearest to each place
    targets  float32 [M, Q, 3]: the nearest point of the surface
    normals  float32 [M, Q, 3]: of the surface there, of the side that its face looks to
    """

    clouds: Surroundings
    first: Tensor
    places: Tensor
    nearest: Tensor
    targets: Tensor
    normals: Tensor


def upsampler_set(objects: Sequence[SceneObject], *, quiet: bool = False) -> UpsamplerSet:
    """Return a noisy cloud of each object, with places near it; show progress on stderr.

    Two clouds in five have no noise. Raises BadInput for an object that cannot be loaded.
    """
    clouds: list[Surroundings] = []
    labelled: list[tuple[Tensor, ...]] = []
    with progress("clouds", len(objects), quiet=quiet) as advance:
        for obj in objects:
            rng = generator("upsampler", DATA_SEED, obj.class_name, obj.object_id)
            corners = _corners(obj)
            clouds.append(_cloud(corners, rng))
            labelled.append(_places_and_targets(clouds[-1], corners, rng))
            advance(0)
    first = torch.tensor([0, *(len(cloud.points) for cloud in clouds)]).cumsum(0)
    return UpsamplerSet(joined(clouds), first, *map(torch.stack, zip(*labelled, strict=True)))


def joined(clouds: Sequence[Surroundings]) -> Surroundings:
    """Return several clouds in one; neighbours stay numbers of points within their cloud."""
    names = [field.name for field in fields(Surroundings)]
    return Surroundings(*(torch.cat([getattr(c, name) for c in clouds]) for name in names))


def _corners(obj: SceneObject) -> Floats:
    mesh = obj.load()
    return mesh.vertices.astype(np.float64)[mesh.faces]


def _cloud(corners: Floats, rng: np.random.Generator) -> Surroundings:
    """Return the surroundings of a cloud of random size and noise."""
    count = CLOUD_SIZE
    if rng.random() >= _USUAL:
        count = round(_FEWEST * (_MOST / _FEWEST) ** rng.random())
    points, _, _ = sample_faces(corners, rng, count)
    if rng.random() >= CLEAN_SHARE:
        points = points + rng.normal(size=points.shape) * rng.random() * MAX_NOISE
    return surroundings(np.unique(points.astype(np.float32), axis=0))[0]


def _places_and_targets(
    seen: Surroundings, corners: Floats, rng: np.random.Generator
) -> tuple[Tensor, ...]:
    """Return places near a cloud, their nearest points, targets and normals."""
    places = _places(seen, rng)
    nearest = cKDTree(seen.points.numpy()).query(places)[1]
    targets, normals = nearest_on_surface(corners, places, rng)
    floats = [torch.from_numpy(a.astype(np.float32)) for a in (places, targets, normals)]
    return floats[0], torch.from_numpy(nearest), *floats[1:]


def _places(seen: Surroundings, rng: np.random.Generator) -> Floats:
    """Return places [Q, 3] in a disc around random points, some above and below it."""
    point = rng.integers(len(seen.points), size=PLACES)
    distance = rng.choice(_ASIDE, PLACES) * np.sqrt(rng.random(PLACES))
    angle = 2 * np.pi * rng.random(PLACES)
    height = rng.normal(size=PLACES) * rng.choice(_ABOVE, PLACES)
    normal = seen.normals[point].numpy().astype(np.float64)
    first = perpendicular(normal)
    axes = (first, np.cross(normal, first), normal)
    steps = (distance * np.cos(angle), distance * np.sin(angle), height)
    offset = sum(step[:, None] * axis for step, axis in zip(steps, axes, strict=True))
    return seen.points[point].numpy() + offset * seen.radius[point].numpy()[:, None]


def nearest_on_surface(
    corners: Floats, places: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return the nearest points of triangles [F, 3, 3] to places [Q, 3], and unit normals there.

    The triangles tried are those of the nearest of many random points of the surface.
    """
    from trimesh.triangles import closest_point

    dense, faces, _ = sample_faces(corners, rng, _DENSE)
    tried = faces[cKDTree(dense).query(places, k=_FACES)[1]]  # [Q, _FACES]
    on = closest_point(corners[tried.ravel()], np.repeat(places, _FACES, axis=0))
    on = on.reshape(len(places), _FACES, 3)
    best = np.linalg.norm(on - places[:, None], axis=2).argmin(axis=1)
    row = np.arange(len(places))
    edges = np.diff(corners[tried[row, best]], axis=1)
    normals = np.cross(edges[:, 0], edges[:, 1])
    return on[row, best], normals / np.linalg.norm(normals, axis=1, keepdims=True)
