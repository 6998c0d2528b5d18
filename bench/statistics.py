"""Intervals over objects: the views of one object are not independent, objects are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 2000
SEED = 0


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
    from scipy.stats import bootstrap

    interval = bootstrap(
        (per_object,),
        np.mean,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return float(interval.low), float(interval.high)
