"""Intervals over objects: the views of one object are not independent, objects are.

The mean over classes is the paper's AVERAGE: every class counts alike, however many objects.
Classes are fixed, objects are drawn: intervals draw objects within their classes.

Means have a studentised bootstrap, distances of sets a jackknife. Below FEWEST objects there is no
interval: `docs/protocol.md` has the rates at which a true null is rejected, by
`studies.interval_coverage`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from data_prep.arrays import Floats

FEWEST = 8  # objects with an interval
RESAMPLES = 2000
SEED = 0
AT_ONCE = 2**16  # numbers of the resamples that are in memory: little

NONE = float("nan"), float("nan")


class StandardError(NamedTuple):
    """Of a mean over classes, with the degrees of freedom of its estimate.

    Welch and Satterthwaite's; the number of objects less one where there is one class.
    """

    error: float
    freedom: float

    @property
    def reach(self) -> float:
        """Half of Student's 95 % interval."""
        return self.error * float(stdtrit(self.freedom, 0.975))

    def p_value(self, value: float) -> float:
        """Of a true value of 0, two-sided, by Student's distribution."""
        if value == 0 or self.error == 0:
            return float(value == 0)
        return float(2 * stdtr(self.freedom, -abs(value) / self.error))


def mean_interval(per_object: Floats) -> tuple[float, float]:
    """95 % interval (low, high) of the mean of one value per object [G].

    As `interval_of_means` of one class.
    """
    return interval_of_means([per_object])


def interval_of_means(per_object: Sequence[Floats]) -> tuple[float, float]:
    """95 % interval (low, high) of the mean over classes of the means over objects.

    per_object  one value per object [G] of each class

    Studentised bootstrap (Efron and Tibshirani 1993, section 12.5), at no side nearer than
    Student's interval, which is the safer one where most values are equal. The resamples depend on
    the numbers of objects alone, so that methods measured on the same objects are resampled alike
    and their intervals are paired. (nan, nan) below FEWEST objects, without a class, where a class
    has fewer than 2 objects, and where a value is not finite.
    """
    found = mean_error(per_object)
    if found is None:
        return NONE
    value = float(np.mean([of.mean() for of in per_object]))
    if all(np.ptp(of) == 0 for of in per_object):  # exact, where resampled sums would round
        value = float(np.mean([of[0] for of in per_object]))
        return value, value
    means, variances = np.zeros(RESAMPLES), np.zeros(RESAMPLES)
    for number, of in enumerate(per_object):
        # One class says nothing about the next.
        drawn = _resampled(of - of.mean(), np.random.default_rng((SEED, number)))
        means += drawn[0]
        variances += drawn[1]
    # Resamples of equal values have no error of their own; rounding leaves a little.
    spread = np.sqrt(variances) / len(per_object) > 1e-9 * found.error
    if not spread.any():
        return value - found.reach, value + found.reach
    low, high = np.percentile(means[spread] / np.sqrt(variances[spread]), [2.5, 97.5])
    below, above = max(high * found.error, found.reach), max(-low * found.error, found.reach)
    return float(value - below), float(value + above)


