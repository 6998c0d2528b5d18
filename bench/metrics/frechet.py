"""The Fréchet distance of two feature sets, exact for any number of samples and never complex.

    |m1 - m2|^2 + tr S1 + tr S2 - 2 tr sqrt(S1 S2)

is the squared 2-Wasserstein distance of the Gaussians with the moments of the two sets (Dowson and
Landau 1982; Heusel et al. 2017, https://arxiv.org/abs/1706.08500, which call it FID when the
features are those of `bench.metrics.inception`). S is the unbiased covariance (ddof 1).

The usual computation takes the matrix square root of S1 S2. With fewer samples than features that
product is singular. Rounding makes 1e-13 of its zero eigenvalues, whose square root is 3e-7, so
that over 2,048 features the distance comes out too small by 4e-4. It is then negative for identical
sets, and complex or infinite with some versions of SciPy. Here the covariances are never formed.
Let A and B be the centred features divided by sqrt(n - 1). Then S1 = A'A and S2 = B'B, and the
trace of the root is the sum of the singular values of A B'. Their rounding error is 1e-16 of the
largest one; the error of square roots of eigenvalues is 1e-8 of it. Where there are more samples
than features, the triangular factor of A's QR decomposition takes the place of A.

Of more than EXACT_OBJECTS objects the jackknife leaves out groups of them, and features come in
parts (`GroupedMoments`): of a group only sums are kept, and what is left without it is a
difference. The factor is then that of a pivoted Cholesky decomposition. Neither cost nor memory
grows with the objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats

EXACT_OBJECTS = 60  # up to so many objects, the jackknife leaves out each by itself
GROUPS = 30  # the most groups that more objects are divided into, which are left out instead
_GROUP_SEED = 0  # decides which objects make a group
_EPSILON = float(np.finfo(np.float64).eps)  # relative distance of neighbouring numbers


class TooFewSamples(ValueError):
    """The error for a set of fewer than two samples, which has no covariance."""


class Moments(NamedTuple):
    """The sums over rows about a centre, to which others about the same centre can be added.

    n         how many rows
    total     float64 [d], the sum of x - centre
    products  float64 [d, d], the sum of (x - centre)(x - centre)'
    """

    n: int
    total: Floats
    products: Floats


class Centred(NamedTuple):
    """The moments of one feature set, in the form in which the distance is computed.

    mean    float64 [d]
    factor  float64 [min(n, d), d]; factor.T @ factor is the covariance (ddof 1)
    """

    mean: Floats
    factor: Floats


def frechet_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the Fréchet distance of two sets of features; lower is better, symmetric.

    Everything is computed in float64, and the order of the rows does not matter. The distance is
    exact even where n or m <= d and a covariance is singular. But small sets are far from each
    other even when they come from one distribution: two sets of 100 standard normal vectors of
    2,048 features have a distance of 3,390. So compare distances only at equal n and m.

    Parameters
    ----------
    x : array of real numbers, [n, d], n >= 2
        Features of one set, any real dtype.
    y : array of real numbers, [m, d], m >= 2
        Features of the other set.

    Returns
    -------
    float
        Distance >= 0, in the unit of the features squared; 0 for equal moments.

    Raises
    ------
    TooFewSamples
        Where a set has fewer than two rows.
    ValueError
        Where an array is not [n, d], where the numbers of features differ, and where values are not
        finite or their squares overflow.
    """
    return centred_to_frechet(centred(x), centred(y))


def centred(features: NDArray[Any]) -> Centred:
    """Return the moments of one set [n, d], which can be kept where it is compared with many.

    Raises as `frechet_distance` does.
    """
    return _centred(checked_set(features))


def centred_to_frechet(a: Centred, b: Centred) -> float:
    """Return the distance of two sets, computed from their moments; it is >= 0.

    Raises ValueError where the numbers of features differ.
    """
    if a.mean.shape != b.mean.shape:
        raise ValueError(f"sets of {a.mean.size} and {b.mean.size} features cannot be compared")
    shift = a.mean - b.mean
    roots = np.linalg.svd(a.factor @ b.factor.T, compute_uv=False)
    distance = shift @ shift + np.vdot(a.factor, a.factor) + np.vdot(b.factor, b.factor)
    distance -= 2.0 * roots.sum()
    return max(float(distance), 0.0)  # rounding may make it negative where the sets are equal


