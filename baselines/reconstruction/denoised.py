"""Smoothing of noisy clouds before they are meshed, as strongly as their estimated noise requires.

A cloud whose noise is below 0.55 spacings of its points stays as it is, so that clean clouds lose
nothing. In other clouds each point is projected twice onto a height field, which is fitted to as
many neighbours as lie within three standard deviations of the noise. A third projection and a new
search for neighbours in between only shorten thin parts: with both, LPIPS on 26 validation objects
is .004 (noise of 5 %) and .007 (10 %) higher. Points that noise has moved along the surface blur
its outline, so those in the sparsest places are left out, the more the stronger the noise is.

Smoothing is moving least squares by iterated projection (Alexa et al., Computing and rendering
point set surfaces, IEEE TVCG 9(1), 2003): each point moves along the normal of its neighbourhood
onto a height field of degree 2 over the neighbourhood's plane, fitted by weighted least squares (a
jet: Cazals and Pouget, Estimating differential quantities using polynomial fitting of osculating
jets, CAGD 22(2), 2005).

The noise is estimated from the cloud alone. A patch is the k nearest points of a point; let m2 be
the variance, and q the kurtosis, of the heights of its points above their common plane. The
difficulty is that a thin part, the back of a chair for example, is a plate with points on both
sides, whose heights vary without any noise. For a plate of half thickness a, under normally
distributed noise of standard deviation s, m2 = a^2 + s^2 and q = 3 - 2 (a^2 / m2)^2. This gives

    s^2 = m2 (1 - sqrt((3 - q) / 2))

where q is 1 for a plate without noise, and 3 for noise without thickness. As q the median of all
patches is taken, and as m2 a lower quantile, because the patches of rods and edges are no plates.
Three corrections follow:

Few   A patch has only 24 to 192 points, and its plane is fitted to them. The median kurtosis of
      pure noise is then 2.5, which takes the place of 3.
Cut   A patch is a ball of radius r, which cuts the noise off. The variance of a normal distribution
      within such a ball is an integral; the table `_SEEN` inverts it where r is well above s.
Size  On a curved surface heights grow with the patch, while noise does not. So of the patches with
      k = 24, 48, 96 and 192 the smallest is taken whose estimate is at most 0.27 of its radius, or
      else the largest. On a clean cloud that is the smallest, under strong noise a large one.

Only the patches of at most 2,048 points are used. Where these lie in layers, the estimate would be
their thickness, and counts as 0 (`baselines.reconstruction.layers`).

How the constants were chosen: docs/reconstruction-constants.md at commit d75c6426.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.eigenpairs import smallest_eigenpairs
from baselines.reconstruction.layers import in_layers
from baselines.reconstruction.stages import Nearest, spacing, used_points
from baselines.reconstruction.surface import NORMAL_NEIGHBOURS
from data_prep.arrays import Floats
from data_prep.clouds.sampling import random_rows
from data_prep.scene import PointCloud, Points

MOST_POINTS = 8192  # points that are meshed; of a larger cloud a random subset

# Smoothing.
NOISY = 0.55  # noise from which on a cloud is smoothed, in spacings of the sampled points
_PATCH = 3.0  # radius of the neighbourhood of a fit, in standard deviations of the noise
_FEWEST, _MOST = 48, 256  # bounds of the neighbours of a fit, which has six coefficients
_ROUNDS = 2  # times that each point is projected
# The distance to so many-th neighbour tells how dense points are, and a share of the sparsest,
# LEFT_OUT times the noise (in unit-sphere units) but at most MOST_LEFT_OUT, is left out.
DENSITY_NEIGHBOURS = 24
LEFT_OUT = 2.0
MOST_LEFT_OUT = 0.3
# A neighbour's weight in a fit is exp(-_SHARPNESS * (its distance / that of the farthest)^2).
_SHARPNESS = 2.0
_TERMS = 6  # coefficients of a polynomial of degree 2 in two variables
# Ridge of the least squares, relative to the sum of weights. It keeps a fit defined that the points
# do not determine, as when they are few or lie on a line.
_RIDGE = 1e-9
_TOGETHER = 512  # patches that are computed together: they fit into a processor's cache

# Estimation of the noise.
_LEAST_POINTS = 30  # of fewer points no noise is estimated
_SAMPLE = 2048  # points that noise is estimated from: as many as the constants were chosen for
PATCHES = (24, 48, 96, 192)  # points of a patch, from the smallest to the largest that is tried
_LARGEST_SHARE = 8  # larger patches than the smallest have at most 1/8 of the points
WIDE = 0.27  # patches are wide enough if the noise is at most this share of their radius
_FLAT = 0.3  # quantile of the patches' variances that is taken as m2
_NOISE_KURTOSIS, _PLATE_KURTOSIS = 2.5, 1.0  # q of pure noise, and of a plate without noise
_PLANE_FREEDOMS = 3  # parameters of a fitted plane: a patch of k heights has k - 3 free ones


@dataclass(frozen=True)
class _Cleaned:
    """The points of a cloud that are to be meshed.

    points   [N, 3], smoothed where the cloud is noisy
    noise    standard deviation that they were smoothed for; 0 where they are as they were
    spacing  median distance between neighbours, before smoothing
    notes    what was done to the cloud, for the user
    """

    points: Points
    noise: float
    spacing: float
    notes: tuple[str, ...]


def cleaned(cloud: PointCloud, strength: float) -> _Cleaned:
    """Return at most MOST_POINTS points of a cloud, smoothed where they are noisy.

    strength  factor on the estimated noise; 0 smooths nothing

    Raises StageFailure("input", ...) for fewer than 11 different points in sight, and for a
    non-finite one.
    """
    points, notes = used_points(cloud, NORMAL_NEIGHBOURS + 1, MOST_POINTS, "surfaces")
    near, sample = searched(points)
    estimate = noise_scale(sample)
    between = spacing(near)
    noise = strength * estimate
    if noise <= NOISY * spacing(sample):
        return _Cleaned(points, 0.0, between, notes)
    smooth, neighbours = smoothed_as_asked(near, noise)
    share = 1 - min(LEFT_OUT * noise, MOST_LEFT_OUT)
    kept = dense_part(smooth, share, DENSITY_NEIGHBOURS)
    done = f"smoothed: {_ROUNDS} times over {neighbours} points, {len(kept)} of {len(points)} kept"
    notes = (f"noise: {estimate:.3f}", *notes, done)
    return _Cleaned(kept.astype(np.float32), noise, between, notes)


def is_noisy(points: Points) -> bool:
    """Return whether points [N, 3], all different and finite, have noise that `cleaned` smooths."""
    _, sample = searched(points)
    return noise_scale(sample) > NOISY * spacing(sample)


def smoothed_as_asked(near: Nearest, noise: float) -> tuple[Floats, int]:
    """Return smoothed points [N, 3], and the number of neighbours that each fit was made to.

    noise  its standard deviation, above 0; the neighbourhoods grow with it
    """
    patches = near.tree.query_ball_point(near.points, _PATCH * noise, return_length=True)
    neighbours = int(np.clip(np.median(patches), _FEWEST, _MOST))
    return smoothed(near, neighbours, _ROUNDS), neighbours


def smoothed(near: Nearest, neighbours: int, rounds: int) -> Floats:
    """Return points [N, 3] projected `rounds` times onto height fields of their neighbours.

    A height field is fitted to the `neighbours` nearest points, or to all where there are fewer.
    The neighbours of a point are not searched for again between rounds. Points of planes and
    paraboloids stay where they are, up to rounding.
    """
    points = near.points
    _, index = near.within(neighbours)
    for _ in range(rounds):
        points = projected(points, points, index)
    return points


def projected(points: Floats, surroundings: Floats, index: NDArray[np.intp]) -> Floats:
    """Return points [P, 3] projected once onto height fields of their surroundings [N, 3].

    index  [P, k], the rows of `surroundings` that each point's height field is fitted to
    """
    moved = np.empty_like(points)
    for some, offsets in _patches(points, surroundings, index):
        x, y, z = offsets
        squares = x * x + y * y + z * z
        farthest = np.sqrt(np.maximum(squares.max(axis=1), np.finfo(np.float64).tiny))[:, None]
        weight = np.exp(-_SHARPNESS * squares / farthest**2)
        normal = _least_axes(offsets, weight)
        along = perpendicular(normal)
        # Heights above the plane, and places a, b in it, over the distance of the farthest.
        axes = np.stack([normal, along, np.cross(normal, along)]) / farthest
        height, a, b = (x * n[:, :1] + y * n[:, 1:2] + z * n[:, 2:] for n in axes)
        terms = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=1)
        weighted = weight[:, None] * terms
        ridge = _RIDGE * weight.sum(axis=1)[:, None, None] * np.eye(_TERMS)
        matrix = weighted @ np.swapaxes(terms, 1, 2) + ridge
        # The constant term is the height of the field at the point itself, where a = b = 0.
        fit = np.linalg.solve(matrix, weighted @ height[..., None])[:, 0]
        moved[some] = points[some] + fit * farthest * normal
    return moved


def dense_part(points: Floats, share: float, neighbours: int) -> Floats:
    """Return the densest points, a `share` of 0 to 1 of the points [N, 3], in their given order.

    A point is denser the nearer its `neighbours`-th nearest point is, where the point itself counts
    as the first. Of equally dense points the first are taken.
    """
    kept = round(share * len(points))
    if kept >= len(points):
        return points
    distance, _ = Nearest(points).within(neighbours)
    return points[np.sort(np.argsort(distance[:, -1], kind="stable")[:kept])]


def searched(points: Points) -> tuple[Nearest, Nearest]:
    """Return searches for neighbours: among points [N, 3], and among those for estimating noise.

    The latter are a random subset of _SAMPLE points, or all where there are fewer.
    """
    near = Nearest(points)
    if len(points) <= _SAMPLE:
        return near, near
    return near, Nearest(points[random_rows(len(points), _SAMPLE)])


def noise_scale(near: Nearest) -> float:
    """Return the standard deviation of the points' noise along the surface's normal, at least 0.

    It is in the units of the points and does not depend on their order. For fewer than 30 points,
    of which noise cannot be estimated, it is 0; and for points that lie in layers, whose thickness
    would be taken for noise.
    """
    count = len(near.points)
    if count < _LEAST_POINTS:
        return 0.0
    smallest, *larger = PATCHES
    sizes = [smallest, *(k for k in larger if k <= count // _LARGEST_SHARE)]
    estimate = 0.0
    for k in sizes:
        # On most clean clouds the smallest patch is wide enough. Where it is not, one search finds
        # the neighbours of all other sizes.
        distance, index = near.within(smallest if k == smallest else sizes[-1])
        estimate, share = noise_in_patches(near.points, distance[:, k - 1], index[:, :k])
        if share <= WIDE:
            break
    if estimate > NOISY * spacing(near) and in_layers(near):
        return 0.0
    return estimate


def noise_in_patches(
    points: Floats, radius: Floats, index: NDArray[np.intp]
) -> tuple[float, float]:
    """Return the noise of points [N, 3] by patches of one size, and its ratio to their radius.

    radius  [P], above 0, of each patch; the ratio is to their median
    index   [P, k], the points of each patch
    """
    variance, kurtosis = moments(points, index)
    spread = float(np.quantile(variance / radius**2, _FLAT))
    seen = _noise_share(float(np.median(kurtosis))) * spread
    share = float(np.interp(np.sqrt(seen), _SEEN, _SHARES))
    return share * float(np.median(radius)), share


def moments(points: Floats, index: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Return variance [P] and kurtosis [P] of the heights of patches above their planes.

    points  [N, 3]
    index   [P, k], the points of each patch

    Where all heights of a patch are 0 the kurtosis is that of a plate, 1.
    """
    second, fourth = np.empty(len(index)), np.empty(len(index))
    for some, offsets in _patches(points[index[:, 0]], points, index):
        x, y, z = (offset - offset.mean(axis=1, keepdims=True) for offset in offsets)
        normal = _least_axes((x, y, z), np.ones_like(x))
        squares = (x * normal[:, :1] + y * normal[:, 1:2] + z * normal[:, 2:]) ** 2
        second[some], fourth[some] = squares.mean(axis=1), (squares**2).mean(axis=1)
    kurtosis = np.full(len(index), _PLATE_KURTOSIS)
    np.divide(fourth, second**2, out=kurtosis, where=second**2 > 0)
    k = index.shape[1]
    return second * k / (k - _PLANE_FREEDOMS), kurtosis


