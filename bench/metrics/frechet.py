"""Fréchet distance of two feature sets, exact for any number of samples and never complex.

    |m1 - m2|^2 + tr S1 + tr S2 - 2 tr sqrt(S1 S2)

is the squared 2-Wasserstein distance of the Gaussians with the moments of the two sets (Dowson and
Landau 1982; Heusel et al. 2017, https://arxiv.org/abs/1706.08500, which call it FID when the
features are those of `bench.metrics.inception`). S is the unbiased covariance (ddof 1).

The usual route takes the matrix square root of S1 S2. With fewer samples than features that
product is singular, and the square root of a zero eigenvalue that rounding has made 1e-13 is 3e-7:
over 2,048 features the distance comes out too small by 4e-4, negative for identical sets, and
complex or infinite with some versions of SciPy. Here the covariances are never formed. With A and B
the centred features over sqrt(n - 1), S1 = A'A and S2 = B'B, and the trace of the root is the sum
of the singular values of A B'. Their rounding is 1e-16 of the largest one, where that of a square
root of eigenvalues is 1e-8 of it. Where there are more samples than features, A stands for the
triangular factor of its QR decomposition.

Moments in that form can be merged (`_merged`), exactly and in any order, so that features may come
in blocks and the memory that they take is that of one block and of d x d numbers. Of more than
EXACT_OBJECTS objects the jackknife leaves out groups of them, whose moments are made so
(`GroupedMoments`): neither its cost nor its memory grows with the objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats

EXACT_OBJECTS = 60  # that the jackknife leaves out one after the other
GROUPS = 30  # at most, that it leaves out of more objects
_GROUP_SEED = 0
_ROWS = 4096  # taken at a time: little memory
_MOST_KEPT = 2**21  # numbers of the moments that a set may keep: 16 MB
_WAITING = 1024  # rows of a group that are kept as they are before they become moments
_PANEL = 32  # columns that LAPACK reduces at a time


class TooFewSamples(ValueError):
    """The error for a set of fewer than two samples, which has no covariance."""


class Moments(NamedTuple):
    """The moments of rows, to which others may be added.

    n     how many rows; of none, `mean` is 0 and `root` has no row
    mean  float64 [d]
    root  float64 [at most d, d]; root.T @ root is the sum of (x - mean)(x - mean)' over the rows
    """

    n: int
    mean: Floats
    root: Floats


class Centred(NamedTuple):
    """The moments of one feature set, in the form that loses nothing.

    mean    float64 [d]
    factor  float64 [min(n, d), d]; factor.T @ factor is the covariance (ddof 1)
    """

    mean: Floats
    factor: Floats


def frechet_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Return the Fréchet distance of two sets of features; lower is better, symmetric.

    Everything is computed in float64, and the order of the rows does not matter. Exact also where n
    or m <= d (rank deficient); but small sets lie apart even if drawn from one distribution (3,390
    for 2 x 100 standard normal vectors of 2,048 features), so compare values only at equal n and m.

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
    """Return the moments of one set [n, d], to be kept where one set is compared with many.

    Raises as `frechet_distance` does.
    """
    return _centred(checked_set(features))


def _merged(a: Moments, b: Moments) -> Moments:
    """Return the moments of the rows of both: exact, whatever the counts; no rows change nothing.

    The pairwise update of Chan, Golub and LeVeque 1983 on factors instead of covariances: below
    each other stand both roots and the row sqrt(n m / (n + m)) (mean_b - mean_a), whose square is
    what the scatter of the whole has beyond those of its parts. Rounding grows with the logarithm
    of the number of merges in a tree, with their number in a row: 1e-16 of the trace each.

    Raises ValueError where d differs.
    """
    if a.mean.shape != b.mean.shape:
        raise ValueError(f"rows of {a.mean.size} and {b.mean.size} features cannot be merged")
    if not a.n or not b.n:
        return a if a.n else b
    share = b.n / (a.n + b.n)
    shift = b.mean - a.mean
    between = np.sqrt(a.n * share) * shift
    root = _triangle(np.concatenate([a.root, b.root, between[None]]))
    return Moments(a.n + b.n, a.mean + share * shift, root)


def centred_to_frechet(a: Centred, b: Centred) -> float:
    """Return the distance of two sets from their moments; >= 0.

    Raises ValueError where d differs.
    """
    if a.mean.shape != b.mean.shape:
        raise ValueError(f"sets of {a.mean.size} and {b.mean.size} features cannot be compared")
    shift = a.mean - b.mean
    roots = np.linalg.svd(a.factor @ b.factor.T, compute_uv=False)
    distance = shift @ shift + np.vdot(a.factor, a.factor) + np.vdot(b.factor, b.factor)
    distance -= 2.0 * roots.sum()
    return max(float(distance), 0.0)  # the rounding of two equal traces may fall below 0


class JackknifeMoments:
    """A feature set whose blocks of objects can be left out, one at a time.

    Keeps the features as they come, float32 say; they are taken to float64 some rows at a time.

    groups  [n], the object that each row shows
    whole   the moments of all rows
    """

    def __init__(self, features: NDArray[Any], groups: NDArray[Any]) -> None:
        """Take features [n, d] and their groups [n].

        Raises as `frechet_distance`, and ValueError for groups that are not [n].
        """
        self._features = checked_set(features)
        self.groups = np.asarray(groups)
        n = len(self._features)
        if self.groups.shape != (n,):
            raise ValueError(f"{n} rows need groups of shape [{n}], got {list(self.groups.shape)}")
        self.whole = _centred(self._features)
        self._kept: tuple[bytes, GroupedMoments] | None = None

    @property
    def has_rows(self) -> bool:
        """Return whether the factor of the whole set is its rows, not that of a decomposition."""
        return len(self.whole.factor) == len(self._features)

    def without_blocks(self, member: NDArray[np.intp], count: int) -> Iterable[Centred]:
        """Return the moments without each block's rows, in the order of blocks 0 .. count - 1.

        member  [n], the block of each row; a block may have none here

        They are kept for the next call with the same blocks where they are small. Raises
        TooFewSamples: fewer than two rows left.
        """
        blocks = member.tobytes()
        if self._kept is None or self._kept[0] != blocks:
            self._kept = blocks, GroupedMoments(count)
            self._kept[1].add(self._features, member)
        return self._kept[1].without_each()


class GroupedMoments:
    """A feature set that comes in parts, and of which groups of objects can be left out.

    Rows wait as they come, float32 say, until a group has _WAITING of them, or as many as features.
    Then they are merged into its moments.
    """

    def __init__(self, count: int) -> None:
        """Take the number of groups."""
        self._waiting: list[list[NDArray[Any]]] = [[] for _ in range(count)]
        self._moments: list[Moments | None] = [None] * count
        self._merged: dict[tuple[int, int], Moments] = {}  # of consecutive groups
        self._whole: Centred | None = None
        self._kept: list[Centred] | None = None

    def add(self, features: NDArray[Any], groups: NDArray[np.intp]) -> None:
        """Add rows [n, d] of the groups [n]. Raises ValueError as `frechet_distance`."""
        features = _checked_features(features)
        self._merged, self._whole, self._kept = {}, None, None
        order = np.argsort(groups, kind="stable")
        present, starts = np.unique(groups[order], return_index=True)
        for group, rows in zip(present.tolist(), np.split(order, starts[1:]), strict=True):
            waiting = self._waiting[group]
            waiting.append(features[rows])
            if sum(map(len, waiting)) > max(_WAITING, features.shape[1]):
                self._group(group)

    def whole(self) -> Centred:
        """Return the moments of all rows, kept for the next call.

        Raises TooFewSamples: fewer than two rows.
        """
        if self._whole is None:
            self._whole = _to_centred(self._between(0, len(self)))
        return self._whole

    def __len__(self) -> int:
        """Return the number of groups."""
        return len(self._moments)

    def without_each(self) -> Iterable[Centred]:
        """Return the moments without each group, kept for the next call where they are small.

        Raises TooFewSamples: fewer than two rows left.
        """
        if self._kept is not None:
            return self._kept
        without = self._down(0, len(self), self._between(0, 0))
        if self._are_small():
            without = self._kept = list(without)
            self._merged = {}
        return without

    def _down(self, low: int, high: int, outside: Moments) -> Iterator[Centred]:
        """Yield the moments without each group low .. high - 1, from those of what is outside them.

        Halves are added to what is outside them, their halves to that, down to the single groups:
        nothing is ever taken off again, which would cancel, a row is looked at log2(groups) times,
        and as many moments are held at a time.
        """
        if high - low == 1:
            yield _to_centred(outside)
            return
        middle = (low + high) // 2
        for half, other in (((low, middle), (middle, high)), ((middle, high), (low, middle))):
            yield from self._down(*half, _merged_triangles(outside, self._between(*other)))

    def _are_small(self) -> bool:
        return len(self) * self._width() ** 2 <= _MOST_KEPT

    def _between(self, low: int, high: int) -> Moments:
        """Return the moments of groups low .. high - 1, kept where they are small."""
        if high - low < 2:
            return self._group(low) if low < high else _no_rows(self._width())
        if (low, high) in self._merged:
            return self._merged[low, high]
        middle = (low + high) // 2
        rows = _merged_triangles(self._between(low, middle), self._between(middle, high))
        if self._are_small():  # large ones are merged anew
            self._merged[low, high] = rows
        return rows

    def _group(self, group: int) -> Moments:
        """Return the moments of a group. More rows than features do not wait any longer."""
        known, waiting = self._moments[group], self._waiting[group]
        if not waiting:
            return known or _no_rows(self._width())
        fresh = _moments(np.concatenate(waiting))
        rows = _merged(known, fresh) if known else fresh
        if rows.n > rows.mean.size:
            self._moments[group] = rows
            waiting.clear()
        return rows

    def _width(self) -> int:
        """Return the number of features, which any group with rows tells."""
        widths = [m.mean.size for m in self._moments if m]
        widths += [waiting[0].shape[1] for waiting in self._waiting if waiting]
        return widths[0] if widths else 0


def grouped_distances(a: GroupedMoments, b: GroupedMoments) -> tuple[float, Floats]:
    """Return the distance of two sets, and the distances [g] without each of their groups.

    These are all NaN where a group leaves fewer than two rows of a set. Raises TooFewSamples where
    a set has fewer.
    """
    value = centred_to_frechet(a.whole(), b.whole())
    try:
        pairs = zip(a.without_each(), b.without_each(), strict=True)
        return value, np.array([centred_to_frechet(*pair) for pair in pairs])
    except TooFewSamples:
        return value, np.full(len(a), np.nan)


def _merged_triangles(a: Moments, b: Moments) -> Moments:
    """Return `_merged(a, b)`, up to three times as fast where a root is a triangle of d rows."""
    if not _is_triangle(a.root):
        a, b = b, a
    if not _is_triangle(a.root):
        return _merged(a, b)
    from scipy.linalg.lapack import dtpqrt  # a moment to import, which most commands need not

    d = a.mean.size
    share = b.n / (a.n + b.n)
    shift = b.mean - a.mean
    rows, between = b.root, np.sqrt(a.n * share) * shift[None]
    triangular = d if _is_triangle(rows) else 0  # rows of which LAPACK knows that they are one
    if not triangular:
        rows = np.concatenate([rows, between])
    root, *_ = dtpqrt(triangular, min(_PANEL, d), a.root, rows)
    if triangular:
        root, *_ = dtpqrt(0, min(_PANEL, d), root, between)
    return Moments(a.n + b.n, a.mean + share * shift, np.ascontiguousarray(root))


def _is_triangle(root: Floats) -> bool:
    from scipy.linalg import bandwidth

    return root.shape[0] == root.shape[1] > 1 and bandwidth(root)[0] == 0


def object_blocks(objects: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Return the objects' names, sorted, and the block of each, which is left out as one.

    Of up to `EXACT_OBJECTS` objects each is a block. More are dealt to ceil(G / k) groups of k =
    ceil(G / GROUPS) objects, or k - 1, in the order of a digest of their names: whatever the
    results and whatever the names say. Leaving out groups estimates the same variance (Miller 1974,
    "the grouped jackknife"), with a relative error of the standard error of about 1 / sqrt(2 g), 13
    to 15 % here, for which Student's quantile allows; the cost stays bounded.
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
    """Return a number of 8 bytes that depends on a name and on the seed of the groups."""
    text = f"{_GROUP_SEED} {name}".encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "big")


def left_out_distances(a: JackknifeMoments, b: JackknifeMoments) -> Floats:
    """Return the distances [g] without each block of the objects of both sets, in order.

    Blocks are those of `object_blocks`: single objects up to `EXACT_OBJECTS`. All NaN where a block
    leaves fewer than two rows of a set. Intervals are made from them by
    `bench.analysis.sets.Distance`. With fewer rows than features the products of rows
    are shared: g times the singular values of [n, m].
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
    """Return the distances [g] without each block, where the factors are the centred rows.

    Rows that are left are centred by taking off their mean, and so are their products: of A B' as a
    whole, rows and columns are left out and the means of the others taken off. The rounding is that
    of the distance of the whole sets, 1e-16 of their traces.
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
    """Return the mean [g, d] and trace of the covariance [g] of the rows kept [g, n]."""
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
    """Return sqrt((n - 1) / (n' - 1)), which rescales a factor to the rows that are kept."""
    return float(np.sqrt((len(kept) - 1) / (kept.sum() - 1)))


def checked_set(features: NDArray[Any]) -> NDArray[Any]:
    """Return the features after checks; they have at least two rows."""
    features = _checked_features(features)
    if len(features) < 2:
        shape = f"{features.dtype} {list(features.shape)}"
        raise TooFewSamples(f"a covariance needs at least 2 samples, got {shape}")
    return features


def _checked_features(features: NDArray[Any]) -> NDArray[Any]:
    """Return the features after checks, in a type that float64 can hold."""
    features = np.asarray(features)
    shape = f"{features.dtype} {list(features.shape)}"
    if features.dtype.kind not in "fiu":
        raise ValueError(f"features must be real numbers, got {shape}")
    if features.ndim != 2 or features.shape[1] == 0:
        raise ValueError(f"features must be [n, d], got {shape}")
    if features.dtype.itemsize > 8:
        with np.errstate(over="ignore"):  # what only longdouble can hold is named below
            features = features.astype(np.float64)
    n_bad = features.size - np.count_nonzero(np.isfinite(features))
    if n_bad:
        raise ValueError(f"{n_bad} of {features.size} feature values are not finite")
    largest = max(float(features.max()), -float(features.min())) if features.size else 0.0
    if largest > 1e150:  # its square would leave the range of float64
        raise ValueError(f"features up to {largest:.3g} have no finite covariance; scale them down")
    return features


def _centred(features: NDArray[Any]) -> Centred:
    """Return the centred moments; the rows are the factor unless they outnumber the features."""
    n, d = features.shape
    if n > d:
        return _to_centred(_moments(features))
    rows = features.astype(np.float64)
    mean = rows.mean(axis=0)
    return Centred(mean, (rows - mean) / np.sqrt(n - 1))


def _to_centred(moments: Moments) -> Centred:
    """Return the moments of a set. Raises TooFewSamples for fewer than two rows."""
    if moments.n < 2:
        raise TooFewSamples(f"a covariance needs at least 2 samples, got {moments.n}")
    return Centred(moments.mean, moments.root / np.sqrt(moments.n - 1))


def _moments(features: NDArray[Any]) -> Moments:
    """Return the moments of rows [n, d] in float64, some at a time."""
    n, d = features.shape
    whole = _no_rows(d)
    size = max(_ROWS, 4 * d)
    for start in range(0, n, size):
        chosen = features[start : start + size].astype(np.float64)
        mean = chosen.mean(axis=0)
        whole = _merged(whole, Moments(len(chosen), mean, chosen - mean))
    return whole._replace(root=_triangle(whole.root))


def _no_rows(d: int) -> Moments:
    """Return the moments of no rows of d features."""
    return Moments(0, np.zeros(d), np.empty((0, d)))


def _triangle(rows: Floats) -> Floats:
    """Return at most d rows with the same rows.T @ rows: the rows, or the R of their QR."""
    n, d = rows.shape
    return rows if n <= d else np.asarray(np.linalg.qr(rows, mode="r"))
