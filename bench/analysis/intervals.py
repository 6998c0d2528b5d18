"""Intervals over objects: objects are independent, the views of one object are not.

The mean over classes is the paper's AVERAGE: every class counts alike, however many objects.
Classes are fixed, and intervals draw objects within them. Means have a studentised bootstrap,
distances of sets a jackknife. Below FEWEST objects there is no interval: `docs/protocol.md` has the
rates at which a true null is rejected.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from data_prep.arrays import Floats

FEWEST = 8  # objects with an interval
# Objects of a class that are resampled, also for p values (`bench.analysis.paired`). The mean of
# more is so nearly normal that Student's t says the same: a skewness of g moves an end of the
# interval by 1.45 g / sqrt(n) standard errors (Edgeworth), at 401 objects by 4 % of its half for a
# skewness of 1, and 2,000 resamples are themselves uncertain by 3 % of it.
MOST_RESAMPLED = 400
RESAMPLES = 2000
SEED = 0
AT_ONCE = 2**16  # numbers of the resamples that are in memory: little

NONE = float("nan"), float("nan")


class StandardError(NamedTuple):
    """The standard error of a mean over classes, with the degrees of freedom of its estimate.

    These are Welch and Satterthwaite's; with one class, the number of objects less one.
    """

    error: float
    freedom: float

    @property
    def reach(self) -> float:
        """Return half of the t interval of 95 %."""
        return self.error * float(stdtrit(self.freedom, 0.975))

    def p_value(self, value: float) -> float:
        """Return the two-sided p value of a true value of 0, by the t distribution."""
        if value == 0 or self.error == 0:
            return float(value == 0)
        return float(2 * stdtr(self.freedom, -abs(value) / self.error))


def mean_interval(per_object: Floats) -> tuple[float, float]:
    """Return the 95 % interval (low, high) of the mean of one value per object [G].

    It is the `interval_of_means` of one class.
    """
    return interval_of_means([per_object])


def interval_of_means(per_object: Sequence[Floats], at_once: int = AT_ONCE) -> tuple[float, float]:
    """Return the 95 % interval (low, high) of the mean over classes of the means over objects.

    per_object  one value per object [G] of each class
    at_once     numbers of the resamples in memory

    It is a studentised bootstrap (Efron and Tibshirani 1993, section 12.5), widened to the t
    interval where that is wider, as where most values are equal. The resamples depend on the
    numbers of objects alone, so that methods measured on the same objects are resampled alike and
    their intervals are paired. Where every class has more than MOST_RESAMPLED objects it is the t
    interval alone. (nan, nan) below FEWEST objects, without a class, where a class
    has fewer than 2 objects, and where a value is not finite.
    """
    error = mean_error(per_object)
    if error is None:
        return NONE
    value = float(np.mean([values.mean() for values in per_object]))
    if all(np.ptp(values) == 0 for values in per_object):  # exact, where resampled sums would round
        value = float(np.mean([values[0] for values in per_object]))
        return value, value
    if min(map(len, per_object)) > MOST_RESAMPLED:
        return value - error.reach, value + error.reach
    means, variances = np.zeros(RESAMPLES), np.zeros(RESAMPLES)
    for number, values in enumerate(per_object):
        rng = np.random.default_rng((SEED, number))  # one class says nothing about the next
        drawn_means, drawn_variances = _resampled(values - values.mean(), rng, at_once)
        means += drawn_means
        variances += drawn_variances
    # Resamples of equal values have no error of their own; rounding leaves a little.
    spread = np.sqrt(variances) / len(per_object) > 1e-9 * error.error
    if not spread.any():
        return value - error.reach, value + error.reach
    low, high = np.percentile(means[spread] / np.sqrt(variances[spread]), [2.5, 97.5])
    below, above = max(high * error.error, error.reach), max(-low * error.error, error.reach)
    return float(value - below), float(value + above)


def median_interval(
    values: Floats, objects: NDArray[Any], at_once: int = AT_ONCE
) -> tuple[float, float]:
    """Return the 95 % percentile-bootstrap interval (low, high) of the median of values [n].

    `objects` [n] names the object of each value; objects are drawn with all their values. The
    resamples depend on the number of objects alone, like those of `mean_interval`. (nan, nan) below
    FEWEST objects and where a value is not finite.
    """
    names, member = np.unique(objects, return_inverse=True)
    if len(names) < FEWEST or not np.isfinite(values).all():
        return NONE
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
    """Return the 95 % interval (low, high) of a mean over classes of distances of sets, unclipped.

    value          the mean over the classes; with one class, its distance
    leave_one_out  for each class the distances without each block of objects [g]

    It is the t interval with `jackknife_error`. (nan, nan) without such an error.

    Why not the bootstrap, as for the means: it draws objects twice, and repeated rows shrink the
    covariance and its rank. A Fréchet distance grows when sets get smaller, so that every replicate
    lies above the estimate and the percentile interval may exclude the very value it belongs to.
    Leaving out one object in g changes the size, and with it the bias, by 1 in g only. Neither
    method removes the bias: the interval shows how far this number would move with other objects,
    not where the distance of infinite sets lies.
    """
    error = jackknife_error(leave_one_out)
    return (value - error.reach, value + error.reach) if error else NONE


def clipped(interval: tuple[float, float], values: tuple[float, float]) -> tuple[float, float]:
    """Return an interval (low, high) without what lies outside the values (least, largest).

    NaN stays. Clipped, not made on a transformed scale: ends that are possible stay where they are.
    """
    low, high = np.clip(interval, *values)
    return float(low), float(high)


def distance_interval(value: float, leave_one_out: Floats) -> tuple[float, float]:
    """Return the `jackknife_interval` of one distance that is never below 0, clipped there."""
    return clipped(jackknife_interval(value, [leave_one_out]), (0.0, np.inf))


def debiased(value: float, leave_one_out: Floats) -> float:
    """Return a distance as it would be with infinitely many objects, by the jackknife.

    Extrapolated in 1 / g: g value - (g - 1) mean(leave_one_out) (Quenouille 1956). NaN without a
    `jackknife_error`.
    """
    if not _enough([leave_one_out]):
        return float("nan")
    return float(len(leave_one_out) * value - (len(leave_one_out) - 1) * leave_one_out.mean())


def mean_error(per_object: Sequence[Floats]) -> StandardError | None:
    """Return the standard error of the mean over classes of the means over objects.

    None where `interval_of_means` has no interval. That interval is at least the t interval of this
    error.
    """
    if not _enough(per_object):
        return None
    return _standard_error([v.var(ddof=1) / len(v) for v in per_object], per_object)


def sum_error(errors: Sequence[StandardError | None]) -> StandardError | None:
    """Return the error of a sum or difference of independent estimates; None where one is None."""
    known = [error for error in errors if error is not None]
    if len(known) < len(errors) or not known:
        return None
    total = sum(e.error**2 for e in known)
    parts = sum(e.error**4 / e.freedom for e in known)
    freedom = total**2 / parts if parts > 0 else min(e.freedom for e in known)
    return StandardError(total**0.5, freedom)


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
    counts = [len(values) for values in of_classes]
    if not counts or min(counts) < 2 or sum(counts) < FEWEST:
        return False
    return all(np.isfinite(values).all() for values in of_classes)


def _standard_error(variances: Sequence[float], of_classes: Sequence[Floats]) -> StandardError:
    """Return the error of the mean over classes of estimates with these variances."""
    total = float(sum(variances))
    parts = sum(v**2 / (len(x) - 1) for v, x in zip(variances, of_classes, strict=True))
    least = min(map(len, of_classes)) - 1
    return StandardError(
        total**0.5 / len(of_classes), total**2 / float(parts) if parts > 0 else float(least)
    )


def _resampled(values: Floats, rng: np.random.Generator, at_once: int) -> tuple[Floats, Floats]:
    """Return the means of RESAMPLES draws of all values, and the squares of their errors."""
    means, squares = np.empty(RESAMPLES), np.empty(RESAMPLES)
    rows = max(1, at_once // len(values))
    for start in range(0, RESAMPLES, rows):
        part = slice(start, start + rows)
        count = min(rows, RESAMPLES - start)
        drawn = values[rng.integers(len(values), size=(count, len(values)))]
        means[part] = drawn.mean(axis=1)
        squares[part] = drawn.var(axis=1, ddof=1) / len(values)
    return means, squares
