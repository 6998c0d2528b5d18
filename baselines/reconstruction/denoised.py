"""The smoothing of noisy clouds before they are meshed: as much as their estimated noise asks for.

Noise below 0.55 spacings of the points that it is estimated from leaves the cloud as it is: clean
clouds lose nothing. Above, points are projected three times onto height fields over as many
neighbours as lie within three standard deviations of the noise
(`baselines.reconstruction.smoothing`). Points that noise moved along the surface blur its outline:
the sparsest are left out, a share that grows with the noise.

How the constants were chosen: docs/reconstruction-constants.md at commit d75c6426.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from baselines.reconstruction.noise import even_sample, noise_scale
from baselines.reconstruction.smoothing import dense_part, smoothed
from baselines.reconstruction.stages import spacing
from baselines.reconstruction.subset import used_points
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS
from data_prep.scene import PointCloud, Points

MOST_POINTS = 8192
NOISY = 0.55  # spacings of the points that the noise is estimated from
_PATCH = 3.0  # radius of the neighbourhood, in standard deviations of the noise
FEWEST, MOST = 48, 256  # neighbours: six numbers are fitted to them
ROUNDS = 3
DENSITY_NEIGHBOURS = 24
LEFT_OUT = 2.0  # share of the points for each unit of noise
MOST_LEFT_OUT = 0.3


@dataclass(frozen=True)
class _Cleaned:
    """The points [N, 3] to mesh, the noise and spacing that they had, and notes.

    The noise is 0 where the points are left as they are.
    """

    points: Points
    noise: float
    spacing: float
    notes: tuple[str, ...]


def cleaned(cloud: PointCloud, strength: float, most: int = MOST_POINTS) -> _Cleaned:
    """Return at most `most` points of a cloud, smoothed where they are noisy.

    `strength` is a factor on the estimated noise; 0 smooths nothing.

    Raises StageFailure("input", ...) where too few are different, finite and in sight.
    """
    points, notes = used_points(cloud, NORMAL_NEIGHBOURS + 1, most, "surfaces")
    estimate = noise_scale(points)
    notes = (f"noise: {estimate:.3f}", *notes)
    between = spacing(points)
    noise = strength * estimate
    if noise <= NOISY * spacing(even_sample(points)):
        return _Cleaned(points, 0.0, between, notes)
    exact = points.astype(np.float64)
    patches = cKDTree(exact).query_ball_point(exact, _PATCH * noise, return_length=True)
    neighbours = int(np.clip(np.median(patches), FEWEST, MOST))
    smooth = smoothed(exact, neighbours, ROUNDS)
    kept = dense_part(smooth, 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT), DENSITY_NEIGHBOURS)
    done = f"smoothed: {ROUNDS} times over {neighbours} points, {len(kept)} of {len(points)} kept"
    return _Cleaned(kept.astype(np.float32), noise, between, (*notes, done))
