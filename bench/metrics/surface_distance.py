"""Distances between two surfaces: Chamfer distance, F-score and normal consistency.

Random points of each surface are compared with the nearest points of the other one, not of a sample
of it: two samples of one surface are farther apart than good reconstructions are.
"""

from __future__ import annotations

import numpy as np

from data_prep.arrays import Floats
from data_prep.clouds.sampling import sample_faces
from data_prep.scene import Mesh

SURFACE_METRICS: tuple[str, ...] = ("chamfer", "f-score", "normal-consistency")
SAMPLED = 10_000  # random points of each surface
NEAR = 0.01  # distance that counts as hit by the F-score: 1 % of the radius of the object
# Random points by which the nearest face is looked for: on a sphere .01 of the radius apart, so
# that a face which has none of them costs less than NEAR.
_DENSE = 100_000


def surface_scores(true: Mesh, drawn: Mesh, rng: np.random.Generator) -> dict[str, float]:
    """Return the scores of a mesh, both meshes in unit-sphere coordinates.

    chamfer             the mean distance of points of one surface from the other, and the mean of
                        both directions (Occupancy Networks, Mescheder et al. 2019)
    f-score             the harmonic mean of the shares of both surfaces that are nearer than NEAR
    normal-consistency  the mean cosine between normals there, without sign, as meshes have faces
                        that look inwards

    Raises BadInput for a mesh without a face of positive area.
    """
    from baselines.upsampler.data import nearest_on_surface  # slow to import

    corners = [mesh.vertices.astype(np.float64)[mesh.faces] for mesh in (true, drawn)]
    distances, cosines = list[Floats](), list[Floats]()
    for sampled, other in (corners, corners[::-1]):
        points, face, _ = sample_faces(sampled, rng, SAMPLED)
        nearest, normals = nearest_on_surface(other, points, rng, _DENSE)
        edges = np.diff(sampled[face], axis=1)
        facing = np.cross(edges[:, 0], edges[:, 1])
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        distances.append(np.linalg.norm(nearest - points, axis=1))
        cosines.append(np.abs((facing * normals).sum(axis=1)))
    hit = [float((distance < NEAR).mean()) for distance in distances]
    return {
        "chamfer": float(np.mean(distances)),
        "f-score": 2 * hit[0] * hit[1] / (sum(hit) or 1.0),
        "normal-consistency": float(np.mean(cosines)),
    }
