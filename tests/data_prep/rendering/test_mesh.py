"""The number of faces, and nothing else, chooses the renderer."""

from __future__ import annotations

import numpy as np
import pytest

from data_prep.rendering.mesh import RAYS_FROM_FACES, draw_mesh
from data_prep.rendering.opengl import render
from data_prep.rendering.raycast import cast
from data_prep.scene import Mesh, View

VIEWS = (View(20, 10), View(-100, -30))


def soup(faces: int) -> Mesh:
    """Small facets on a sphere."""
    rng = np.random.default_rng(faces)
    middles = rng.normal(size=(faces, 1, 3))
    middles /= np.linalg.norm(middles, axis=2, keepdims=True)
    corners = 0.9 * middles + rng.normal(scale=0.02, size=(faces, 3, 3))
    places = np.arange(3 * faces).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), places, np.full((faces, 3), 150, np.uint8))


@pytest.mark.parametrize(
    ("faces", "expected"), [(RAYS_FROM_FACES - 1, render), (RAYS_FROM_FACES, cast)]
)
def test_rays_from_the_measured_number_of_faces_on(faces, expected):
    mesh = soup(faces)
    images = draw_mesh(mesh, VIEWS)
    np.testing.assert_array_equal(images, expected(mesh, VIEWS), strict=True)
    other = cast if expected is render else render
    assert (other(mesh, VIEWS) != images).any()  # or the test would see no difference
