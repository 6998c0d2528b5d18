"""Reconstruction of noisy clouds: estimate the noise, smooth as much as that asks for, then mesh.

Rule    Noise below 0.55 spacings of the points that it is estimated from leaves the cloud as it is:
        clean clouds lose nothing.
        Above, points are projected three times onto height fields over as many neighbours as lie
        within three standard deviations of the noise (`baselines.reconstruction.smoothing`). Points
        that noise moved along the surface blur its outline: the sparsest are left out, a share that
        grows with the noise.
Meshes  Ball pivoting, the alpha shape and screened Poisson, as in the methods without smoothing.
        The radii follow the spacing of the points, which grows with noise, the depth of the octree
        the noise.

How the constants were chosen: docs/reconstruction-constants.md at commit d75c6426.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from baselines.reconstruction.alpha_shape import alpha_mesh
from baselines.reconstruction.noise import even_sample, noise_scale
from baselines.reconstruction.poisson import trimmed_poisson
from baselines.reconstruction.smoothing import dense_part, smoothed
from baselines.reconstruction.stages import DrawsReconstruction, Reconstruction, spacing
from baselines.reconstruction.subset import used_points
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS, closed_surface, reconstruction
from data_prep.scene import PointCloud, Points

MOST_POINTS = 8192  # ball pivoting takes half a second, the alpha shape too
NOISY = 0.55  # spacings of the points that the noise is estimated from
PATCH = 3.0  # radius of the neighbourhood, in standard deviations of the noise
FEWEST, MOST = 48, 256  # neighbours: six numbers are fitted to them
ROUNDS = 3
DENSITY_NEIGHBOURS = 24
LEFT_OUT = 2.0  # share of the points for each unit of noise
MOST_LEFT_OUT = 0.3
ALPHA = 2.0  # radius of the alpha shape's ball, in spacings of the cloud
CLEAN_DEPTH, NOISY_DEPTH = 7, 6  # of Poisson's octree: a cell of 0.035 is finer than such noise


@dataclass(frozen=True)
class Cleaned:
    """The points [N, 3] to mesh, the noise and spacing that they had, and notes.

    The noise is 0 where the points are left as they are.
    """

    points: Points
    noise: float
    spacing: float
    notes: tuple[str, ...]


def cleaned(cloud: PointCloud, strength: float, most: int = MOST_POINTS) -> Cleaned:
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
        return Cleaned(points, 0.0, between, notes)
    exact = points.astype(np.float64)
    patches = cKDTree(exact).query_ball_point(exact, PATCH * noise, return_length=True)
    neighbours = int(np.clip(np.median(patches), FEWEST, MOST))
    smooth = smoothed(exact, neighbours, ROUNDS)
    kept = dense_part(smooth, 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT), DENSITY_NEIGHBOURS)
    done = f"smoothed: {ROUNDS} times over {neighbours} points, {len(kept)} of {len(points)} kept"
    return Cleaned(kept.astype(np.float32), noise, between, (*notes, done))


@dataclass(frozen=True)
class DenoisedBpa(DrawsReconstruction):
    """The method by ball pivoting; `strength` is a factor on the estimated noise."""

    strength: float = 1.0

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness, and the order of the points does not matter.

        Raises StageFailure as `baselines.reconstruction.surface.SurfaceBpa.prepare`.
        """
        del rng
        clean = cleaned(cloud, self.strength)
        result = reconstruction("close-holes", closed_surface(clean.points))
        return Reconstruction(result.mesh, (*clean.notes, *result.notes))


@dataclass(frozen=True)
class DenoisedAlpha(DrawsReconstruction):
    """The method by the alpha shape, whose ball follows the spacing of the cloud's points.

    `strength` is a factor on the estimated noise.
    """

    strength: float = 1.0

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Find the surface; no randomness, and the order of the points does not matter.

        Raises StageFailure: `input` (too few points are different, in sight and finite), `delaunay`
        or `alpha-shape`, as `baselines.reconstruction.alpha_shape.AlphaShape.prepare`.
        """
        del rng
        clean = cleaned(cloud, self.strength)
        return Reconstruction(alpha_mesh(clean.points, ALPHA * clean.spacing), clean.notes)


@dataclass(frozen=True)
class DenoisedPoisson(DrawsReconstruction):
    """The method by screened Poisson, trimmed; `strength` is a factor on the estimated noise."""

    strength: float = 1.0

    def prepare(self, cloud: PointCloud, rng: np.random.Generator | None = None) -> Reconstruction:
        """Reconstruct the surface; no randomness, and the order of the points does not matter.

        Raises StageFailure as `baselines.reconstruction.poisson.Poisson.prepare`.
        """
        del rng
        clean = cleaned(cloud, self.strength)
        result = trimmed_poisson(clean.points, NOISY_DEPTH if clean.noise else CLEAN_DEPTH)
        return Reconstruction(result.mesh, (*clean.notes, *result.notes))
