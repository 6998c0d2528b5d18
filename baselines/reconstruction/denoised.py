"""Noisy clouds before they are meshed: their noise is estimated, and smoothed as it asks for.

Noise below 0.55 spacings of the points that it is estimated from leaves the cloud as it is: clean
clouds lose nothing. Above, points are projected twice onto height fields over as many neighbours
as lie within three standard deviations of the noise. A third time, or a new search for neighbours
in between, brings nothing but thinner ends: LPIPS on 26 validation objects is .004 (noise 5 %) and
.007 (10 %) higher with both. Points that noise moved along the
surface blur its outline: the sparsest are left out, a share that grows with the noise.

Smoothing is moving least squares by iterated projection (Alexa et al., Computing and rendering
point set surfaces, IEEE TVCG 9(1), 2003): each point moves along the normal of its neighbourhood
onto a height field of degree 2 over the neighbourhood's plane, fitted by weighted least squares (a
jet: Cazals and Pouget, Estimating differential quantities using polynomial fitting of osculating
jets, CAGD 22(2), 2005).

The noise is estimated from the cloud alone. The k nearest points of each point have heights above
their common plane, with a variance m2 and a
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

How the constants were chosen: docs/reconstruction-constants.md at commit d75c6426.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.eigenpairs import smallest_eigenpairs
from baselines.reconstruction.stages import Nearest, spacing, used_points
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS
from data_prep.arrays import Floats
from data_prep.clouds.sampling import random_rows
from data_prep.scene import PointCloud, Points

MOST_POINTS = 8192  # that are wrapped; of more, a random subset
NOISY = 0.55  # spacings of the points that the noise is estimated from
_PATCH = 3.0  # radius of the neighbourhood, in standard deviations of the noise
_FEWEST, _MOST = 48, 256  # neighbours: six numbers are fitted to them
_ROUNDS = 2
DENSITY_NEIGHBOURS = 24
LEFT_OUT = 2.0  # share of the points for each unit of noise
MOST_LEFT_OUT = 0.3
_SHARPNESS = 2.0  # a neighbour's weight is exp(-SHARPNESS (distance / that of the farthest)^2)
_TERMS = 6  # of a polynomial of degree 2 in two variables
_RIDGE = 1e-9  # keeps fits defined that the points do not determine: a line, few points
_LEAST_POINTS = 30
_SAMPLE = 2048  # points that the noise is estimated from: as many as the constants were chosen for
_TOGETHER = 512
_PATCHES = (24, 48, 96, 192)
_LARGEST_SHARE = 8  # a patch is at most this part of the cloud, or the smallest
_WIDE = 0.27  # the estimate over the radius of a patch that is wide enough
_FLAT = 0.3  # the quantile of the patches' variances that is taken
_NOISE_KURTOSIS, _PLATE_KURTOSIS = 2.5, 1.0
_PLANE_FREEDOMS = 3  # of a fitted plane: so many of the residuals are not free


@dataclass(frozen=True)
class _Cleaned:
    """The points [N, 3] to mesh, the noise and spacing that they had, and notes.

    The noise is 0 where the points are left as they are.
    """

    points: Points
    noise: float
    spacing: float
    notes: tuple[str, ...]


def cleaned(cloud: PointCloud, strength: float) -> _Cleaned:
    """Return at most 8,192 points of a cloud, smoothed where they are noisy.

    `strength` is a factor on the estimated noise; 0 smooths nothing.

    Raises StageFailure("input", ...) where too few are different, finite and in sight.
    """
    points, notes = used_points(cloud, NORMAL_NEIGHBOURS + 1, MOST_POINTS, "surfaces")
    near, sample = searched(points)
    estimate = noise_scale(sample)
    between = spacing(near)
    noise = strength * estimate
    if noise <= NOISY * spacing(sample):
        return _Cleaned(points, 0.0, between, notes)
    smooth, neighbours = smoothed_as_asked(near, noise)
    kept = dense_part(smooth, 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT), DENSITY_NEIGHBOURS)
    done = f"smoothed: {_ROUNDS} times over {neighbours} points, {len(kept)} of {len(points)} kept"
    notes = (f"noise: {estimate:.3f}", *notes, done)
    return _Cleaned(kept.astype(np.float32), noise, between, notes)


def smoothed_as_asked(near: Nearest, noise: float) -> tuple[Floats, int]:
    """Return points [N, 3] smoothed as their noise > 0 asks for, and over how many neighbours."""
    patches = near.tree.query_ball_point(near.points, _PATCH * noise, return_length=True)
    neighbours = int(np.clip(np.median(patches), _FEWEST, _MOST))
    return smoothed(near, neighbours, _ROUNDS), neighbours


def smoothed(near: Nearest, neighbours: int, rounds: int) -> Floats:
    """Return points [N, 3] projected `rounds` times onto height fields of their neighbours.

    A height field is fitted to the `neighbours` nearest points, or to all where there are fewer;
    they stay the same points in all rounds.

    Planes and paraboloids stay as they are, to rounding; 0 rounds change nothing.
    """
    points, (_, index) = near.points, near.within(neighbours)
    for _ in range(rounds):
        points = _projected(points, index)
    return points


def _projected(points: Floats, index: NDArray[np.intp]) -> Floats:
    """Return points projected once, whose neighbours have these indices [N, k]."""
    projected = np.empty_like(points)
    for some, offsets in _patches(points, index):
        x, y, z = offsets
        squares = x * x + y * y + z * z
        farthest = np.sqrt(np.maximum(squares.max(axis=1), np.finfo(np.float64).tiny))[:, None]
        weight = np.exp(-_SHARPNESS * squares / farthest**2)
        normal = _least_axes(offsets, weight)
        along = perpendicular(normal)
        axes = np.stack([normal, along, np.cross(normal, along)]) / farthest
        height, a, b = (x * n[:, :1] + y * n[:, 1:2] + z * n[:, 2:] for n in axes)
        terms = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=1)
        weighted = weight[:, None] * terms
        ridge = _RIDGE * weight.sum(axis=1)[:, None, None] * np.eye(_TERMS)
        matrix = weighted @ np.swapaxes(terms, 1, 2) + ridge
        fit = np.linalg.solve(matrix, weighted @ height[..., None])[:, 0]
        projected[some] = points[some] + fit * farthest * normal
    return projected


def dense_part(points: Floats, share: float, neighbours: int) -> Floats:
    """Return the densest `share` (0..1) of points [N, 3], in their order.

    A point is the denser the nearer the point `neighbours` away is; of equally dense ones the first
    are taken.
    """
    kept = round(share * len(points))
    if kept >= len(points):
        return points
    distance, _ = Nearest(points).within(neighbours)
    return points[np.sort(np.argsort(distance[:, -1], kind="stable")[:kept])]


def searched(points: Points) -> tuple[Nearest, Nearest]:
    """Return the searches of finite points [N, 3], and of those that noise is estimated from.

    These are a random subset of 2,048, or all of fewer.
    """
    near = Nearest(points)
    if len(points) <= _SAMPLE:
        return near, near
    return near, Nearest(points[random_rows(len(points), _SAMPLE)])


def noise_scale(near: Nearest) -> float:
    """Return the standard deviation of the noise of points along the surface's normal, >= 0.

    In the units of the points; it scales with them and does not depend on their order. 0 for fewer
    than 30 points, which say nothing about it.
    """
    count = len(near.points)
    if count < _LEAST_POINTS:
        return 0.0
    sizes = [k for k in _PATCHES if k == _PATCHES[0] or k <= count // _LARGEST_SHARE]
    estimate = 0.0
    for k in sizes:
        # one search for all that are left; on most clean clouds the first patch is wide enough
        distance, index = near.within(k if k == sizes[0] else sizes[-1])
        estimate, share = _estimate(near.points, distance[:, k - 1], index[:, :k])
        if share <= _WIDE:
            break
    return estimate


def _estimate(points: Floats, radius: Floats, index: NDArray[np.intp]) -> tuple[float, float]:
    """Return the noise of points in patches [P, k] of radii [P] > 0, and its share of these."""
    variance, kurtosis = moments(points, index)
    spread = float(np.quantile(variance / radius**2, _FLAT))
    seen = _noise_share(float(np.median(kurtosis))) * spread
    share = float(np.interp(np.sqrt(seen), _SEEN, _SHARES))
    return share * float(np.median(radius)), share


def moments(points: Floats, index: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Return variance and kurtosis [P] of the heights of patches above their planes.

    A patch is of points [N, 3] with indices [P, k]. The kurtosis is that of a plate where all
    heights are 0.
    """
    second, fourth = np.empty(len(index)), np.empty(len(index))
    for some, offsets in _patches(points, index):
        x, y, z = (offset - offset.mean(axis=1, keepdims=True) for offset in offsets)
        normal = _least_axes((x, y, z), np.ones_like(x))
        squares = (x * normal[:, :1] + y * normal[:, 1:2] + z * normal[:, 2:]) ** 2
        second[some], fourth[some] = squares.mean(axis=1), (squares**2).mean(axis=1)
    kurtosis = np.full(len(index), _PLATE_KURTOSIS)
    np.divide(fourth, second**2, out=kurtosis, where=second**2 > 0)
    k = index.shape[1]
    return second * k / (k - _PLANE_FREEDOMS), kurtosis


