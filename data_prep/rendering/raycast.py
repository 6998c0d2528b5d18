"""Images of meshes by ray casting (Embree), like those of `data_prep.rendering.opengl`.

The camera, the samples and the shading are the same, but no drawing code is shared. OpenGL draws
all faces in each view, so that its time grows with their number. Here a tree over the faces is
built once for a mesh, and the time of a view depends on its pixels (`studies.ray_speed` at commit
6e4975d).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.failures import MissingDependency
from data_prep.rendering.camera import (
    Lens,
    camera_to_world,
    depth_range,
    farthest_depth,
    lens_of,
    project,
)
from data_prep.scene import IMAGE_SIZE, AnyView, Mesh

# The gamma of OpenGL's shader: a colour is multiplied by cos(t)^(1 / GAMMA), with the angle t
# between the normal and the axis of view.
GAMMA = 2.2
WHITE = 255
# The number of vertices that follow each other in a mesh and share a box. The boxes bound the part
# of an image in which the mesh can be.
_BOX_VERTICES = 128
_MOST_RAYS = 2**19  # the most rays that are cast together, which bounds memory
ALL = slice(None)
# Of the distance to the camera: how much nearer a face has to be to hide a point. It is a hundred
# times the rounding of float32, for rays that graze a face, and 4e-5 radii of the unit sphere.
_TOUCHING = 1e-5
# Where OpenGL takes the 4 samples of a pixel, as (column, row from the top): the standard pattern
# of hardware and of Mesa's llvmpipe (lp_sample_pos_4x), which OpenGL counts from below.
OPENGL = ((0.375, 0.875), (0.875, 0.625), (0.125, 0.375), (0.625, 0.125))
MAPS = ("coverage", "nearness", "normal x", "normal y", "normal z")  # planes of `surface_maps`
MOST_NEARNESS = 1.5  # the largest nearness in `surface_maps`: closer surfaces get this value


def cast(
    mesh: Mesh, views: Sequence[AnyView], samples: ArrayLike = OPENGL, size: int = IMAGE_SIZE
) -> NDArray[np.uint8]:
    """Return images of a mesh, uint8 [V, size, size, 3], on a white background.

    samples  [S, (column, row)] within a pixel, 0..1 from its upper left corner

    A pixel is the mean of its samples, each with the colour of the first facet that its ray meets:
    the facet's own colour times cos(t)^(1/2.2), t between the facet's normal and the axis of view,
    from either side. Samples have 8 bits and the mean is rounded half up, as in llvmpipe: of four
    ways to round this one gives the fewest pixels that differ. The mean is taken of sRGB values, as
    OpenGL does where the frame buffer is not declared to be sRGB. Parts outside of the view's
    `depth_range` are not seen, nor facets without area; an empty mesh gives white images.
    The same mesh and views give the same bytes in any process, for any number of threads.

    Raises ValueError for non-finite vertices, and MissingDependency without embreex.
    """
    images = np.full((len(views), size, size, 3), WHITE, dtype=np.uint8)
    for i, seen in _look(mesh, views, samples, size):
        colors = mesh.face_colors.take(seen.faces, axis=0)
        shades = _shades(seen.normals, camera_to_world(views[i])[:3, 2])
        darkness = WHITE - np.floor(colors * shades[:, None] + np.float32(0.5))
        images[i][seen.window] = np.floor(WHITE + 0.5 - seen.mean(darkness))
    return images


def surface_maps(
    mesh: Mesh, views: Sequence[AnyView], size: int = IMAGE_SIZE, *, limited: bool = True
) -> NDArray[np.float32]:
    """Return the planes MAPS of a mesh in images, float32 [V, 5, size, size].

    Camera and samples are those of `cast`. The planes are zero where no sample meets the mesh.

    coverage   share of a pixel's samples that meet the mesh
    nearness   mean over these of (farthest depth - depth) / 2, in 0..MOST_NEARNESS if `limited`
    normal     their mean normal in the camera's frame (+X right, +Y up, +Z to the camera); each is
               turned so that z, the cosine that shades, is not negative

    Raises ValueError for non-finite vertices, MissingDependency where embreex is not installed.
    """
    maps = np.zeros((len(views), len(MAPS), size, size), dtype=np.float32)
    for i, seen in _look(mesh, views, OPENGL, size):
        nearness = (farthest_depth(views[i]) - seen.depths.astype(np.float64)) / 2
        if limited:
            nearness = nearness.clip(0, MOST_NEARNESS)
        normals = _unit(seen.normals) @ camera_to_world(views[i])[:3, :3]
        normals[normals[:, 2] < 0] *= -1
        covered = seen.mean(np.ones((len(normals), 1)))
        sums = seen.mean(np.column_stack([nearness, normals]))
        means = np.divide(sums, covered, out=np.zeros_like(sums), where=covered > 0)
        planes = np.concatenate([covered, means], axis=-1)
        maps[i][:, *seen.window] = planes.transpose(2, 0, 1)
    return maps


def sees(
    mesh: Mesh, view: AnyView, points: NDArray[np.float64], faces: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return which points [N, 3] of a mesh the camera of a view sees, bool [N].

    faces  the face that each point lies on, [N]

    A point is seen where no other face lies between it and the camera. Faces that are as near as
    float32 can tell hide nothing: those that meet at an edge, and those that coincide.
    """
    eye = camera_to_world(view)[:3, 3]
    directions = (points - eye).astype(np.float32)
    starts = np.broadcast_to(eye.astype(np.float32), directions.shape)
    # A ray is at its point at distance 1, in lengths of its direction.
    met = _scene(mesh).run(starts, directions, dists=1 - _TOUCHING, output=True)["primID"]
    return (met < 0) | (met == faces)


