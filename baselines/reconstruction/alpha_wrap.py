"""Alpha wrapping (Portaneri et al., ACM Trans. Graph. 41(4), 2022): a closed surface round points.

A ball carves from outside, as with alpha shapes, but what it leaves is meshed at a distance from
the points, the offset: a closed surface without self-intersections, which no gap narrower than the
ball opens. A sheet becomes a slab as thick as twice the offset, with no wall inside; where the ball
gets in through a gap there is a second wall, which the first hides but for the gap.

Computed by CGAL in MeshLab, which gives the same mesh for any order of the points. The resolution
is the ball's: a face has a circumscribed circle no larger than the ball. So a ball of less than a
pixel's footprint makes faces that the image cannot show, and is not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.reconstruction.denoised import MOST_POINTS, cleaned
from baselines.reconstruction.meshlab import MeshLab
from baselines.reconstruction.stages import (
    FOOTPRINT,
    DrawsReconstruction,
    Nearest,
    Reconstruction,
    run,
    spacing,
    used_points,
)
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS, reconstruction
from data_prep.arrays import Floats
from data_prep.scene import Mesh, PointCloud, Points

BALL = 2.0  # radius of the carving ball, in spacings of the cloud
# Distance of the surface from the points, in spacings: a third of a pixel for 2,048 points.
OFFSET = 0.14
# The smallest distance of the surface from the points, a quarter of a pixel in unit-sphere units:
# points on a line become a rod half a pixel thick.
_LEAST_OFFSET = FOOTPRINT / 4
# Points that are wrapped; of a larger cloud a random subset. On 7 validation objects of 32,768
# points LPIPS is .023, with 8,192 of them .027.
MOST_WRAPPED = 32_768
# The median angle between neighbouring faces up to which a wrap counts as smooth, in degrees. Of 7
# validation objects, wraps of 8,192 and 32,768 clean points have 3 to 15.5 degrees; with noise of
# 0.01, at which other meshes are better, 21 and more.
_SMOOTH_DEG = 14.0
# Corners [3, 3] of a tiny triangle about the origin. One is put in place of each point, because
# CGAL ends the process where a mesh has no faces.
SPECK = 1e-4 * np.array([[-1, -1, 0], [1, -1, 0], [0, 2, 0]]) / 2


@dataclass(frozen=True)
class AlphaWrap(DrawsReconstruction):
    """The alpha wrap of the points as they are.

    ball  radius of the carving ball, in spacings of the points
    """

    ball: float = BALL

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Return the wrap of the points; `rng` is not used, and their order does not matter.

        Raises StageFailure at the stage `input`, for fewer than 11 different points in sight and
        for a non-finite one, or at `alpha-wrap`, where MeshLab refuses or gives no face.
        """
        del rng
        points, notes = used_points(cloud, NORMAL_NEIGHBOURS + 1, MOST_WRAPPED, "surfaces")
        between = spacing(Nearest(points))
        result = wrapped(points, self.ball * between, OFFSET * between)
        return Reconstruction(result.mesh, (*notes, *result.notes))


@dataclass(frozen=True)
class DenoisedWrap(DrawsReconstruction):
    """The alpha wrap of points that are smoothed first, where they are noisy.

    strength  factor on the estimated noise; 0 smooths nothing
    ball      radius of the carving ball, in spacings of the points before they are smoothed
    """

    strength: float = 1.0
    ball: float = BALL

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Return the wrap of the smoothed points; `rng` is not used, nor does their order matter.

        Where the wrap of more than MOST_POINTS points is smooth, it is taken, as by `AlphaWrap`.

        Raises StageFailure as `AlphaWrap.prepare` does.
        """
        del rng
        if len(cloud) > MOST_POINTS:
            as_it_is = AlphaWrap(self.ball).prepare(cloud)
            if is_smooth(as_it_is.mesh):
                return as_it_is
        clean = cleaned(cloud, self.strength)
        result = wrapped(clean.points, self.ball * clean.spacing, OFFSET * clean.spacing)
        return Reconstruction(result.mesh, (*clean.notes, *result.notes))


def is_smooth(mesh: Mesh) -> bool:
    """Return whether the wrap of a cloud is as smooth as those of clean clouds.

    That tells noise from curvature, which an estimate from the points does not for some 8,192.
    """
    from trimesh import Trimesh

    whole = Trimesh(mesh.vertices, mesh.faces, process=False)
    return bool(np.degrees(np.median(whole.face_adjacency_angles)) <= _SMOOTH_DEG)


def wrapped(points: Points | Floats, radius: float, offset: float) -> Reconstruction:
    """Return the wrap of points [N, 3], N > 0, in neutral grey.

    radius  of the carving ball, in the units of the points; at least a pixel's footprint is used
    offset  of the surface from the points, likewise; at least a quarter of a footprint is used

    Raises StageFailure("alpha-wrap", ...) where MeshLab refuses or gives no face.
    """
    vertices = (points.astype(np.float64)[:, None] + SPECK).reshape(-1, 3)
    meshlab = MeshLab(vertices, faces=np.arange(len(vertices)).reshape(-1, 3))
    radius, offset = max(radius, FOOTPRINT), max(offset, _LEAST_OFFSET)
    run("alpha-wrap", lambda: meshlab.alpha_wrap(radius, offset))
    return reconstruction("alpha-wrap", meshlab)
