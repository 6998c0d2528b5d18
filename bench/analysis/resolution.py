"""The resolution of a comparison: the smallest true difference that its objects are likely to show.

A difference of (t_{1-level/2} + t_{POWER}) standard errors, by quantiles of Student's distribution
with the degrees of freedom of the error, is shown in POWER of all runs of as many objects. It is
the minimum detectable difference of Zar (Biostatistical Analysis, 1984), of the paired t test as
in Dupont and Plummer (Controlled Clinical Trials 11, 1990). A tie with a small resolution tells
that two methods are alike; with a large one that so few objects see nothing.

The error is that of the mean of the paired differences, as measured in this run: the resolution is
an estimate, too (`studies.resolution` has its spread).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from bench.analysis.comparison import NAN, Comparison, Quality, paired
from bench.analysis.intervals import StandardError, jackknife_error, mean_error
from bench.catalogue.methods import role
from bench.catalogue.metrics import is_mean

POWER = 0.80


def detectable(error: StandardError | None, level: float) -> float:
    """Return the difference that a two-sided test at a level shows with POWER.

    NaN without an error (too few objects), and where it is 0: equal values tell no spread.
    """
    if error is None or not error.error > 0:
        return NAN
    quantiles = stdtrit(error.freedom, 1 - level / 2) + stdtrit(error.freedom, POWER)
    return float(quantiles * error.error)


def difference_error(a: Sequence[Quality], b: Sequence[Quality]) -> StandardError | None:
    """Return the standard error of the difference of two methods in the mean over classes.

    Both have a quality of each class by one metric, in the same order. None with too few objects.
    """
    pairs = list(zip(a, b, strict=True))
    if not pairs:
        return None
    if is_mean(a[0].metric):
        return mean_error([paired(x, y) for x, y in pairs])
    return jackknife_error([x.per_object - y.per_object for x, y in pairs])


def cell_levels(p_values: Sequence[float], significance: float) -> list[float]:
    """Return the level that Holm's procedure tests each cell at, given the p values of the others.

    With m p values and r rejected whatever this one is, a p value below significance / (m - r) is
    rejected, and no other. NaN for a cell without a p value.
    """
    ranked = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    levels = [NAN] * len(p_values)
    for place, (_, i) in enumerate(ranked):
        others = (p for k, (p, _) in enumerate(ranked) if k != place)
        rejected = 0
        for p in others:
            if not p * (len(ranked) - rejected) < significance:
                break
            rejected += 1
        levels[i] = significance / (len(ranked) - rejected)
    return levels


@dataclass(frozen=True)
class CellResolution:
    """The differences that a table can show at one condition by one metric.

    Attributes
    ----------
    metric, class_name, condition : str
    best : str
        The best of the competing methods; its difference is that to the next best.
    by_method : mapping
        The smallest difference of each method to the best one; NaN with too few objects.
    """

    metric: str
    class_name: str
    condition: str
    best: str
    by_method: Mapping[str, float]


def cell_resolutions(
    compared: Sequence[Comparison], metrics: Sequence[str], level: float, average: str = ""
) -> list[CellResolution]:
    """Return what each cell can show of the differences to its best method.

    By class, or with a name for the `average` in the mean over classes. Reference methods do not
    compete; cells with fewer than two competing methods are left out.
    """
    cells: dict[tuple[str, str], list[Comparison]] = {}
    for comparison in compared:
        cells.setdefault((comparison.condition, average or comparison.class_name), []).append(
            comparison
        )
    resolutions = []
    for metric in metrics:
        for (condition, class_name), classes in cells.items():
            qualities = {
                method: [c.qualities[metric][method] for c in classes]
                for method in classes[0].qualities[metric]
                if all(method in c.qualities[metric] for c in classes)
            }
            means = {
                method: float(np.mean([quality.rank for quality in of_classes]))
                for method, of_classes in qualities.items()
                if not role(method)
            }
            competing = [method for method, mean in means.items() if math.isfinite(mean)]
            if len(competing) < 2:
                continue
            best, second = sorted(competing, key=means.__getitem__, reverse=True)[:2]
            by_method = {
                method: detectable(
                    difference_error(of_method, qualities[second if method == best else best]),
                    level,
                )
                for method, of_method in qualities.items()
            }
            resolutions.append(CellResolution(metric, class_name, condition, best, by_method))
    return resolutions
