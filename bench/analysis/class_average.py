"""The mean over classes, as the paper's AVERAGE: every class counts alike, however many objects.

Classes are fixed, objects are drawn: intervals draw, or leave out, objects within their classes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.analysis.intervals import AT_ONCE, RESAMPLES, SEED

Floats = NDArray[np.float64]
NO_INTERVAL = float("nan"), float("nan")


def interval_of_means(per_object: Sequence[Floats]) -> tuple[float, float]:
    """95 % percentile-bootstrap interval of the mean over classes of the means over objects.

    per_object  one value per object [G] of each class

    As with `bench.analysis.intervals.mean_interval`, the resamples depend on the numbers of objects
    alone, so that methods are paired. (nan, nan) without a class, where a class has fewer than 2
    objects, and where a value is not finite.
    """
    if not per_object or any(len(of) < 2 or not np.isfinite(of).all() for of in per_object):
        return NO_INTERVAL
    total = np.zeros(RESAMPLES)
    for number, values in enumerate(per_object):
        rng = np.random.default_rng((SEED, number))  # one class says nothing about the next
        at_once = max(1, AT_ONCE // len(values))
        for start in range(0, RESAMPLES, at_once):
            some = total[start : start + at_once]
            some += values[rng.integers(len(values), size=(len(some), len(values)))].mean(axis=1)
    low, high = np.percentile(total / len(per_object), [2.5, 97.5])
    return float(low), float(high)


def interval_of_distances(value: float, left_out: Sequence[Floats]) -> tuple[float, float]:
    """95 % interval of a mean over classes of distances of sets, by a jackknife within classes.

    value     the mean over the classes
    left_out  the distance without each object [G] of each class

    The classes are independent, so their variances (g - 1) / g sum((theta_i - mean)^2) add up, over
    the square of their number. Unclipped; two objects suffice, as one class in many. (nan, nan)
    without a class, where a class has fewer than 2 objects, and where a value is not finite.
    """
    if not left_out or any(len(of) < 2 or not np.isfinite(of).all() for of in left_out):
        return NO_INTERVAL
    variances = [(len(of) - 1) / len(of) * ((of - of.mean()) ** 2).sum() for of in left_out]
    error = float(np.sqrt(sum(variances))) / len(left_out)
    return value - 1.96 * error, value + 1.96 * error
