"""Images of a mesh by the faster of two renderers: OpenGL for few faces, rays for many.

The number of faces alone decides, so that an image never depends on the machine's speed. True
images, and those of `true-mesh`, are always OpenGL's (`data_prep.rendering.opengl.render`). A
change here or in `data_prep.rendering.raycast` that changes a pixel raises the versions of the
methods that reconstruct.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data_prep.rendering.opengl import render
from data_prep.rendering.raycast import cast
from data_prep.scene import IMAGE_SIZE, Mesh, View

# For 20 views both take the same time at some 7,000 faces; from here on rays took less for every
# mesh (`python -m studies.ray_speed` at commit 6e4975d).
RAYS_FROM_FACES = 10_000


def draw_mesh(mesh: Mesh, views: Sequence[View], size: int = IMAGE_SIZE) -> NDArray[np.uint8]:
    """Images of `mesh` from `views`: uint8 [V, size, size, 3], white background.

    By rays from RAYS_FROM_FACES faces on, else by OpenGL, with the same camera, samples and
    shading. An empty mesh gives white images.

    Raises ValueError for non-finite vertices, MissingDependency where the renderer is missing.
    """
    draw = cast if len(mesh.faces) >= RAYS_FROM_FACES else render
    return draw(mesh, views, size=size)
