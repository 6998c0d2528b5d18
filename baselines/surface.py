"""Surface reconstruction and rendering: the paper's SR.

Normals (k = 10) -> ball pivoting -> close holes (30 edges) -> marching cubes on the algebraic point
set surface (APSS, resolution 200) -> the project's mesh renderer, in neutral grey. Source: paper,
section 1, and the filter script of roatienza/pc2pix@23b7b46d. The script's first two filters turn
the object by 90 degrees about Y and Z for Blender's axes; our clouds have our axes, so they are
left out (a grid of cubes is mapped onto itself by such a turn).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.meshlab import MeshLab
from data_prep.failures import StageFailure
from data_prep.images import to_float
from data_prep.mesh_files import NEUTRAL_GREY
from data_prep.render import render
from data_prep.scene import Images, Mesh, PointCloud, View

NORMAL_NEIGHBOURS = 10
MAX_HOLE_EDGES = 30


@dataclass(frozen=True)
class Reconstruction:
    """A reconstructed mesh with finite vertices, and what had to be mended on the way."""

    mesh: Mesh
    notes: tuple[str, ...]


@dataclass(frozen=True)
class SurfaceApss:
    """The paper's chain. `resolution` is the number of grid cells a side."""

    resolution: int = 200

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness.

        APSS leaves non-finite vertices in a fair share of its meshes (15 of 107 real objects); as
        in any viewer, their faces are not drawn. Their number is noted.

        Raises StageFailure naming the stage that handed on nothing usable: `input` (fewer points
        than a normal needs, or a non-finite one), `normals`, `ball-pivoting`, `close-holes` or
        `apss`.
        """
        del rng
        points = cloud.points
        if len(points) <= NORMAL_NEIGHBOURS:
            raise StageFailure(
                "input", f"{len(points)} points; normals need at least {NORMAL_NEIGHBOURS + 1}"
            )
        bad = int((~np.isfinite(points)).any(axis=1).sum())
        if bad:
            raise StageFailure("input", f"{bad} of {len(points)} points are not finite")
        meshlab = MeshLab(points)
        _run("normals", meshlab.estimate_normals, NORMAL_NEIGHBOURS)
        if not np.isfinite(meshlab.normals()).all():
            raise StageFailure("normals", "a normal is not finite")
        _run("ball-pivoting", meshlab.ball_pivoting)
        if meshlab.face_count == 0:
            raise StageFailure("ball-pivoting", "no faces")
        _run("close-holes", meshlab.close_holes, MAX_HOLE_EDGES)
        if meshlab.face_count == 0:
            raise StageFailure("close-holes", "no faces")
        _run("apss", meshlab.marching_cubes_apss, self.resolution)
        if meshlab.face_count == 0:
            raise StageFailure("apss", "no faces")
        return _finite_part(meshlab.mesh(NEUTRAL_GREY))

    def draw(
        self,
        state: Reconstruction,
        views: Sequence[View],
        rng: np.random.Generator | None = None,
    ) -> Images:
        """Render the reconstructed mesh; no randomness."""
        del rng
        return to_float(render(state.mesh, views))


def _run(stage: str, step: object, *arguments: int) -> None:
    try:
        step(*arguments)  # type: ignore[operator]
    except RuntimeError as error:
        raise StageFailure(stage, str(error)) from error


def _finite_part(mesh: Mesh) -> Reconstruction:
    finite = np.all(np.isfinite(mesh.vertices), axis=1)
    if finite.all():
        return Reconstruction(mesh, ())
    keep = np.all(finite[mesh.faces], axis=1)
    if not keep.any():
        raise StageFailure("apss", "no face with finite vertices")
    kept = Mesh(
        np.where(finite[:, None], mesh.vertices, 0.0), mesh.faces[keep], mesh.face_colors[keep]
    )
    dropped = len(keep) - int(keep.sum())
    note = f"apss: {dropped} of {len(keep)} faces dropped, a vertex is not finite"
    return Reconstruction(kept, (note,) if dropped else ())
