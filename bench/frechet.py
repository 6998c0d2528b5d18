"""Fréchet distance of two feature sets, exact for any number of samples and never complex.

    |m1 - m2|^2 + tr S1 + tr S2 - 2 tr sqrt(S1 S2)

is the squared 2-Wasserstein distance of the Gaussians with the moments of the two sets (Dowson and
Landau 1982; Heusel et al. 2017, https://arxiv.org/abs/1706.08500, which call it FID when the
features are those of `bench.inception`). S is the unbiased covariance (ddof 1).

The usual route takes the matrix square root of S1 S2. With fewer samples than features that
product is singular, and the square root of a zero eigenvalue that rounding has made 1e-13 is 3e-7:
over 2,048 features the distance comes out too small by 4e-4, negative for identical sets, and
complex or infinite with some versions of SciPy. Here the covariances are never formed. With A and B
the centred features over sqrt(n - 1), S1 = A'A and S2 = B'B, and the trace of the root is the sum
of the singular values of A B'. Their rounding is 1e-16 of the largest one, where that of a square
root of eigenvalues is 1e-8 of it. Where there are more samples than features, A stands for the
triangular factor of its QR decomposition.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_KEPT_FACTOR = 2**20  # bytes: d <= 362; larger ones, one per object, would fill the memory


class TooFewSamples(ValueError):
    """A set of fewer than two samples has no covariance."""


class Centred(NamedTuple):
    """The moments of one feature set, in the form that loses nothing.

    mean    float64 [d]
    factor  float64 [min(n, d), d]; factor.T @ factor is the covariance (ddof 1)
    """

    mean: Floats
    factor: Floats


def frechet_distance(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Fréchet distance of the features x [n, d] and y [m, d]; >= 0, lower is better, symmetric.

    Any real dtype; everything is computed in float64, and the order of the rows does not matter.
    The unit is that of the features squared. Exact also where n or m <= d (rank deficient); but
    small sets lie apart even if drawn from one distribution (3,390 for 2 x 100 standard normal
    vectors of 2,048 features), so compare values only at equal n and m.

    Raises TooFewSamples below two rows, and ValueError where an array is not [n, d], where the
    numbers of features differ, and where values are not finite or their squares overflow.
    """
    return centred_to_frechet(centred(x), centred(y))


def centred(features: NDArray[Any]) -> Centred:
    """The moments of one set [n, d], to be kept where one set is compared with many.

    Raises as `frechet_distance` does.
    """
    return _centred(_to_float64(features))


def centred_to_frechet(a: Centred, b: Centred) -> float:
    """The distance of two sets from their moments; >= 0. Raises ValueError where d differs."""
    if a.mean.shape != b.mean.shape:
        raise ValueError(f"sets of {a.mean.size} and {b.mean.size} features cannot be compared")
    shift = a.mean - b.mean
    roots = np.linalg.svd(a.factor @ b.factor.T, compute_uv=False)
    distance = shift @ shift + np.vdot(a.factor, a.factor) + np.vdot(b.factor, b.factor)
    distance -= 2.0 * roots.sum()
    return max(float(distance), 0.0)  # the rounding of two equal traces may fall below 0


class LeftOut:
    """A feature set, and what is left of it without each of its objects.

    Where one set is compared with many (the ground truth with every method), keep one of these:
    what is computed for one comparison serves the next ones.

    groups  [n], the object that each row shows
    whole   the moments of all rows
    """

    def __init__(self, features: NDArray[Any], groups: NDArray[Any]) -> None:
        """Features [n, d]; raises as `frechet_distance`, and ValueError for groups not [n]."""
        self._features = _to_float64(features)
        self.groups = _labels(groups, len(self._features))
        self.whole = _centred(self._features)
        self._kept: dict[Any, Centred] = {}

    @property
    def has_rows(self) -> bool:
        """Whether the factor of the whole set is its rows, and not that of a decomposition."""
        return len(self.whole.factor) == len(self._features)

    def without(self, group: Any) -> Centred:
        """The moments without the rows of one object. Raises TooFewSamples: fewer than two left."""
        if group not in self._kept:
            left = self._features[self.groups != group]
            if len(left) < 2:
                raise TooFewSamples(f"without {group} {len(left)} rows are left")
            moments = _centred(left)
            if moments.factor.nbytes > _KEPT_FACTOR:
                return moments
            self._kept[group] = moments
        return self._kept[group]


def frechet_interval(
    x: NDArray[Any], y: NDArray[Any], groups_x: NDArray[Any], groups_y: NDArray[Any]
) -> tuple[float, float]:
    """95 % interval (low, high) of `frechet_distance(x, y)`, low >= 0, by a jackknife over groups.

    groups_x [n] and groups_y [m] name the object that each row shows (views of one object are not
    independent). For every object its rows are left out of both sets and the distance is taken
    again: theta_i, i = 1..g. The standard error is sqrt((g - 1) / g * sum((theta_i - mean)^2))
    (Efron and Stein 1981), the interval theta -+ 1.96 standard errors, clipped at 0.

    Why not the bootstrap, as for the means: it draws objects twice, and repeated rows shrink the
    covariance and its rank. A Fréchet distance grows when sets get smaller, so that every replicate
    lies above the estimate and the percentile interval may exclude the very value it belongs to.
    Leaving out one object in g changes the size, and with it the bias, by 1 in g only. Neither
    method removes the bias: the interval tells how far this number would move with other objects,
    not where the distance of infinite sets lies.

    (nan, nan) where no spread can be estimated: fewer than 3 objects, or an object without which
    fewer than two rows of a set remain. Raises as `frechet_distance`, and ValueError where groups
    and rows differ in number. Costs g distances: about 1 ms each for 2 x 500 x 64. With fewer rows
    than features the products of rows are shared: g times the singular values of [n, m].
    """
    return left_out_to_interval(LeftOut(x, groups_x), LeftOut(y, groups_y))