def median_interval(values: Floats, objects: NDArray[Any]) -> tuple[float, float]:
    """95 % percentile-bootstrap interval (low, high) of the median of values [n], over objects.

    objects [n] names the object of each value; objects are drawn with all their values. As with
    `mean_interval`, the resamples depend on the number of objects alone. (nan, nan) below FEWEST
    objects and where a value is not finite.
    """
    names, member = np.unique(objects, return_inverse=True)
    if len(names) < FEWEST or not np.isfinite(values).all():
        return NONE
    order = np.argsort(values, kind="stable")
    values, member = values[order], member[order]
    rng = np.random.default_rng(SEED)
    medians = []
    at_once = max(1, AT_ONCE // len(values))
    for start in range(0, RESAMPLES, at_once):
        chosen = rng.integers(len(names), size=(min(at_once, RESAMPLES - start), len(names)))
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
    """95 % interval (low, high) of a mean over classes of distances of sets, unclipped.

    value     the mean over the classes: of one class, its distance
    left_out  the distance without each block of objects [g], of each class

    Student's, with `jackknife_error`. (nan, nan) where there is none.

    Why not the bootstrap, as for the means: it draws objects twice, and repeated rows shrink the
    covariance and its rank. A Fréchet distance grows when sets get smaller, so that every replicate
    lies above the estimate and the percentile interval may exclude the very value it belongs to.
    Leaving out one object in g changes the size, and with it the bias, by 1 in g only. Neither
    method removes the bias: the interval shows how far this number would move with other objects,
    not where the distance of infinite sets lies.
    """
    found = jackknife_error(leave_one_out)
    return (value - found.reach, value + found.reach) if found else NONE


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
    """A distance as it would be with endless objects: extrapolated in 1 / g by the jackknife.

    g value - (g - 1) mean(left_out) (Quenouille 1956). NaN where there is no `jackknife_error`.
    """
    if not _enough([leave_one_out]):
        return float("nan")
    return float(len(leave_one_out) * value - (len(leave_one_out) - 1) * leave_one_out.mean())


def mean_error(per_object: Sequence[Floats]) -> StandardError | None:
    """The standard error of the mean over classes of the means over objects; None without one.

    As in `interval_of_means`, whose interval is at no side nearer than Student's by this error.
    """
    if not _enough(per_object):
        return None
    return _standard_error([of.var(ddof=1) / len(of) for of in per_object], per_object)


def sum_error(errors: Sequence[StandardError | None]) -> StandardError | None:
    """Of a sum or a difference of independent estimates; None where one is."""
    there = [of for of in errors if of is not None]
    if len(there) < len(errors) or not there:
        return None
    total = sum(of.error**2 for of in there)
    parts = sum(of.error**4 / of.freedom for of in there)
    freedom = total**2 / parts if parts > 0 else min(of.freedom for of in there)
    return StandardError(total**0.5, freedom)


def jackknife_error(leave_one_out: Sequence[Floats]) -> StandardError | None:
    """The standard error of a mean over classes of distances, as `jackknife_interval` takes them.

    The classes are independent, so their variances (g - 1) / g sum((theta_i - mean)^2) (Efron and
    Stein 1981) add up, over the square of their number. None below FEWEST blocks, without a class,
    where a class has fewer than 2 blocks, and where a distance is not finite.
    """
    if not _enough(leave_one_out):
        return None
    variances = [(len(of) - 1) / len(of) * np.sum((of - of.mean()) ** 2) for of in leave_one_out]
    return _standard_error(variances, leave_one_out)


def _enough(of_classes: Sequence[Floats]) -> bool:
    counts = [len(of) for of in of_classes]
    if not counts or min(counts) < 2 or sum(counts) < FEWEST:
        return False
    return all(np.isfinite(of).all() for of in of_classes)


def _standard_error(variances: Sequence[float], of_classes: Sequence[Floats]) -> StandardError:
    """Of the mean over classes of estimates with these variances."""
    total = float(sum(variances))
    parts = sum(v**2 / (len(of) - 1) for v, of in zip(variances, of_classes, strict=True))
    least = min(len(of) for of in of_classes) - 1
    return StandardError(
        total**0.5 / len(of_classes), total**2 / float(parts) if parts > 0 else float(least)
    )


def _resampled(values: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Means of RESAMPLES draws of as many values as there are, and the squares of their errors."""
    means, squares = np.empty(RESAMPLES), np.empty(RESAMPLES)
    at_once = max(1, AT_ONCE // len(values))
    for start in range(0, RESAMPLES, at_once):
        part = slice(start, start + at_once)
        count = min(at_once, RESAMPLES - start)
        drawn = values[rng.integers(len(values), size=(count, len(values)))]
        means[part] = drawn.mean(axis=1)
        squares[part] = drawn.var(axis=1, ddof=1) / len(values)
    return means, squares
