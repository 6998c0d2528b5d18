"""Meshes and clouds of any size brought to the unit sphere (see `data_prep.scene`)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_prep.failures import BadInput
from data_prep.scene import Mesh, PointCloud

NEAR = 16  # times the radius of a mesh: so close to the origin float32 has digits enough


def normalise(mesh: Mesh, unrounded: NDArray[np.float64] | None = None) -> Mesh:
    """Centre a mesh in any units and scale it to the unit sphere; return it with faces and colours.

    Afterwards the bounding box of the vertices that faces use is centred at the origin, and the
    farthest of these vertices lies at radius 1 (float64 arithmetic, rounded to float32 once).
    Vertices that no face uses move along but do not count. `unrounded` are the vertices float64
    [V, 3] before they were rounded to float32, taken where the mesh is far from the origin: there
    neighbours would fall together. Raises BadInput if the mesh has no faces, a vertex is not
    finite, or all used vertices coincide.
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
    rows = np.unique(mesh.faces)
    if unrounded is not None:
        centre, radius = _sphere(unrounded[rows])
        # Nearer meshes stay bit for bit what they were, and results under their keys theirs.
        vertices = unrounded if np.abs(centre).max() > NEAR * radius else vertices
    used = vertices[rows]
    centre, radius = _sphere(used)
    if radius == 0.0:
        raise BadInput(
            f"all {len(used)} vertices used by faces are equal, at {used[0].tolist()}; "
            "a shape needs an extent"
        )
    scaled = ((vertices - centre) / radius).astype(np.float32)
    return Mesh(scaled, mesh.faces, mesh.face_colors)


def _sphere(used: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the centre [3] of the bounding box and the distance of the farthest vertex from it."""
    centre = (used.min(axis=0) + used.max(axis=0)) / 2
    return centre, np.sqrt(((used - centre) ** 2).sum(axis=1).max())


def numbers_in(values: ArrayLike) -> NDArray[Any]:
    """Return an array of what has numbers: an array, a tensor or a DataFrame.

    A missing value of a DataFrame becomes NaN.
    """
    given = cast("Any", values)
    if hasattr(given, "is_floating_point"):  # a tensor, of which NumPy takes only some
        tensor = given.detach().cpu()
        return np.asarray(tensor.double() if tensor.is_floating_point() else tensor)
    array = np.asarray(given)
    dtypes: Any = getattr(given, "dtypes", ())  # of a DataFrame, or the one of a Series
    kinds = {dtype.kind for dtype in ([dtypes] if hasattr(dtypes, "kind") else dtypes)}
    if array.dtype == object and kinds and kinds <= {*"fiu"}:
        # NumPy makes Python objects of columns of pandas that may lack values.
        if kinds <= {*"iu"} and not np.any(given.isna()):
            return given.to_numpy(np.int64)
        return given.to_numpy(np.float64, na_value=np.nan)
    return array


def unmasked_rows(points: ArrayLike) -> NDArray[np.intp] | None:
    """Return the rows of a masked array [N, C] without masked values; None where none has any."""
    if not isinstance(points, np.ma.MaskedArray) or points.ndim != 2 or not points.mask.any():
        return None
    return np.flatnonzero(~np.ma.getmaskarray(points).any(axis=1))


def real_points(points: ArrayLike) -> NDArray[np.float64]:
    """Return points as float64 [N, 3], with a warning without the rows that have masked values.

    Raises ValueError where they are no real numbers [N, 3].
    """
    kept = unmasked_rows(points)
    given = numbers_in(points)
    if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "fiu":
        raise ValueError(f"points: expected real numbers [N, 3], got {given.dtype} {given.shape}")
    if kept is not None:
        count = f"{len(given) - len(kept)} of {len(given)} points"
        warnings.warn(f"{count} are masked, and left out", stacklevel=2)
        given = given[kept]
    return given.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Placement:
    """The sphere that `normalise_points` brings to the unit sphere.

    centre  float64 [3], in the units of the points
    radius  in the same units
    """

    centre: NDArray[np.float64]
    radius: float

    def restored(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Return points [N, 3] of the unit sphere where they were."""
        return self.centre + self.radius * points.astype(np.float64)


def normalise_points(points: NDArray[Any]) -> PointCloud:
    """Centre points and scale them to the unit sphere.

    Afterwards the bounding box is centred at the origin and the farthest point lies at radius 1
    (float64 arithmetic, rounded to float32 once). Works at any scale and far from the origin, as
    long as float64 distinguishes the points.

    Parameters
    ----------
    points : array [N, 3]
        Real numbers in any units.

    Returns
    -------
    PointCloud
        Cloud in the unit sphere, without source.

    Raises
    ------
    ValueError
        If the points are no real numbers of shape [N, 3].
    BadInput
        If the cloud is empty, a point is not finite, or all points are equal.
    """
    return placed_points(points)[0]


def placed_points(points: NDArray[Any]) -> tuple[PointCloud, Placement]:
    """Return the cloud as `normalise_points` does, and where its unit sphere lay."""
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
    enlarged = max(0, -_exponent(values))
    values = np.ldexp(values, enlarged)
    first = _centre(values)
    centred = values - first
    if not centred.any():
        raise BadInput(
            f"all {len(points)} points are equal, at {points[0].tolist()}; a cloud needs an extent"
        )
    reduced = _exponent(centred)
    centred = np.ldexp(centred, -reduced)
    centred -= _centre(centred)
    radius = np.sqrt((centred**2).sum(axis=1).max())
    place = Placement(np.ldexp(first, -enlarged), float(np.ldexp(radius, reduced - enlarged)))
    return PointCloud((centred / radius).astype(np.float32)), place


def _centre(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the centre [3] of the bounding box."""
    # Halved first, so that nothing overflows.
    return values.min(axis=0) / 2 + values.max(axis=0) / 2


def _exponent(values: NDArray[np.float64]) -> int:
    """Return e such that the largest magnitude is in 2**(e - 1) ... 2**e; 0 for zeros."""
    return int(np.frexp(np.abs(values).max())[1])