def _patches(
    origins: Floats, points: Floats, index: NDArray[np.intp]
) -> Iterator[tuple[slice, tuple[Floats, Floats, Floats]]]:
    """Yield patches, _TOGETHER at a time, as offsets of their points from their origins [P, 3].

    points  [N, 3]
    index   [P, k], the rows of `points` in each patch

    Each item has the slice of `index` that it is of, and the offsets [_TOGETHER, k] in x, y and z.
    """
    columns = np.ascontiguousarray(points.T)
    for start in range(0, len(index), _TOGETHER):
        some = slice(start, start + _TOGETHER)
        near = [column.take(index[some]) for column in columns]
        x, y, z = (place - origins[some, axis, None] for axis, place in enumerate(near))
        yield some, (x, y, z)


def _least_axes(offsets: tuple[Floats, Floats, Floats], weight: Floats) -> Floats:
    """Return the unit vectors [P, 3] along which patches vary least: the normals of their planes.

    offsets  [P, k] in x, y and z, of the points of each patch
    weight   [P, k]
    """
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
    """Return which share of the variance of a plate's heights is due to noise, 0..1."""
    below = (_NOISE_KURTOSIS - kurtosis) / (_NOISE_KURTOSIS - _PLATE_KURTOSIS)
    return 1 - float(np.sqrt(np.clip(below, 0, 1)))


def _cut_by_a_ball() -> tuple[Floats, Floats]:
    """Return a table of standard deviations of noise: those seen in a unit ball, and true ones.

    The heights z of points in the ball are normally distributed, and weighted by the area of the
    ball's section at that height, pi (1 - z^2).
    """
    shares = np.linspace(0, 1, 201)[1:]
    z = (np.arange(1000) + 0.5) / 1000
    weight = np.exp(-((z / shares[:, None]) ** 2) / 2) * (1 - z**2)
    seen = np.sqrt((weight * z**2).sum(axis=1) / weight.sum(axis=1))
    return np.append(0, seen), np.append(0, shares)


_SEEN, _SHARES = _cut_by_a_ball()
