"""Surface reconstruction and rendering as in the paper, where it is called SR.

The stages are: normals from 10 neighbours; ball pivoting; closing of holes of fewer than 30 edges;
marching cubes on the algebraic point set surface (APSS) at a resolution of 200; rendering by the
project's mesh renderer, in neutral grey. They are those of section 1 of the paper and of its filter
script (roatienza/pc2pix@23b7b46d). The script begins by turning the object by 90 degrees about Y
and Z, from the axes of Blender. Clouds here need no such turn, and leaving it out changes nothing
else, because it maps a grid of cubes onto itself.
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

# Values of the paper's filter script.
NORMAL_NEIGHBOURS = 10  # nearest points that a normal is estimated from
MAX_HOLE_EDGES = 30  # holes of fewer edges are closed
RESOLUTION = 200  # cells along a side of the grid of marching cubes


@dataclass(frozen=True)
class SurfaceApss(DrawsReconstruction):
    """The paper's chain of stages.

    resolution  cells along a side of the grid of marching cubes
    """

    resolution: int = RESOLUTION

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Return the reconstructed surface of a cloud; `rng` is not used.

        APSS gives some meshes non-finite vertices (15 of 107 real objects). Faces that have one are
        dropped, as viewers of meshes do, and a note tells their number.

        Raises StageFailure with the stage that failed: `input` (fewer points than a normal needs,
        or a non-finite one), `normals`, `ball-pivoting`, `close-holes` or `apss`.
        """
        del rng
        meshlab = closed_surface(cloud.points)
        run("apss", lambda: meshlab.marching_cubes_apss(self.resolution))
        return reconstruction("apss", meshlab)


@dataclass(frozen=True)
class SurfaceBpa(DrawsReconstruction):
    """The paper's chain without APSS: ball pivoting (Bernardini et al. 1999) and closing of holes.

    radius_percent  radius of the ball, in percent of the diagonal of the cloud's box; None is
                    MeshLab's choice, which grows as the points get fewer. On validation chairs
                    under the five conditions that gives a mean SSIM of 0.747; fixed radii of 1.5 to
                    6 % give 0.714 to 0.726
    """

    radius_percent: float | None = None

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Return the reconstructed surface of a cloud; `rng` is not used.

        Raises StageFailure with the stage that failed: `input` (fewer points than a normal needs,
        or a non-finite one), `normals`, `ball-pivoting` or `close-holes`.
        """
        del rng
        return reconstruction("close-holes", closed_surface(cloud.points, self.radius_percent))


def closed_surface(points: Points, radius_percent: float | None = None) -> MeshLab:
    """Return the mesh of points [N, 3] after the first three stages: its small holes are closed.

    radius_percent  radius of the ball, in percent of the diagonal of the cloud's box; None is
                    MeshLab's choice

    Raises StageFailure as `SurfaceBpa.prepare` does.
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
    """Return MeshLab's current mesh, in neutral grey, without faces that are not finite.

    Raises StageFailure(stage, ...) where no face is left.
    """
    _require_faces(stage, meshlab)
    return finite_part(stage, meshlab.mesh(NEUTRAL_GREY))


def _require_faces(stage: str, meshlab: MeshLab) -> None:
    if meshlab.face_count == 0:
        raise StageFailure(stage, "no faces")
