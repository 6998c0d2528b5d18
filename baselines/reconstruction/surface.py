"""Surface reconstruction and rendering: the paper's SR.

Normals (k = 10) -> ball pivoting -> close holes (30 edges) -> marching cubes on the algebraic point
set surface (APSS, resolution 200) -> the project's mesh renderer, in neutral grey. Source: paper,
section 1, and the filter script of roatienza/pc2pix@23b7b46d. The script's first two filters turn
the object by 90 degrees about Y and Z for Blender's axes; our clouds have our axes, so they are
left out (a grid of cubes is mapped onto itself by such a turn).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.reconstruction.meshlab import MeshLab
from baselines.reconstruction.stages import (
    DrawsReconstruction,
    Reconstruction,
    check_points,
    finite_part,
    run,
)
from data_prep.failures import StageFailure
from data_prep.scene import NEUTRAL_GREY, PointCloud, Points

NORMAL_NEIGHBOURS = 10
MAX_HOLE_EDGES = 30
RESOLUTION = 200


@dataclass(frozen=True)
class SurfaceApss(DrawsReconstruction):
    """The paper's chain, with `resolution` grid cells a side."""

    resolution: int = RESOLUTION

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness.

        APSS leaves non-finite vertices in a fair share of its meshes (15 of 107 real objects); as
        in any viewer, their faces are not drawn. Their number is noted.

        Raises StageFailure naming the stage that handed on nothing usable: `input` (fewer points
        than a normal needs, or a non-finite one), `normals`, `ball-pivoting`, `close-holes` or
        `apss`.
        """
        del rng
        meshlab = closed_surface(cloud.points)
        run("apss", lambda: meshlab.marching_cubes_apss(self.resolution))
        return reconstruction("apss", meshlab)


@dataclass(frozen=True)
class SurfaceBpa(DrawsReconstruction):
    """The chain without its last stage: ball pivoting (Bernardini et al. 1999) and closed holes.

    The radius is in percent of the diagonal of the cloud's box; None is MeshLab's choice, which
    grows as the points get fewer. No fixed radius does as well on validation chairs under the five
    conditions: mean SSIM 0.747, and 0.714 to 0.726 for 1.5 to 6 %.
    """

    radius_percent: float | None = None

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness.

        Raises StageFailure naming the stage that handed on nothing usable: `input` (fewer points
        than a normal needs, or a non-finite one), `normals`, `ball-pivoting` or `close-holes`.
        """
        del rng
        return reconstruction("close-holes", closed_surface(cloud.points, self.radius_percent))


def closed_surface(points: Points, radius_percent: float | None = None) -> MeshLab:
    """Pivot points [N, 3] and close small holes: the chain up to its third stage.

    The ball's radius is in percent of the diagonal of the cloud's box; None is MeshLab's choice.
    Raises StageFailure as `SurfaceApss.prepare`, but for the stage `apss`.
    """
    check_points(points, NORMAL_NEIGHBOURS + 1, "normals")
    meshlab = MeshLab(points)
    run("normals", lambda: meshlab.estimate_normals(NORMAL_NEIGHBOURS))
    if not np.isfinite(meshlab.normals()).all():
        raise StageFailure("normals", "a normal is not finite")
    run("ball-pivoting", lambda: meshlab.ball_pivoting(radius_percent))
    _require_faces("ball-pivoting", meshlab)
    run("close-holes", lambda: meshlab.close_holes(MAX_HOLE_EDGES))
    _require_faces("close-holes", meshlab)
    return meshlab


def reconstruction(stage: str, meshlab: MeshLab) -> Reconstruction:
    """Return the mesh that the last stage has left, in neutral grey.

    Raises StageFailure where it has no faces.
    """
    _require_faces(stage, meshlab)
    return finite_part(stage, meshlab.mesh(NEUTRAL_GREY))


def _require_faces(stage: str, meshlab: MeshLab) -> None:
    if meshlab.face_count == 0:
        raise StageFailure(stage, "no faces")
