"""Intervals over objects: the views of one object are not independent, objects are.

The mean over classes is the paper's AVERAGE: every class counts alike, however many objects.
Classes are fixed, objects are drawn: intervals draw objects within their classes. Distances of sets
have a jackknife instead, `bench.metrics.frechet.jackknife_interval`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 2000
SEED = 0
AT_ONCE = 2**16  # numbers of the resamples that are in memory: little


def mean_interval(per_object: NDArray[np.float64]) -> tuple[float, float]:
    """95 % percentile-bootstrap interval (low, high) of the mean of one value per object [G].

    The resamples depend on G alone, so that methods measured on the same objects are resampled
    alike and their intervals are paired. (nan, nan) for fewer than 2 objects and where a value is
    not finite.
    """
    if len(per_object) < 2 or not np.isfinite(per_object).all():
        return float("nan"), float("nan")
    if np.ptp(per_object) == 0:  # exact, where resampled sums would round
        return float(per_object[0]), float(per_object[0])
    means = _resampled_means(per_object, np.random.default_rng(SEED))
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def _resampled_means(values: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The means of RESAMPLES draws of as many values as there are, some draws at a time."""
    means = np.empty(RESAMPLES)
    at_once = max(1, AT_ONCE // len(values))
    for start in range(0, RESAMPLES, at_once):
        some = means[start : start + at_once]
        chosen = rng.integers(len(values), size=(len(some), len(values)))
        some[:] = values[chosen].mean(axis=1)
    return means


def median_interval(values: NDArray[np.float64], objects: NDArray[Any]) -> tuple[float, float]:
    """95 % percentile-bootstrap interval (low, high) of the median of values [n], over objects.

    objects [n] names the object of each value; objects are drawn with all their values. As with
    `mean_interval`, the resamples depend on the number of objects alone. (nan, nan) for fewer than
    2 objects and where a value is not finite.
    """
    names, member = np.unique(objects, return_inverse=True)
    if len(names) < 2 or not np.isfinite(values).all():
        return float("nan"), float("nan")
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


Floats = NDArray[np.float64]


def interval_of_means(per_object: Sequence[Floats]) -> tuple[float, float]:
    """95 % percentile-bootstrap interval of the mean over classes of the means over objects.

    per_object  one value per object [G] of each class

    As with `bench.analysis.intervals.mean_interval`, the resamples depend on the numbers of objects
    alone, so that methods are paired. (nan, nan) without a class, where a class has fewer than 2
    objects, and where a value is not finite.
    """
    if not per_object or any(len(of) < 2 or not np.isfinite(of).all() for of in per_object):
        return float("nan"), float("nan")
    total = np.zeros(RESAMPLES)
    for number, values in enumerate(per_object):
        # One class says nothing about the next.
        total += _resampled_means(values, np.random.default_rng((SEED, number)))
    low, high = np.percentile(total / len(per_object), [2.5, 97.5])
    return float(low), float(high)
