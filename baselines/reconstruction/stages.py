"""What all reconstructions share: checks between the stages, and the type of their result."""

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

SPACING_NEIGHBOURS = 16


@dataclass(frozen=True)
class Reconstruction:
    """A reconstructed mesh with finite vertices, and what was repaired on the way."""

    mesh: Mesh
    notes: tuple[str, ...]


class DrawsReconstruction:
    """The second half of every method whose `prepare` gives a Reconstruction."""

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
    """Raises StageFailure("input", ...) below `least` points, which `what` needs, and where one of
    points [N, 3] is not finite."""
    if len(points) < least:
        raise StageFailure("input", f"{len(points)} points; {what} need at least {least}")
    check_finite(points)


def check_finite(points: Points) -> None:
    """Raises StageFailure("input", ...) where one of points [N, 3] is not finite."""
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise StageFailure("input", f"{bad} of {len(points)} points are not finite")


def run(stage: str, step: Callable[[], None]) -> None:
    """Take a step of MeshLab. Raises StageFailure(stage, ...) where it refuses."""
    try:
        step()
    except RuntimeError as error:
        raise StageFailure(stage, str(error)) from error


def finite_part(stage: str, mesh: Mesh) -> Reconstruction:
    """`mesh` without the faces that have a vertex that is not finite; their number is noted.

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
    """The faces of `mesh` where `keep` [F] holds; on `vertices` [V, 3], if these are given."""
    vertices = mesh.vertices if vertices is None else vertices
    return Mesh(vertices, mesh.faces[keep], mesh.face_colors[keep])


def in_grey(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Mesh:
    """A mesh of vertices [V, 3] and faces [F, 3] in neutral grey."""
    colors = np.tile(np.array(NEUTRAL_GREY, np.uint8), (len(faces), 1))
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), colors)


def spacing(points: Points) -> float:
    """How far apart points [N, 3] lie, N > 0: half the distance to the 16th nearest (itself
    counted), as for an even sample of a plane; here the median over the cloud."""
    distances, _ = cKDTree(points).query(points, k=[min(SPACING_NEIGHBOURS, len(points))])
    return float(np.median(distances)) / 2
