"""The images of `data_prep.render` by ray casting: without OpenGL, with no code in common.

The same camera and the same shading, but every sample of a pixel is a ray of its own through
Embree. For checks; needs `pip install embreex` (2 MB, Embree itself 43 MB), which nothing else in
this project does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.camera import FOCAL_PX, camera_to_world
from data_prep.failures import MissingDependency
from data_prep.scene import IMAGE_SIZE, Mesh, View

GAMMA = 2.2
# Where OpenGL takes the 4 samples of a pixel, as (column, row from the top): the standard pattern
# of hardware and of Mesa's llvmpipe (lp_sample_pos_4x), which OpenGL counts from below.
OPENGL = ((0.375, 0.875), (0.875, 0.625), (0.125, 0.375), (0.625, 0.125))
# Its mirror image: 4 samples as good as those, but elsewhere.
MIRRORED = tuple((column, 1 - row) for column, row in OPENGL)


def grid(side: int) -> tuple[tuple[float, float], ...]:
    """The centres (column, row) of side x side equal squares in a pixel."""
    places = [(i + 0.5) / side for i in range(side)]
    return tuple((column, row) for row in places for column in places)


def cast(mesh: Mesh, views: Sequence[View], samples: ArrayLike) -> NDArray[np.uint8]:
    """Images of `mesh` from `views`: uint8 [V, IMAGE_SIZE, IMAGE_SIZE, 3], white background.

    samples  [S, (column, row)] within a pixel, 0..1 from its upper left corner

    A pixel is the mean of its samples, each with the colour of the first facet that its ray meets:
    the facet's own colour times cos(t)^(1/2.2), t between the facet's normal and the axis of view,
    from either side. The mean is taken of sRGB values, as OpenGL does where the frame buffer is not
    declared to be sRGB. A facet without area is met by no ray; an empty mesh gives white images.

    Raises MissingDependency where embreex is not installed.
    """
    images = np.full((len(views), IMAGE_SIZE, IMAGE_SIZE, 3), 255, dtype=np.uint8)
    if len(mesh.faces) == 0:
        return images
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ModuleNotFoundError as error:
        raise MissingDependency(
            "casting rays needs the package embreex: run 'pip install embreex'"
        ) from error
    corners = mesh.vertices[mesh.faces]  # [F, 3, 3]
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(corners))
    edges = corners[:, 1:].astype(np.float64) - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    local = _rays(np.asarray(samples, dtype=np.float64))
    for image, view in zip(images, views, strict=True):
        pose = camera_to_world(view)
        rays = (local @ pose[:3, :3].T).astype(np.float32)
        start = np.tile(pose[:3, 3].astype(np.float32), (len(rays), 1))
        met = scene.run(start, rays)  # facet, -1 for none
        colours = np.full((len(mesh.faces) + 1, 3), 255.0)  # the last one is the background
        colours[:-1] = mesh.face_colors * np.abs(normals @ pose[:3, 2])[:, None] ** (1 / GAMMA)
        sampled = colours[met].reshape(IMAGE_SIZE, IMAGE_SIZE, -1, 3)
        image[:] = np.floor(sampled.mean(axis=2) + 0.5)
    return images


def _rays(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions [H * W * S, 3] in the camera's coordinates: +X right, +Y up, it looks along -Z."""
    corner = np.arange(IMAGE_SIZE) - IMAGE_SIZE / 2
    column, row = np.broadcast_arrays(
        corner[None, :, None] + samples[:, 0], corner[:, None, None] + samples[:, 1]
    )
    return np.stack([column, -row, np.full_like(row, -FOCAL_PX)], axis=-1).reshape(-1, 3) / FOCAL_PX
