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
from data_prep.scene import PointCloud, Points

BALL = 2.0  # radius, in spacings of the cloud
OFFSET = 0.14  # of the surface from the points, in spacings: a third of a pixel at 2,048 points
_LEAST_OFFSET = FOOTPRINT / 4  # a line of points is a rod half a pixel thick
# A triangle in place of each point, centred on it: CGAL ends the process on points alone.
SPECK = 1e-4 * np.array([[-1, -1, 0], [1, -1, 0], [0, 2, 0]]) / 2


@dataclass(frozen=True)
class AlphaWrap(DrawsReconstruction):
    """The method on the points as they are; `ball` is a radius in spacings of the points."""

    ball: float = BALL

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Wrap the points; no randomness, and the order of the points does not matter.

        Raises StageFailure: `input` (fewer than 11 different points in sight, or a non-finite one)
        or `alpha-wrap` (MeshLab refuses, or there is no face).
        """
        del rng
        points, notes = used_points(cloud, NORMAL_NEIGHBOURS + 1, MOST_POINTS, "surfaces")
        between = spacing(Nearest(points))
        result = wrapped(points, self.ball * between, OFFSET * between)
        return Reconstruction(result.mesh, (*notes, *result.notes))


@dataclass(frozen=True)
class DenoisedWrap(DrawsReconstruction):
    """The method on points smoothed as their noise asks for.

    `strength` is a factor on the estimated noise, `ball` a radius in spacings of the cloud.
    """

    strength: float = 1.0
    ball: float = BALL

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Smooth and wrap the points; no randomness, and their order does not matter.

        Raises StageFailure as `AlphaWrap.prepare`.
        """
        del rng
        clean = cleaned(cloud, self.strength)
        result = wrapped(clean.points, self.ball * clean.spacing, OFFSET * clean.spacing)
        return Reconstruction(result.mesh, (*clean.notes, *result.notes))


def wrapped(points: Points | Floats, radius: float, offset: float) -> Reconstruction:
    """Return the wrap of points [N, 3], N > 0, in neutral grey.

    The ball has `radius`, or a pixel's footprint where that is more, and the surface is at the
    distance `offset`, or a quarter of a footprint where that is more.

    Raises StageFailure("alpha-wrap", ...) where MeshLab refuses or there is no face.
    """
    vertices = (points.astype(np.float64)[:, None] + SPECK).reshape(-1, 3)
    meshlab = MeshLab(vertices, faces=np.arange(len(vertices)).reshape(-1, 3))
    run(
        "alpha-wrap", lambda: meshlab.alpha_wrap(max(radius, FOOTPRINT), max(offset, _LEAST_OFFSET))
    )
    return reconstruction("alpha-wrap", meshlab)