def left_out_to_interval(a: LeftOut, b: LeftOut) -> tuple[float, float]:
    """`frechet_interval` of two sets whose objects can be left out."""
    theta = centred_to_frechet(a.whole, b.whole)
    return interval_of_left_out(theta, left_out_distances(a, b))


def left_out_distances(a: LeftOut, b: LeftOut) -> Floats:
    """The distances theta_i without each object, [g], objects sorted.

    All NaN where an object leaves fewer than two rows of a set.
    """
    groups = np.union1d(a.groups, b.groups)
    try:
        if a.has_rows and b.has_rows:
            return _leave_out_rows(a, b, groups)
        pairs = ((a.without(group), b.without(group)) for group in groups)
        return np.array([centred_to_frechet(*pair) for pair in pairs])
    except TooFewSamples:
        return np.full(len(groups), np.nan)


def interval_of_left_out(theta: float, left_out: Floats) -> tuple[float, float]:
    """The jackknife's interval of a distance `theta`, from the distances without each object [g].

    (nan, nan) for fewer than 3 objects and where a distance is NaN.
    """
    g = len(left_out)
    if g < 3 or not np.isfinite(left_out).all():
        return float("nan"), float("nan")
    error = np.sqrt((g - 1) / g * np.sum((left_out - left_out.mean()) ** 2))
    return max(theta - 1.96 * float(error), 0.0), theta + 1.96 * float(error)


def _leave_out_rows(a: LeftOut, b: LeftOut, groups: NDArray[Any]) -> Floats:
    """The distance without each of the groups, where the factors are the centred rows, [g].

    Rows that are left are centred by taking off their mean, and so are their products: of A B' as a
    whole, rows and columns are left out and the means of the others taken off. The rounding is that
    of the distance of the whole sets, 1e-16 of their traces.
    """
    products = a.whole.factor @ b.whole.factor.T
    kept_a, kept_b = (groups[:, None] != side.groups for side in (a, b))
    means_a, traces_a = _moments_without(a.whole, kept_a)
    means_b, traces_b = _moments_without(b.whole, kept_b)
    distances = ((means_a - means_b) ** 2).sum(axis=1) + traces_a + traces_b
    for i, (rows, columns) in enumerate(zip(kept_a, kept_b, strict=True)):
        left = products[np.ix_(rows, columns)]
        left -= left.mean(axis=0)
        left -= left.mean(axis=1, keepdims=True)
        roots = np.linalg.svd(left, compute_uv=False)
        distances[i] -= 2.0 * roots.sum() * _growth(rows) * _growth(columns)
    return np.maximum(distances, 0.0)


def _moments_without(whole: Centred, kept: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Mean [g, d] and trace of the covariance [g] of the rows that are kept [g, n]."""
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
    """sqrt((n - 1) / (n' - 1)): a factor is over the root of the number of its rows less one."""
    return float(np.sqrt((len(kept) - 1) / (kept.sum() - 1)))


def _labels(groups: NDArray[Any], n: int) -> NDArray[Any]:
    groups = np.asarray(groups)
    if groups.shape != (n,):
        raise ValueError(f"{n} rows need groups of shape [{n}], got {list(groups.shape)}")
    return groups


def _to_float64(features: NDArray[Any]) -> Floats:
    features = np.asarray(features)
    found = f"{features.dtype} {list(features.shape)}"
    if features.dtype.kind not in "fiu":
        raise ValueError(f"features must be real numbers, got {found}")
    if features.ndim != 2 or features.shape[1] == 0:
        raise ValueError(f"features must be [n, d], got {found}")
    if len(features) < 2:
        raise TooFewSamples(f"a covariance needs at least 2 samples, got {found}")
    with np.errstate(over="ignore"):  # what only longdouble can hold is named below
        features = features.astype(np.float64)
    n_bad = features.size - np.count_nonzero(np.isfinite(features))
    if n_bad:
        raise ValueError(f"{n_bad} of {features.size} feature values are not finite")
    largest = max(float(features.max()), -float(features.min()))
    if largest > 1e150:  # its square would leave the range of float64
        raise ValueError(f"features up to {largest:.3g} have no finite covariance; scale them down")
    return features


def _centred(features: Floats) -> Centred:
    n, d = features.shape
    mean = features.mean(axis=0)
    factor = (features - mean) / np.sqrt(n - 1)
    if n > d:
        factor = np.asarray(np.linalg.qr(factor, mode="r"))
    return Centred(mean, factor)