class JackknifeMoments:
    """A feature set whose blocks of objects can be left out, one at a time.

    The features are kept in the type that they have, as float32, and are converted to float64 some
    rows at a time.

    groups  [n], the object that each row shows
    whole   the moments of all rows
    """

    def __init__(self, features: NDArray[Any], groups: NDArray[Any]) -> None:
        """Take the features [n, d], and the object [n] that each row shows.

        Raises as `frechet_distance`, and ValueError for groups that are not [n].
        """
        self._features = checked_set(features)
        self.groups = np.asarray(groups)
        n = len(self._features)
        if self.groups.shape != (n,):
            raise ValueError(f"{n} rows need groups of shape [{n}], got {list(self.groups.shape)}")
        self.whole = _centred(self._features)

    @property
    def has_rows(self) -> bool:
        """Return whether the factor of the whole set is its centred rows, and no triangle."""
        return len(self.whole.factor) == len(self._features)

    def without_blocks(self, member: NDArray[np.intp], count: int) -> Iterator[Centred]:
        """Return the moments without each block's rows, in the order of blocks 0 .. count - 1.

        member  [n], the block of each row; a block may have no row here

        Raises TooFewSamples: fewer than two rows left.
        """
        moments = GroupedMoments(count)
        moments.add(self._features, member)
        return moments.without_each()


class GroupedMoments:
    """A feature set that comes in parts, and of which groups of objects can be left out.

    All sums are about one centre, the mean of the first part: those of features far from 0 would
    lose their digits. Rows of a group wait as they come, float32 say, until they are more than the
    features; the sums of 30 groups of 2,048 features would take 1 GB.
    """

    def __init__(self, count: int) -> None:
        """Take the number of groups."""
        self._centre: Floats | None = None
        self._whole: Moments | None = None
        self._waiting: list[list[NDArray[Any]]] = [[] for _ in range(count)]
        self._taken: list[Moments | None] = [None] * count  # of rows that wait no longer

    def __len__(self) -> int:
        """Return the number of groups."""
        return len(self._waiting)

    def add(self, features: NDArray[Any], groups: NDArray[np.intp]) -> None:
        """Add one or more rows [n, d] of groups [n]. Raises ValueError as `frechet_distance`."""
        features = _checked_features(features)
        if self._centre is None:
            self._centre = np.asarray(features.mean(axis=0, dtype=np.float64))
        centre = self._centre
        self._whole = _plus(self._whole, _moments(features, centre))
        order = np.argsort(groups, kind="stable")
        present, starts = np.unique(groups[order], return_index=True)
        for group, rows in zip(present.tolist(), np.split(order, starts[1:]), strict=True):
            waiting = self._waiting[group]
            waiting.append(features[rows])
            if sum(map(len, waiting)) > features.shape[1]:
                fresh = _moments(np.concatenate(waiting), centre)
                self._taken[group] = _plus(self._taken[group], fresh)
                waiting.clear()

    def whole(self) -> Centred:
        """Return the moments of all rows. Raises TooFewSamples: fewer than two rows."""
        _, whole = self._sums()
        return self._about_mean(whole)

    def without_each(self) -> Iterator[Centred]:
        """Yield the moments without each group. Raises TooFewSamples: fewer than two rows left."""
        centre, whole = self._sums()
        for taken, waiting in zip(self._taken, self._waiting, strict=True):
            without = whole if taken is None else _minus(whole, taken)
            if waiting:
                without = _minus(without, _moments(np.concatenate(waiting), centre))
            yield self._about_mean(without)

    def _sums(self) -> tuple[Floats, Moments]:
        """Return the centre and the sums of all rows. Raises TooFewSamples where there are none."""
        if self._centre is None or self._whole is None:
            raise TooFewSamples("a covariance needs at least 2 samples, got 0")
        return self._centre, self._whole

    def _about_mean(self, moments: Moments) -> Centred:
        """Return moments about their own mean, without the directions that are only rounding."""
        if moments.n < 2:
            raise TooFewSamples(f"a covariance needs at least 2 samples, got {moments.n}")
        centre, whole = self._sums()
        shift = moments.total / moments.n
        scatter = moments.products - np.outer(moments.total, shift)
        # A difference is no more exact than the sums of all rows that something was taken off.
        rounding = len(scatter) * _EPSILON * float(whole.products.diagonal().max())
        return Centred(centre + shift, _cholesky(scatter, rounding) / np.sqrt(moments.n - 1))


