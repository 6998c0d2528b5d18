"""Images of a mesh by the faster of two renderers: OpenGL for few faces, rays for many.

True images, and images of `true-mesh`, are always rendered by `data_prep.rendering.opengl`. A
change here or in `data_prep.rendering.raycast` that changes a pixel raises the versions of the
reconstruction methods.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from data_prep.rendering.images import to_float
from data_prep.rendering.opengl import render
from data_prep.rendering.raycast import cast
from data_prep.scene import IMAGE_SIZE, AnyView, Mesh, in_one_colour

# The number of faces from which on rays are cast. For 20 views both renderers take the same time at
# some 7,000 faces; with this many, rays took less time for every mesh that was measured (`python -m
# studies.ray_speed` at commit 6e4975d).
RAYS_FROM_FACES = 10_000


def draw_mesh(mesh: Mesh, views: Sequence[AnyView], size: int = IMAGE_SIZE) -> NDArray[np.uint8]:
    """Render a mesh by rays or by OpenGL, with the same camera, samples and shading.

    Parameters
    ----------
    mesh : Mesh
        Mesh in unit-sphere coordinates; one without faces gives white images.
    views : sequence of View or Camera
        V camera positions.
    size : int
        Width and height of the images in pixels.

    Returns
    -------
    uint8 array [V, size, size, 3]
        Images on a white background.

    Raises
    ------
    ValueError
        If a vertex is not finite.
    MissingDependency
        If the renderer is not installed.
    """
    # The renderer is chosen by the number of faces and not by measured time, as an image must not
    # depend on the speed of the machine.
    draw = cast if len(mesh.faces) >= RAYS_FROM_FACES else render
    return draw(mesh, views, size=size)


def mesh_coverage(
    mesh: Mesh,
    views: Sequence[AnyView],
    size: int = IMAGE_SIZE,
    *,
    by: Callable[[Mesh, Sequence[AnyView], int], NDArray[np.uint8]] = draw_mesh,
) -> NDArray[np.float32]:
    """Return which share of each pixel of an image the mesh covers, float32 [V, size, size].

    by  what draws the image, `draw_mesh` or `data_prep.rendering.opengl.render`

    Raises as `draw_mesh` does.
    """
    # A pixel of the mesh in black is as dark as the mesh covers it. It has the same samples as the
    # image, as the same renderer draws it.
    black = by(in_one_colour(mesh, (0, 0, 0)), views, size)
    return 1 - to_float(black[..., 0])
