"""Any mesh or cloud to the unit sphere, where all shapes of the project live.

See `data_prep.scene` for what that is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.clouds.orientations import upright
from data_prep.failures import BadInput
from data_prep.scene import Mesh, PointCloud


def normalise(mesh: Mesh) -> Mesh:
    """The same faces and colours, centred and scaled to the unit sphere.

    Afterwards the bounding box of the vertices that faces use is centred at the origin, and the
    farthest of those vertices lies at radius 1 (float64 arithmetic, rounded to float32 once).
    Vertices that no face uses move along but do not count.

    Raises BadInput where there are no faces, where a vertex is not finite, and where all used
    vertices coincide.
    """
    if len(mesh.faces) == 0:
        raise BadInput("the mesh has no faces (0); give a surface, not a bare cloud of points")
    vertices = mesh.vertices.astype(np.float64)
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(broken):
        raise BadInput(
            f"the mesh has {len(broken)} non-finite vertices of {len(vertices)} "
            f"(the first is vertex {broken[0]}); repair or remove them"
        )
    used = vertices[np.unique(mesh.faces)]
    centre = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = np.sqrt(((used - centre) ** 2).sum(axis=1).max())
    if radius == 0.0:
        raise BadInput(
            f"all {len(used)} vertices used by faces are equal, at {used[0].tolist()}; "
            "a shape needs an extent"
        )
    scaled = ((vertices - centre) / radius).astype(np.float32)
    return Mesh(scaled, mesh.faces, mesh.face_colors)


def cloud_of_points(points: ArrayLike, up: str = "y", front: str | None = None) -> PointCloud:
    """Return real numbers [N, 3] in any units and axes as a cloud in the unit sphere.

    Raises ValueError for what is no array of such a shape, and BadInput as `upright` and
    `normalise_points`.
    """
    given = np.asarray(points)
    if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "fiu":
        raise ValueError(f"points: expected real numbers [N, 3], got {given.dtype} {given.shape}")
    return normalise_points(upright(given.astype(np.float64), up, front))


def normalise_points(points: NDArray[Any]) -> PointCloud:
    """Return real numbers [N, 3] in any units, centred and scaled to the unit sphere.

    Afterwards the bounding box is centred at the origin and the farthest point lies at radius 1
    (float64 arithmetic, rounded to float32 once). Works at any scale and far from the origin, as
    long as float64 distinguishes the points.

    Raises BadInput where there is no point, where one is not finite, and where all are equal.
    """
    if points.dtype.kind not in "fiu" or points.shape[1:] != (3,):
        raise ValueError(f"expected real numbers [N, 3], got {points.dtype} {list(points.shape)}")
    if len(points) == 0:
        raise BadInput("the cloud has no points (0); give at least two")
    with np.errstate(over="ignore", invalid="ignore"):  # not finite, and reported as such below
        values = points.astype(np.float64)
    broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(broken):
        raise BadInput(
            f"the cloud has {len(broken)} non-finite points of {len(values)} "
            f"(the first is point {broken[0]}); remove them"
        )
    # Powers of two, which round nothing: a tiny cloud is enlarged before its centre is taken, and
    # every cloud brought to the size of 1 before its coordinates are squared. Centred twice: far
    # from the origin the centre is rounded as coarsely as the points, but differences are exact.
    values = np.ldexp(values, max(0, -_exponent(values)))
    centred = values - _centre(values)
    if not centred.any():
        raise BadInput(
            f"all {len(points)} points are equal, at {points[0].tolist()}; a cloud needs an extent"
        )
    centred = np.ldexp(centred, -_exponent(centred))
    centred -= _centre(centred)
    radius = np.sqrt((centred**2).sum(axis=1).max())
    return PointCloud((centred / radius).astype(np.float32))


def _centre(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """[3], of the bounding box; halved first, so that nothing overflows."""
    return values.min(axis=0) / 2 + values.max(axis=0) / 2


def _exponent(values: NDArray[np.float64]) -> int:
    """e where the largest magnitude is in 2**(e - 1) ... 2**e; 0 where all values are 0."""
    return int(np.frexp(np.abs(values).max())[1])
