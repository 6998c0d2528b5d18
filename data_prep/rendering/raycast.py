"""Images of meshes by ray casting (Embree), like those of `data_prep.rendering.opengl`.

The camera, the samples and the shading are those of `data_prep.rendering.opengl`; no drawing code
is shared. OpenGL's time grows with the number of faces of each view; here a tree over the faces is
built once a mesh, and the time of a view depends on its pixels (`studies.ray_speed` at commit
6e4975d).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.failures import MissingDependency
from data_prep.rendering.camera import FOCAL_PX, camera_to_world, project
from data_prep.rendering.opengl import FAR, NEAR
from data_prep.scene import IMAGE_SIZE, Mesh, View

GAMMA = 2.2
WHITE = 255
BOX_VERTICES = 128
ALL = slice(None)
# Where OpenGL takes the 4 samples of a pixel, as (column, row from the top): the standard pattern
# of hardware and of Mesa's llvmpipe (lp_sample_pos_4x), which OpenGL counts from below.
OPENGL = ((0.375, 0.875), (0.875, 0.625), (0.125, 0.375), (0.625, 0.125))


def cast(
    mesh: Mesh, views: Sequence[View], samples: ArrayLike = OPENGL, size: int = IMAGE_SIZE
) -> NDArray[np.uint8]:
    """Return images of a mesh, uint8 [V, size, size, 3], on a white background.

    samples  [S, (column, row)] within a pixel, 0..1 from its upper left corner

    A pixel is the mean of its samples, each with the colour of the first facet that its ray meets:
    the facet's own colour times cos(t)^(1/2.2), t between the facet's normal and the axis of view,
    from either side. Samples have 8 bits and the mean is rounded half up, as in llvmpipe: of four
    ways to round this one gives the fewest pixels that differ. The mean is taken of sRGB values, as
    OpenGL does where the frame buffer is not declared to be sRGB. Parts nearer than NEAR or farther
    than FAR are not seen, nor facets without area; an empty mesh gives white images.
    The same mesh and views give the same bytes in any process, for any number of threads.

    Raises ValueError for non-finite vertices, MissingDependency where embreex is not installed.
    """
    if not np.isfinite(mesh.vertices).all():
        raise ValueError("cast: the mesh has non-finite vertices")
    images = np.full((len(views), size, size, 3), WHITE, dtype=np.uint8)
    if len(mesh.faces) == 0 or len(views) == 0:
        return images
    scene = _scene(mesh)
    corners = _corners(mesh.vertices)
    rays = _rays(np.asarray(samples, dtype=np.float64), size)
    for image, view in zip(images, views, strict=True):
        pose = camera_to_world(view)
        window = _window(corners, view, size)
        start, rows, columns = (NEAR, ALL, ALL) if window is None else (0.0, *window)
        local = rays[rows, columns]
        if local.size:
            image[rows, columns] = _pixels(scene, mesh.face_colors, local, pose, start)
    return images


@lru_cache(maxsize=1)
def _scene(mesh: Mesh) -> Any:
    """Return Embree's scene of a mesh; the first call of its `run` builds a tree of the faces.

    The last scene is kept, since views of a mesh may come in several calls.
    """
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ModuleNotFoundError as error:
        raise MissingDependency(
            "casting rays needs the package embreex: run 'pip install embreex'"
        ) from error
    scene = EmbreeScene(robust=False)  # its default is True
    TriangleMesh(scene, mesh.vertices, mesh.faces)
    return scene


def _rays(samples: NDArray[np.float64], size: int) -> NDArray[np.float32]:
    """Return directions [row, column, S, 3] of depth 1 in camera coordinates (+X right, +Y up)."""
    corner = np.arange(size)[:, None] - size / 2
    column, row = np.broadcast_arrays(corner + samples[:, 0], (corner + samples[:, 1])[:, None])
    focal = FOCAL_PX * size / IMAGE_SIZE
    return np.stack([column / focal, -row / focal, -np.ones_like(row)], -1, dtype=np.float32)


def _corners(vertices: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the corners [N, 3] of boxes around each run of BOX_VERTICES vertices [V, 3].

    Vertices that follow each other mostly lie close together. Where they do not, the boxes are
    large, and some rays are cast in vain.
    """
    runs = np.arange(0, len(vertices), BOX_VERTICES)
    ends = [bound.reduceat(vertices, runs).T for bound in (np.minimum, np.maximum)]
    x, y, z = np.array(ends, dtype=np.float64).transpose(1, 0, 2)
    corners = np.broadcast_arrays(x[:, None, None], y[None, :, None], z[None, None])
    return np.stack(corners, -1).reshape(-1, 3)


def _window(corners: NDArray[np.float64], view: View, size: int) -> tuple[slice, slice] | None:
    """Return the rows and columns of the box of pixels around corners [N, 3], within the image.

    None means that a corner is nearer than NEAR: points behind the camera have no pixels.
    """
    pixels, depth = project(corners, view)
    if depth.min() < NEAR:
        return None
    columns, rows = pixels.T * (size / IMAGE_SIZE)
    return _span(rows, size), _span(columns, size)


def _span(places: NDArray[np.float64], size: int) -> slice:
    """Return the range of whole pixels that coordinates lie in, within the image."""
    # Directions of rays have 32 bits: rounding moves one by less than 1e-4 px.
    first, last = np.floor(places.min() - 0.01), np.ceil(places.max() + 0.01)
    low, high = np.clip([first, last], 0, size)
    return slice(int(low), int(high))


def _pixels(
    scene: Any,
    face_colors: NDArray[np.uint8],
    local: NDArray[np.float32],
    pose: NDArray[np.float64],
    start: float,
) -> NDArray[np.float64]:
    """Return the pixels [R, C, 3] of rays [R, C, S, 3] that begin at a depth, in whole numbers."""
    turn, eye = pose[:3, :3].astype(np.float32), pose[:3, 3].astype(np.float32)
    directions = local.reshape(-1, 3) @ turn.T
    starts = np.broadcast_to(eye, directions.shape)
    if start:
        starts = starts + np.float32(start) * directions
    met = scene.run(starts, directions, dists=FAR - start, output=True)
    hits = np.flatnonzero(met["primID"] >= 0)
    colors = face_colors.take(met["primID"].take(hits), axis=0)
    shades = _shades(met["Ng"].take(hits, axis=0), pose[:3, 2])
    darkness = WHITE - np.floor(colors * shades[:, None] + np.float32(0.5))
    height, width, samples, _ = local.shape
    total = [np.bincount(hits // samples, channel, height * width) for channel in darkness.T]
    return np.floor(WHITE + 0.5 - np.stack(total, -1) / samples).reshape(height, width, 3)


def _shades(normals: NDArray[np.float32], axis: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the factors of the colours of facets, from normals [N, 3] of any length but 0."""
    exact = normals.astype(np.float64)  # 32 bits may not hold the square of a length
    cosines = np.abs(exact @ axis) / np.sqrt(np.einsum("ij,ij->i", exact, exact))
    return cosines.astype(np.float32) ** np.float32(1 / GAMMA)
