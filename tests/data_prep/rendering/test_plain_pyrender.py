"""The renderer against pyrender's own, which draws the same bytes."""

from __future__ import annotations

import numpy as np
import pytest

from data_prep.clouds.sampling import random_views
from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, View

from .plain_pyrender import render_plainly

pytestmark = pytest.mark.opengl

RNG = np.random.default_rng(8)
VIEWS = (View(0, 0), View(180, 90), View(-90, -90), *random_views(9, RNG))


def soup(spread: float, colours: int) -> Mesh:
    """Facets that cross each other, partly without extent or out of the camera's range."""
    corners = RNG.normal(scale=spread, size=(300, 3))
    faces = RNG.integers(0, 300, (400, 3))
    return Mesh(corners, faces, RNG.integers(0, 256, (colours, 3))[np.arange(400) % colours])


@pytest.mark.parametrize(
    "mesh",
    [
        *(ProceduralObject("chair", "test", i).load() for i in range(3)),
        *(soup(spread, colours) for spread in (0.4, 1.0, 4.0) for colours in (1, 2, 400)),
    ],
    ids=lambda mesh: f"{len(mesh.faces)}-faces",
)
def test_bytes_are_those_of_pyrender(mesh):
    before = render(mesh, VIEWS)
    np.testing.assert_array_equal(before, render_plainly(mesh, VIEWS), strict=True)
    np.testing.assert_array_equal(render(mesh, VIEWS), before)  # the other context moves nothing