def _patches(
    points: Floats, index: NDArray[np.intp]
) -> Iterator[tuple[slice, tuple[Floats, Floats, Floats]]]:
    """Yield rows of patches [P, k], and the offsets of their points from the first, by axis.

    So many at once as stay in a processor's cache.
    """
    columns = np.ascontiguousarray(points.T)
    for start in range(0, len(index), _TOGETHER):
        some = slice(start, start + _TOGETHER)
        near = (column.take(index[some]) for column in columns)
        x, y, z = (place - place[:, :1] for place in near)
        yield some, (x, y, z)


def _least_axes(offsets: tuple[Floats, Floats, Floats], weight: Floats) -> Floats:
    """Return unit vectors [P, 3] along which weighted offsets [P, k] vary least."""
    total = weight.sum(axis=1)
    weighted = [weight * offset for offset in offsets]
    means = [product.sum(axis=1) / total for product in weighted]
    upper = [
        np.einsum("pk,pk->p", weighted[i], offsets[j]) - total * means[i] * means[j]
        for i, j in zip(*np.triu_indices(3), strict=True)
    ]
    return smallest_eigenpairs(np.stack(upper, axis=1))[1]


def perpendicular(vectors: Floats) -> Floats:
    """Return unit vectors at right angles to unit vectors [n, 3]."""
    across = np.cross(vectors, np.eye(3)[np.abs(vectors).argmin(axis=1)])
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def _noise_share(kurtosis: float) -> float:
    """Return the share of noise in the variance of a noisy plate's heights, 0..1."""
    below = (_NOISE_KURTOSIS - kurtosis) / (_NOISE_KURTOSIS - _PLATE_KURTOSIS)
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
