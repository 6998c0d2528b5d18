"""Scores of meshes by closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from bench.metrics.surface_distance import SAMPLED, surface_scores
from data_prep.failures import BadInput
from data_prep.scene import Mesh

SQUARE = ((0, 1, 2), (0, 2, 3))


def sphere(radius: float) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return Mesh(made.vertices, made.faces, np.zeros((len(made.faces), 3)))


def square(up: float = 0, width: float = 1, faces=SQUARE) -> Mesh:
    corners = [(width * x, y, up) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return Mesh(np.array(corners), np.array(faces).reshape(-1, 3), np.zeros((len(faces), 3)))


# Spheres of flat faces are parallel, and their planes nearer than d by less than .1 %, as an edge
# is .07 of the radius. Of a square a strip of width .2 is missing: distances there are uniform in
# 0 to .2, so that the mean is .02, the mean square .2^3 / 3, and .81 are nearer than .01; the other
# way all are 0. A few points in 10,000 may be compared with the face beside the nearest one.
STRIP = (0.2**3 / 3 - 0.02**2) ** 0.5
CASES = {  # both meshes, the scores in the order of the table, and the deviation of one distance
    "two spheres": (sphere(0.8), sphere(0.85), (0.05, 0, 1), 0),
    "a sphere and itself": (sphere(0.8), sphere(0.8), (0, 1, 1), 0),
    "a square above": (square(), square(up=0.02), (0.02, 0, 1), 0),
    "a square that looks down": (square(), square(faces=((2, 1, 0), (3, 2, 0))), (0, 1, 1), 0),
    "a part of a square": (square(), square(width=0.8), (0.01, 1.62 / 1.81, 1), STRIP),
}


@pytest.mark.parametrize("case", CASES)
def test_scores_are_those_of_closed_forms(case):
    true, made, (chamfer, share, cosine), deviation = CASES[case]
    scores = surface_scores(true, made, np.random.default_rng(1))
    error = 5 / (2 * SAMPLED) ** 0.5  # of a mean, in deviations of one value
    assert scores["chamfer"] == pytest.approx(chamfer, 1e-3, error * deviation + 5e-5)
    of_share = error * (share * (1 - share)) ** 0.5
    assert scores["f-score"] == pytest.approx(share, abs=of_share + 3e-4)
    assert scores["normal-consistency"] == pytest.approx(cosine, abs=1e-3)


def test_a_mesh_without_faces_is_refused():
    with pytest.raises(BadInput, match="no usable face"):
        surface_scores(square(), square(faces=()), np.random.default_rng(0))
