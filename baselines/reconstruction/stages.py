"""Checks between the stages of reconstructions, and the type of their result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_prep.failures import StageFailure
from data_prep.rendering.images import to_float
from data_prep.rendering.mesh import draw_mesh
from data_prep.scene import NEUTRAL_GREY, Images, Mesh, Points, View

_SPACING_NEIGHBOURS = 16


@dataclass(frozen=True)
class Reconstruction:
    """A reconstructed mesh with finite vertices, and notes of what was repaired."""

    mesh: Mesh
    notes: tuple[str, ...]


class DrawsReconstruction:
    """The drawing half of every method whose `prepare` gives a Reconstruction."""

    def draw(
        self,
        state: Reconstruction,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
    ) -> Images:
        """Render the reconstructed mesh; no randomness."""
        del rng
        return to_float(draw_mesh(state.mesh, views))


def check_points(points: Points, least: int, what: str) -> None:
    """Check that points [N, 3] are finite and at least `least`, which `what` needs.

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


def run(stage: str, step: Callable[[], None]) -> None:
    """Run one step of MeshLab, which is a stage of the method.

    Raises StageFailure(stage, ...) where MeshLab refuses.
    """
    try:
        step()
    except RuntimeError as error:
        raise StageFailure(stage, str(error)) from error


def finite_part(stage: str, mesh: Mesh) -> Reconstruction:
    """Return `mesh` without faces that have a non-finite vertex; their number is noted.

    Raises StageFailure(stage, ...) where no face is left.
    """
    finite = np.all(np.isfinite(mesh.vertices), axis=1)
    if finite.all():
        return Reconstruction(mesh, ())
    keep = np.all(finite[mesh.faces], axis=1)
    if not keep.any():
        raise StageFailure(stage, "no face with finite vertices")
    vertices = np.where(finite[:, None], mesh.vertices, 0.0)
    dropped = len(keep) - int(keep.sum())
    note = f"{stage}: {dropped} of {len(keep)} faces dropped, a vertex is not finite"
    return Reconstruction(kept_faces(mesh, keep, vertices), (note,) if dropped else ())


def kept_faces(mesh: Mesh, keep: NDArray[np.bool_], vertices: Points | None = None) -> Mesh:
    """Return the faces of `mesh` where `keep` [F] holds, on `vertices` [V, 3] if given."""
    vertices = mesh.vertices if vertices is None else vertices
    return Mesh(vertices, mesh.faces[keep], mesh.face_colors[keep])


def in_grey(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Mesh:
    """Return a mesh of vertices [V, 3] and faces [F, 3] in neutral grey."""
    colors = np.tile(np.array(NEUTRAL_GREY, np.uint8), (len(faces), 1))
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), colors)


def spacing(points: Points) -> float:
    """Return the median spacing of points [N, 3], N > 0.

    The spacing of a point is half the distance to the 16th nearest (itself counted), as for an even
    sample of a plane.
    """
    distances, _ = cKDTree(points).query(points, k=[min(_SPACING_NEIGHBOURS, len(points))])
    return float(np.median(distances)) / 2
