"""An estimate of a cloud's noise from the cloud alone.

The k nearest points of each point have heights above their common plane, with a variance m2 and a
kurtosis q. A thin plate of half thickness a, both sides of it sampled, with normal noise of
standard deviation s has m2 = a^2 + s^2 and q = 3 - 2 (a^2 / m2)^2, which gives

    s^2 = m2 (1 - sqrt((3 - q) / 2))

so that a chair's clean back, which is a plate and no plane, does not count as noise: without noise
q is 1, without thickness 3. q is the median over all patches, m2 a lower quantile, for rods and
edges are no plates. Three facts about patches decide the rest:

Few   Of 24 to 192 heights about their own plane, in a ball, the kurtosis of normal noise is 2.5 in
      the median: this takes the place of 3.
Cut   A patch is a ball of radius r and cuts the noise off. The variance of a normal distribution in
      such a ball is an integral; `_SEEN` inverts it, as long as r is well above s.
Size  On a curved surface the residual grows with the patch; under noise it does not. The smallest
      of the patches (k = 24, 48, 96, 192) whose estimate is at most 0.27 of its radius is taken, or
      the largest; under strong noise that is a large one, on a clean cloud the smallest.

The patches are those of at most 2,048 points.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from baselines.reconstruction.stages import check_finite
from data_prep.arrays import Floats
from data_prep.scene import Points

LEAST_POINTS = 30
MOST_POINTS = 2048
NEIGHBOURS = (24, 48, 96, 192)
_LARGEST_SHARE = 8  # a patch is at most this part of the cloud, or the smallest
WIDE = 0.27  # the estimate over the radius of a patch that is wide enough
FLAT = 0.3  # the quantile of the patches' variances that is taken
NOISE_KURTOSIS, PLATE_KURTOSIS = 2.5, 1.0
_PLANE_FREEDOMS = 3  # of a fitted plane: so many of the residuals are not free


def noise_scale(points: Points) -> float:
    """Return the standard deviation of the noise of points [N, 3] along the surface's normal, >= 0.

    In the units of the points; it scales with them and does not depend on their order. Of more than
    2,048 points every nth is taken, in the order of their coordinates; equal points count once. 0
    for fewer than 30 different points, which say nothing about it.

    Raises StageFailure("input", ...) where a point is not finite.
    """
    check_finite(points)
    used = even_sample(np.unique(points, axis=0)).astype(np.float64)
    if len(used) < LEAST_POINTS:
        return 0.0
    sizes = [k for k in NEIGHBOURS if k == NEIGHBOURS[0] or k <= len(used) // _LARGEST_SHARE]
    distance, index = map(np.asarray, cKDTree(used).query(used, k=sizes[-1]))
    estimate = 0.0
    for k in sizes:
        estimate, share = _estimate(used[index[:, :k]], distance[:, k - 1])
        if share <= WIDE:
            break
    return estimate


def _estimate(patches: Floats, radius: Floats) -> tuple[float, float]:
    """Return the noise of patches [P, k, 3] of radii [P] > 0, and its share of their radius."""
    variance, kurtosis = moments(patches)
    spread = float(np.quantile(variance / radius**2, FLAT))
    seen = noise_share(float(np.median(kurtosis))) * spread
    share = float(np.interp(np.sqrt(seen), _SEEN, _SHARES))
    return share * float(np.median(radius)), share


def even_sample(points: Points) -> Points:
    """Return every nth of points [N, 3] sorted by coordinates, at most 2,048."""
    return points[:: max(-(-len(points) // MOST_POINTS), 1)]


def moments(patches: Floats) -> tuple[Floats, Floats]:
    """Return variance and kurtosis [P] of patches' [P, k, 3] heights above their planes.

    The kurtosis is that of a plate where all heights are 0.
    """
    k = patches.shape[1]
    offset = patches - patches.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.swapaxes(offset, 1, 2) @ offset)
    squares = (offset @ axes[:, :, :1])[:, :, 0] ** 2
    second, fourth = squares.mean(axis=1), (squares**2).mean(axis=1)
    kurtosis = np.full(len(patches), PLATE_KURTOSIS)
    np.divide(fourth, second**2, out=kurtosis, where=second**2 > 0)
    return second * k / (k - _PLANE_FREEDOMS), kurtosis


def noise_share(kurtosis: float) -> float:
    """Return the share of noise in the variance of a noisy plate's heights, 0..1."""
    below = (NOISE_KURTOSIS - kurtosis) / (NOISE_KURTOSIS - PLATE_KURTOSIS)
    return 1 - float(np.sqrt(np.clip(below, 0, 1)))


def _cut_by_a_ball() -> tuple[Floats, Floats]:
    """Return standard deviations of noise in a ball of radius 1: observed, and true.

    In the ball the plane z has the area pi (1 - z^2).
    """
    shares = np.linspace(0, 1, 201)[1:]
    z = (np.arange(1000) + 0.5) / 1000
    weight = np.exp(-((z / shares[:, None]) ** 2) / 2) * (1 - z**2)
    seen = np.sqrt((weight * z**2).sum(axis=1) / weight.sum(axis=1))
    return np.append(0, seen), np.append(0, shares)


_SEEN, _SHARES = _cut_by_a_ball()