def grouped_distances(a: GroupedMoments, b: GroupedMoments) -> tuple[float, Floats]:
    """Return the distance of two sets, and the distances [g] when each group is left out.

    The second are all NaN where a set without one of the groups has fewer than two rows. Raises
    TooFewSamples where a whole set has fewer than two rows.
    """
    value = centred_to_frechet(a.whole(), b.whole())
    try:
        pairs = zip(a.without_each(), b.without_each(), strict=True)
        return value, np.array([centred_to_frechet(*pair) for pair in pairs])
    except TooFewSamples:
        return value, np.full(len(a), np.nan)


def _moments(rows: NDArray[Any], centre: Floats) -> Moments:
    """Return the sums of rows [n, d] about a centre."""
    shifted = rows.astype(np.float64) - centre
    return Moments(len(rows), shifted.sum(axis=0), shifted.T @ shifted)


def _plus(known: Moments | None, fresh: Moments) -> Moments:
    if known is None:
        return fresh
    return Moments(known.n + fresh.n, known.total + fresh.total, known.products + fresh.products)


def _minus(whole: Moments, part: Moments) -> Moments:
    return Moments(whole.n - part.n, whole.total - part.total, whole.products - part.products)


def _cholesky(scatter: Floats, rounding: float) -> Floats:
    """Return a factor [r, d] of a scatter [d, d], of the pivots above `rounding`."""
    # A moment to import, which most commands need not.
    from scipy.linalg.lapack import dpstrf  # pyright: ignore[reportAttributeAccessIssue] (stub gap)

    triangle, order, rank, _ = dpstrf(scatter, rounding)
    pivots = triangle.diagonal()[:rank] ** 2
    rank = np.count_nonzero(pivots > rounding)  # LAPACK takes a first pivot of any size
    factor = np.empty((rank, len(scatter)))
    factor[:, order - 1] = np.triu(triangle[:rank])  # numbered from 1
    return factor