@dataclass(frozen=True, eq=False)
class _Hits:
    """The H samples of an image that meet the mesh.

    window   the rows and columns of the image in which rays were cast
    shape    the number of rows and of columns of the window, and of samples in a pixel
    pixels   for each sample the number of its pixel in the window, [H]
    faces    the face that each sample meets, [H]
    normals  the normals of these faces, of any length but 0 and of either sign, [H, 3]
    depths   the depths of these points along the axis of view, [H]
    """

    window: tuple[slice, slice]
    shape: tuple[int, int, int]
    pixels: NDArray[np.int64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float32]
    depths: NDArray[np.float32]

    def mean(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Return the means of values [H, C] in each pixel of the window, [rows, columns, C].

        Samples that do not meet the mesh count as 0.
        """
        height, width, samples = self.shape
        total = [np.bincount(self.pixels, plane, height * width) for plane in values.T]
        return (np.stack(total, -1) / samples).reshape(height, width, -1)


def _look(
    mesh: Mesh, views: Sequence[AnyView], samples: ArrayLike, size: int
) -> Iterator[tuple[int, _Hits]]:
    """Yield, for each view and each band of rows, the number of the view and its hits.

    Raises ValueError for non-finite vertices, MissingDependency where embreex is not installed.
    """
    if not np.isfinite(mesh.vertices).all():
        raise ValueError("cast: the mesh has non-finite vertices")
    if len(mesh.faces) == 0 or len(views) == 0:
        return
    scene = _scene(mesh)
    corners = _corners(mesh.vertices)
    exact = np.asarray(samples, dtype=np.float64)
    lens = lens_of(views[0])
    rays = _rays(exact, size, lens)
    for i, view in enumerate(views):
        if lens_of(view) != lens:  # mostly all views have the same
            lens = lens_of(view)
            rays = _rays(exact, size, lens)
        near, far = depth_range(view)
        window = _window(corners, view, size)
        start, rows, columns = (near, ALL, ALL) if window is None else (0.0, *window)
        first, last, _ = rows.indices(size)
        step = max(1, _MOST_RAYS // (size * rays.shape[2]))
        for low in range(first, last, step):
            band = slice(low, min(low + step, last))
            local = rays[band, columns]
            if local.size:
                pose = camera_to_world(view)
                yield i, _hits(scene, local, pose, (start, far), (band, columns))


@lru_cache(maxsize=2)
def _scene(mesh: Mesh) -> Any:
    """Return Embree's scene of a mesh; the first call of its `run` builds a tree of the faces.

    The last two scenes are kept, as the views of a mesh may be asked for in several calls, and
    those of two meshes by turns.
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


def _rays(samples: NDArray[np.float64], size: int, lens: Lens) -> NDArray[np.float32]:
    """Return directions [row, column, S, 3] of depth 1 in camera coordinates (+X right, +Y up)."""
    zoom = size / IMAGE_SIZE
    across, down = (np.arange(size)[:, None] - zoom * middle for middle in lens.centre)
    column, row = np.broadcast_arrays(across + samples[:, 0], (down + samples[:, 1])[:, None])
    x, y = column / (zoom * lens.focal[0]), -row / (zoom * lens.focal[1])
    return np.stack([x, y, -np.ones_like(row)], -1, dtype=np.float32)


def _corners(vertices: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the corners [N, 3] of boxes around each run of _BOX_VERTICES vertices [V, 3].

    Vertices that follow each other mostly lie close together. Where they do not, the boxes are
    large, and some rays are cast in vain.
    """
    runs = np.arange(0, len(vertices), _BOX_VERTICES)
    ends = [bound.reduceat(vertices, runs).T for bound in (np.minimum, np.maximum)]
    x, y, z = np.array(ends, dtype=np.float64).transpose(1, 0, 2)
    corners = np.broadcast_arrays(x[:, None, None], y[None, :, None], z[None, None])
    return np.stack(corners, -1).reshape(-1, 3)


def _window(corners: NDArray[np.float64], view: AnyView, size: int) -> tuple[slice, slice] | None:
    """Return the rows and columns of the box of pixels around corners [N, 3], within the image.

    None means that a corner is too near to be drawn: points behind the camera have no pixels.
    """
    pixels, depth = project(corners, view)
    if depth.min() < depth_range(view)[0]:
        return None
    columns, rows = pixels.T * (size / IMAGE_SIZE)
    return _span(rows, size), _span(columns, size)


def _span(coordinates: NDArray[np.float64], size: int) -> slice:
    """Return the range of whole pixels that coordinates lie in, within the image."""
    # A margin, as the directions of rays are float32, whose rounding moves one by up to 1e-4 px.
    first, last = np.floor(coordinates.min() - 0.01), np.ceil(coordinates.max() + 0.01)
    low, high = np.clip([first, last], 0, size)
    return slice(int(low), int(high))


def _hits(
    scene: Any,
    local: NDArray[np.float32],
    pose: NDArray[np.float64],
    depths: tuple[float, float],
    window: tuple[slice, slice],
) -> _Hits:
    """Cast the rays [R, C, S, 3] of a window between two depths; return the hits."""
    start, far = depths
    turn, eye = pose[:3, :3].astype(np.float32), pose[:3, 3].astype(np.float32)
    directions = local.reshape(-1, 3) @ turn.T
    starts = np.broadcast_to(eye, directions.shape)
    if start:
        starts = starts + np.float32(start) * directions
    met = scene.run(starts, directions, dists=far - start, output=True)
    hits = np.flatnonzero(met["primID"] >= 0)
    height, width, samples, _ = local.shape
    return _Hits(
        window,
        (height, width, samples),
        hits // samples,
        met["primID"].take(hits),
        met["Ng"].take(hits, axis=0),
        met["tfar"].take(hits) + np.float32(start),
    )


def _shades(normals: NDArray[np.float32], axis: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the factors of the colours of facets, from normals [N, 3] of any length but 0."""
    exact = normals.astype(np.float64)
    cosines = np.abs(exact @ axis) / _lengths(exact)
    return cosines.astype(np.float32) ** np.float32(1 / GAMMA)


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float64]:
    exact = normals.astype(np.float64)
    return exact / _lengths(exact)[:, None]


def _lengths(exact: NDArray[np.float64]) -> NDArray[np.float64]:
    # Takes float64, as the square of a length may exceed the range of float32.
    return np.sqrt(np.einsum("ij,ij->i", exact, exact))
