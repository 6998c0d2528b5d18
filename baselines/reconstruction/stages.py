"""The parts that reconstructions share: the choice of points, checks between stages, the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_prep.arrays import Floats
from data_prep.clouds.sampling import at_most
from data_prep.clouds.sorting import different_points
from data_prep.failures import StageFailure
from data_prep.rendering.camera import CAMERA_DISTANCE, FOCAL_PX
from data_prep.rendering.images import to_float
from data_prep.rendering.mesh import draw_mesh, mesh_coverage
from data_prep.scene import IMAGE_SIZE, NEUTRAL_GREY, AnyView, Images, Mesh, PointCloud, Points

FOOTPRINT = CAMERA_DISTANCE / FOCAL_PX  # side of what a pixel shows at the origin, in scene units
_SPACING_NEIGHBOURS = 16  # a point's spacing is half the distance to the nearest of this number


@dataclass(frozen=True)
class Reconstruction:
    """A reconstructed mesh with finite vertices, and notes for the user about what was repaired."""

    mesh: Mesh
    notes: tuple[str, ...]


class DrawsReconstruction:
    """A base class of methods whose `prepare` returns a `Reconstruction`: it draws the mesh."""

    def draw(
        self,
        state: Reconstruction,
        views: Sequence[AnyView],
        rng: np.random.Generator | None = None,
        size: int = IMAGE_SIZE,
    ) -> Images:
        """Return images of the mesh, float32 [V, size, size, 3] in 0..1; `rng` is not used."""
        del rng
        return to_float(draw_mesh(state.mesh, views, size))

    def coverage(
        self, state: Reconstruction, views: Sequence[AnyView], size: int = IMAGE_SIZE
    ) -> NDArray[np.float32]:
        """Return the share of each pixel that the mesh covers, 0..1, [V, size, size]."""
        return mesh_coverage(state.mesh, views, size)


def check_points(points: Points, least: int, what: str) -> None:
    """Check that points [N, 3] are finite, and that N is at least `least`.

    what  what needs so many points, in the plural, for the message: "normals"

    Raises StageFailure("input", ...) otherwise.
    """
    if len(points) < least:
        raise StageFailure("input", f"{len(points)} points; {what} need at least {least}")
    check_finite(points)


def check_finite(points: Points) -> None:
    """Check that points [N, 3] are finite.

    Raises StageFailure("input", ...) otherwise.
    """
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise StageFailure("input", f"{bad} of {len(points)} points are not finite")


def in_sight(points: Points) -> Points:
    """Return those of points [N, 3] that lie nearer to the origin than the camera does, [M, 3]."""
    return points[np.linalg.norm(points.astype(np.float64), axis=1) < CAMERA_DISTANCE]


def used_points(
    cloud: PointCloud, least: int, most: int, what: str
) -> tuple[Points, tuple[str, ...]]:
    """Return the points [M, 3] of a cloud that a method uses, and notes about those left out.

    Points that are no nearer to the origin than the camera are left out, and of points that
    coincide all but one. The others are sorted by coordinates, so that the order of the points
    does not change the result.

    least  smallest number of points that the method can use
    most   largest number of points that it uses; of more a random subset is taken
    what   what needs `least` points, in the plural, for the message: "normals"

    Raises StageFailure("input", ...) where fewer than `least` points are left, and where a point is
    not finite.
    """
    check_points(cloud.points, least, what)
    seen = in_sight(cloud.points)
    different = different_points(seen)
    if len(different) < least:
        raise StageFailure(
            "input",
            f"{len(different)} of {len(cloud)} points are different and nearer than the camera; "
            f"{what} need at least {least}",
        )
    used, notes = at_most(most, different)
    return used, (*left_out(seen, cloud), *notes)


def left_out(seen: Points, cloud: PointCloud) -> tuple[str, ...]:
    """Return a note of how many points of the cloud are not seen; none where all are."""
    far = len(cloud) - len(seen)
    if far == 0:
        return ()
    return (f"input: {far} of {len(cloud)} points left out, they lie beyond the camera",)


def run(stage: str, step: Callable[[], None]) -> None:
    """Run a step of MeshLab; where MeshLab refuses, raise StageFailure(stage, ...)."""
    try:
        step()
    except RuntimeError as error:
        raise StageFailure(stage, str(error)) from error


def finite_part(stage: str, mesh: Mesh) -> Reconstruction:
    """Return `mesh` without faces that have a non-finite vertex, and a note of their number.

    Raises StageFailure(stage, ...) where no face is left.
    """
    finite = np.all(np.isfinite(mesh.vertices), axis=1)
    if finite.all():
        return Reconstruction(mesh, ())
    keep = np.all(finite[mesh.faces], axis=1)
    if not keep.any():
        raise StageFailure(stage, f"none of {len(keep)} faces has finite vertices")
    vertices = np.where(finite[:, None], mesh.vertices, 0.0)
    dropped = len(keep) - int(keep.sum())
    note = f"{stage}: {dropped} of {len(keep)} faces dropped, a vertex is not finite"
    return Reconstruction(kept_faces(mesh, keep, vertices), (note,) if dropped else ())


def kept_faces(mesh: Mesh, keep: NDArray[np.bool_], vertices: Points | None = None) -> Mesh:
    """Return a mesh of the faces for which `keep` [F] holds.

    vertices  [V, 3], in place of those of `mesh`; None for the same
    """
    vertices = mesh.vertices if vertices is None else vertices
    return Mesh(vertices, mesh.faces[keep], mesh.face_colors[keep])


def in_grey(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Mesh:
    """Return a mesh of vertices [V, 3] and faces [F, 3] in neutral grey."""
    colors = np.tile(np.array(NEUTRAL_GREY, np.uint8), (len(faces), 1))
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), colors)


class Nearest:
    """A search for the nearest neighbours of points [N, 3], N > 0, that remembers its result.

    Most of the time in which a cloud is prepared is this search. It is made again only where more
    neighbours are asked for than before.
    """

    def __init__(self, points: Points | Floats) -> None:
        self.points = points.astype(np.float64)
        self.tree = cKDTree(self.points)
        self._distance: Floats = np.zeros((len(points), 0))
        self._index: NDArray[np.intp] = np.zeros((len(points), 0), np.intp)

    def within(self, count: int) -> tuple[Floats, NDArray[np.intp]]:
        """Return the distances and indices [N, min(count, N)] of each point's nearest points.

        The first is the point itself.
        """
        count = min(count, len(self.points))
        if self._index.shape[1] < count:
            distance, index = self.tree.query(self.points, k=range(1, count + 1))
            self._distance, self._index = np.asarray(distance), np.asarray(index)
        return self._distance[:, :count], self._index[:, :count]


def spacing(near: Nearest) -> float:
    """Return the median spacing of points, an estimate of the distance between neighbours.

    The spacing of a point is half the distance to its 16th nearest (itself counted): in an even
    sample of a plane this is about the distance of neighbours.
    """
    distance, _ = near.within(_SPACING_NEIGHBOURS)
    return float(np.median(distance[:, -1])) / 2
