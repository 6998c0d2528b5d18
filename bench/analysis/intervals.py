"""Intervals and p values over objects: objects are independent, the views of one object are not.

The mean over classes is the paper's AVERAGE: every class counts alike, however many objects.
Classes are fixed, and objects are drawn within them. A `StandardError` gives both the interval and
the p value of an estimate, so that 0 is outside the interval of 1 - alpha exactly where the p value
is below alpha. Below FEWEST objects there is neither.
`tests/bench/analysis/test_intervals.py` has the rates at which they hold the true value.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from data_prep.arrays import Floats

FEWEST = 8  # objects that an interval or a p value needs at least
# Below so many objects the interval of a method of which images failed is marked. Of a method that
# fails on every twentieth object, the interval holds the true mean in 43 to 71 % of samples of 8 to
# 24 objects, but in 95 % of samples of 60 objects (`studies/interval_coverage.py`).
FEWEST_WITH_FAILURES = 60
SIGNIFICANCE = 0.05  # alpha: an interval of 95 % misses the true value so often
RESAMPLES = 2000  # resamples of a bootstrap
SEED = 0  # of the bootstrap: the same values give the same interval
RESAMPLED_AT_ONCE = 2**16  # values of the resamples that are in memory at a time, some 1 MB

NO_INTERVAL = float("nan"), float("nan")  # (low, high) where there is no interval


def may_miss(failed: bool, objects: int) -> bool:
    """Return whether an interval may well miss the true value: images failed, objects are few."""
    return failed and objects < FEWEST_WITH_FAILURES


class StandardError(NamedTuple):
    """The standard error of an estimate over objects: its interval and its p value follow from it.

    They are Student's, with the end at the longer tail of a skewed estimate moved out by the first
    term of its Edgeworth expansion (Johnson, Journal of the American Statistical Association 73,
    1978): by |skewness| (2 t^2 + 1) / 6 standard errors for a quantile of t. The other end stays.

    error     the standard error
    freedom   its degrees of freedom: the number of objects less one, for a mean over classes by
              Welch and Satterthwaite
    skewness  skewness of the estimate, enlarged where it is known from few objects
    """

    error: float
    freedom: float
    skewness: float = 0.0

    def interval(self, value: float, alpha: float = SIGNIFICANCE) -> tuple[float, float]:
        """Return the interval (low, high) of a value, which misses the true one in `alpha`."""
        t = -float(stdtrit(self.freedom, alpha / 2))
        longer = self.skewness * (2 * t**2 + 1) / 6
        below, above = t + max(-longer, 0.0), t + max(longer, 0.0)
        return value - below * self.error, value + above * self.error

    def p_value(self, value: float) -> float:
        """Return the two-sided p value of the hypothesis that the true value is 0.

        It is the alpha whose interval ends at 0.
        """
        if value == 0 or self.error == 0:
            return float(value == 0)
        longer = max(-self.skewness if value > 0 else self.skewness, 0.0)  # of the tail towards 0
        beyond = max(abs(value) / self.error - longer / 6, 0.0)  # = t + longer t^2 / 3
        t = 2 * beyond / (1 + (1 + 4 / 3 * longer * beyond) ** 0.5)
        return float(2 * stdtr(self.freedom, -t))


def mean_interval(*per_object: Floats, alpha: float = SIGNIFICANCE) -> tuple[float, float]:
    """Return the interval (low, high) of the mean over classes of the means over objects.

    per_object  one value per object [G], for each class

    It is the interval of `mean_error`, and (nan, nan) where that returns None.
    """
    error = mean_error(per_object)
    if error is None:
        return NO_INTERVAL
    return error.interval(float(np.mean([values.mean() for values in per_object])), alpha)


def median_interval(
    values: Floats, objects: NDArray[Any], at_once: int = RESAMPLED_AT_ONCE
) -> tuple[float, float]:
    """Return the 95 % percentile-bootstrap interval (low, high) of the median of values [n].

    `objects` [n] names the object of each value; objects are drawn with all their values. The
    resamples depend on the number of objects alone, so that methods measured on the same objects
    are resampled alike. (nan, nan) below FEWEST objects and where a value is not finite.
    """
    names, member = np.unique(objects, return_inverse=True)
    if len(names) < FEWEST or not np.isfinite(values).all():
        return NO_INTERVAL
    order = np.argsort(values, kind="stable")
    values, member = values[order], member[order]
    rng = np.random.default_rng(SEED)
    medians = []
    rows = max(1, at_once // len(values))
    for start in range(0, RESAMPLES, rows):
        chosen = rng.integers(len(names), size=(min(rows, RESAMPLES - start), len(names)))
        numbered = chosen + len(names) * np.arange(len(chosen))[:, None]
        times = np.bincount(numbered.ravel(), minlength=chosen.size).reshape(chosen.shape)
        # How many values of the resample have come by the end of each sorted value.
        until = np.take(times.astype(np.int32), member, axis=1).cumsum(axis=1, dtype=np.int32)
        total = until[:, -1:]
        middle = [(until > place).argmax(axis=1) for place in ((total - 1) // 2, total // 2)]
        medians.append(values[middle].mean(axis=0))
    low, high = np.percentile(np.concatenate(medians), [2.5, 97.5])
    return float(low), float(high)


def jackknife_interval(value: float, leave_one_out: Sequence[Floats]) -> tuple[float, float]:
    """Return the interval (low, high) of a mean over classes of distances of sets, unclipped.

    value          the mean over the classes; with one class, its distance
    leave_one_out  for each class the distances without each block of objects [g]

    It is the interval of `jackknife_error`, and (nan, nan) where that returns None.

    Why not the bootstrap: it draws objects twice, and repeated rows shrink the
    covariance and its rank. A Fréchet distance grows when sets get smaller, so that every replicate
    lies above the estimate and the percentile interval may exclude the very value it belongs to.
    Leaving out one object in g changes the size, and with it the bias, by 1 in g only. Neither
    method removes the bias: the interval shows how far this number would move with other objects,
    not where the distance of infinite sets lies.
    """
    error = jackknife_error(leave_one_out)
    return error.interval(value) if error else NO_INTERVAL


def clipped(interval: tuple[float, float], values: tuple[float, float]) -> tuple[float, float]:
    """Return an interval (low, high) without the part that no value can have.

    values  the least and the largest value that are possible

    NaN stays NaN. Clipping leaves an end that is possible where it is, which an interval on a
    transformed scale would move.
    """
    low, high = np.clip(interval, *values)
    return float(low), float(high)


def mean_error(per_object: Sequence[Floats]) -> StandardError | None:
    """Return the standard error of the mean over classes of the means over objects.

    None below FEWEST objects, without a class, where a class has fewer than 2 objects, and where a
    value is not finite.
    """
    if not _enough(per_object):
        return None
    variances = [values.var(ddof=1) / len(values) for values in per_object]
    error = _standard_error(variances, per_object)
    if error.error == 0:
        return error
    third = sum(map(_third_moment_of_mean, per_object)) / sum(variances) ** 1.5
    # A sample of few objects rarely has one from the long tail, so that it looks less skewed than
    # the distribution is: the skewness is enlarged.
    return error._replace(skewness=float(third) * (1 + 8 / (error.freedom + 1)))


def _third_moment_of_mean(values: Floats) -> float:
    """Return the unbiased third central moment of the mean of values [n]; 0 for fewer than 3."""
    count = len(values)
    if count < 3:
        return 0.0
    return float(np.sum((values - values.mean()) ** 3) / (count * (count - 1) * (count - 2)))


def jackknife_error(leave_one_out: Sequence[Floats]) -> StandardError | None:
    """Return the standard error of a mean over classes of distances.

    The classes are independent, so their variances (g - 1) / g sum((theta_i - mean)^2) (Efron and
    Stein 1981) add up, over the square of their number. None below FEWEST blocks, without a class,
    where a class has fewer than 2 blocks, and where a distance is not finite.
    """
    if not _enough(leave_one_out):
        return None
    variances = [(len(d) - 1) / len(d) * np.sum((d - d.mean()) ** 2) for d in leave_one_out]
    return _standard_error(variances, leave_one_out)


def _enough(of_classes: Sequence[Floats]) -> bool:
    """Return whether the values of each class are finite, and enough for a standard error."""
    counts = [len(values) for values in of_classes]
    if not counts or min(counts) < 2 or sum(counts) < FEWEST:
        return False
    return all(np.isfinite(values).all() for values in of_classes)


def _standard_error(variances: Sequence[float], of_classes: Sequence[Floats]) -> StandardError:
    """Return the error of the mean over classes of estimates with these variances."""
    total = float(sum(variances))
    parts = 0.0  # the denominator of Welch and Satterthwaite's degrees of freedom
    for variance, values in zip(variances, of_classes, strict=True):
        parts += variance**2 / (len(values) - 1)
    least = float(min(map(len, of_classes)) - 1)  # for classes in which all values are equal
    freedom = total**2 / float(parts) if parts > 0 else least
    return StandardError(total**0.5 / len(of_classes), freedom)