def object_blocks(objects: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Return the names of the objects, sorted, and for each the block that it is left out with.

    Up to `EXACT_OBJECTS` objects are a block each. More objects, G of them, are divided into
    ceil(G / k) blocks of k = ceil(G / GROUPS) objects, or k - 1, in the order of a checksum of
    their names, which depends on neither the results nor the alphabet. To leave out blocks
    estimates the same variance (Miller 1974, "the grouped jackknife") at a bounded cost. The
    standard error that comes of g blocks has a relative error of about 1 / sqrt(2 g), which is 13
    to 15 % here; intervals allow for it by Student's quantile.
    """
    names = np.unique(objects)
    if len(names) <= EXACT_OBJECTS:
        return names, np.arange(len(names))
    size = -(-len(names) // GROUPS)
    parts = np.array_split(np.argsort([_digest(name) for name in names]), -(-len(names) // size))
    block = np.empty(len(names), np.intp)
    for number, part in enumerate(parts):
        block[part] = number
    return names, block


def _digest(name: Any) -> int:
    """Return a whole number of 8 bytes that depends on a name and on the seed of the groups."""
    text = f"{_GROUP_SEED} {name}".encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "big")


def left_out_distances(a: JackknifeMoments, b: JackknifeMoments) -> Floats:
    """Return the distances [g] of two sets when each block of objects is left out of both.

    The blocks are those of `object_blocks` for the objects of both sets, in their order. All
    distances are NaN where a set without one of the blocks has fewer than two rows. Where both sets
    have fewer rows than features, the products of all rows are computed once, and for each block
    only the singular values of at most [n, m] numbers. `bench.analysis.sets.Distance` makes
    intervals of the distances.
    """
    names, block = object_blocks(np.concatenate([np.unique(a.groups), np.unique(b.groups)]))
    count = int(block.max()) + 1
    in_a, in_b = (block[np.searchsorted(names, side.groups)] for side in (a, b))
    try:
        if a.has_rows and b.has_rows:
            return _leave_out_rows(a.whole, b.whole, in_a, in_b, count)
        pairs = zip(a.without_blocks(in_a, count), b.without_blocks(in_b, count), strict=True)
        return np.array([centred_to_frechet(*pair) for pair in pairs])
    except TooFewSamples:
        return np.full(count, np.nan)


def _leave_out_rows(
    a: Centred, b: Centred, in_a: NDArray[np.intp], in_b: NDArray[np.intp], count: int
) -> Floats:
    """Return the distances [g] when each block is left out, where the factors are centred rows.

    The rows that are left have another mean, so that they are centred again by subtracting it. The
    same can be done with their products: the rows and columns of A B' that are left out are
    dropped, and the means of the others subtracted. The rounding error is that of the distance of
    the whole sets, 1e-16 of their traces.
    """
    products = a.factor @ b.factor.T
    kept_a, kept_b = (np.arange(count)[:, None] != member for member in (in_a, in_b))
    means_a, traces_a = _moments_without(a, kept_a)
    means_b, traces_b = _moments_without(b, kept_b)
    distances = ((means_a - means_b) ** 2).sum(axis=1) + traces_a + traces_b
    for i, (rows, columns) in enumerate(zip(kept_a, kept_b, strict=True)):
        left = products[np.ix_(rows, columns)]
        left -= left.mean(axis=0)
        left -= left.mean(axis=1, keepdims=True)
        roots = np.linalg.svd(left, compute_uv=False)
        distances[i] -= 2.0 * roots.sum() * _growth(rows) * _growth(columns)
    return np.maximum(distances, 0.0)


def _moments_without(whole: Centred, kept: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return the means [g, d], and the traces of the covariances [g], when rows are left out.

    kept  [g, n], which rows are kept

    Raises TooFewSamples where fewer than two rows are kept.
    """
    n_kept = kept.sum(axis=1)
    if n_kept.min() < 2:
        raise TooFewSamples(f"{n_kept.min()} rows are left")
    scale = np.sqrt(kept.shape[1] - 1)
    shift = kept.astype(np.float64) @ whole.factor / n_kept[:, None]
    squares = np.einsum("nd,nd->n", whole.factor, whole.factor)
    traces = kept.astype(np.float64) @ squares - n_kept * np.einsum("gd,gd->g", shift, shift)
    growth = np.array([_growth(rows) for rows in kept])
    return whole.mean + shift * scale, traces * growth**2


def _growth(kept: NDArray[np.bool_]) -> float:
    """Return sqrt((n - 1) / (n' - 1)), which rescales a factor to the n' rows that are kept."""
    return float(np.sqrt((len(kept) - 1) / (kept.sum() - 1)))


def checked_set(features: NDArray[Any]) -> NDArray[Any]:
    """Return features [n, d] after checks.

    Raises TooFewSamples for fewer than two rows, and ValueError as `frechet_distance`.
    """
    features = _checked_features(features)
    if len(features) < 2:
        shape = f"{features.dtype} {list(features.shape)}"
        raise TooFewSamples(f"a covariance needs at least 2 samples, got {shape}")
    return features


def _checked_features(features: NDArray[Any]) -> NDArray[Any]:
    """Return features [n, d] after checks, in a type whose values float64 can hold.

    Raises ValueError as `frechet_distance`.
    """
    features = np.asarray(features)
    shape = f"{features.dtype} {list(features.shape)}"
    if features.dtype.kind not in "fiu":
        raise ValueError(f"features must be real numbers, got {shape}")
    if features.ndim != 2 or features.shape[1] == 0:
        raise ValueError(f"features must be [n, d], got {shape}")
    if features.dtype.itemsize > 8:
        # A value that only longdouble can hold becomes infinite, and is refused below.
        with np.errstate(over="ignore"):
            features = features.astype(np.float64)
    n_bad = features.size - np.count_nonzero(np.isfinite(features))
    if n_bad:
        raise ValueError(f"{n_bad} of {features.size} feature values are not finite")
    largest = max(float(features.max()), -float(features.min())) if features.size else 0.0
    if largest > 1e150:  # its square would leave the range of float64
        raise ValueError(f"features up to {largest:.3g} have no finite covariance; scale them down")
    return features


def _centred(features: NDArray[Any]) -> Centred:
    """Return the moments of a set [n, d].

    The factor is the centred rows, or a d x d triangle where there are more rows than features.
    """
    n, d = features.shape
    rows = features.astype(np.float64)
    mean = rows.mean(axis=0)
    rows -= mean
    factor = rows if n <= d else np.asarray(np.linalg.qr(rows, mode="r"))
    return Centred(mean, factor / np.sqrt(n - 1))
