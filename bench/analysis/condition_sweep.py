"""Methods along families of conditions: which is ahead, and where that changes.

Methods are compared on the same objects, failed images scored as blank ones
(`bench.analysis.paired.Verdicts`). Between the conditions that were measured a curve is a straight
line on the axis of the family: on the logarithm where the axis is logarithmic.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.analysis.comparison import NAN, Comparison, Estimate, Quality
from bench.analysis.paired import Verdicts
from bench.catalogue.conditions import Family, families_of
from bench.catalogue.lookup import family_of

# Who is set against whom; settings and weights of a method (`pc2pix@FILE`) stand for it too.
PAIRS = (("splat-net", "surface-apss"), ("pc2pix", "surface-apss"), ("splat-net", "pc2pix"))
UNDECIDED = "undecided"
NO_VALUE = "no value"


@dataclass(frozen=True)
class ConditionCurve:
    """The values of one method along a family, in the order of its conditions."""

    class_name: str
    family: Family
    metric: str
    method: str
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class Crossover:
    """A place where two curves cross.

    after      number of the step, from 0, after which they cross: before the next one, or at it
    at         the place on the axis
    low, high  the places around it as far as the interval of the difference holds 0: an end of the
               family where it still does there; NaN where a difference has no interval
    """

    after: int
    at: float
    low: float
    high: float


@dataclass(frozen=True)
class PairedComparison:
    """Two methods along a family by one metric.

    values, baseline_values  of both, at each step
    differences              how much better the method is than its baseline, paired over objects,
                             with the intervals that decide
    """

    class_name: str
    family: Family
    metric: str
    method: str
    baseline: str
    values: tuple[float, ...]
    baseline_values: tuple[float, ...]
    differences: tuple[Estimate, ...]

    @property
    def sides(self) -> tuple[Family, str, str]:
        """Return family, method and baseline."""
        return self.family, self.method, self.baseline

    @property
    def ahead(self) -> tuple[str, ...]:
        """Return the better method at each step, by an interval without 0, or why none is."""
        return tuple(_ahead(value, self.method, self.baseline) for value in self.differences)

    @property
    def crossovers(self) -> tuple[Crossover, ...]:
        """Return the crossovers within the family; a curve that only touches 0 has none there."""
        places = [place_of(value, self.family) for value in self.family.values]
        differences, lows, highs = zip(*self.differences, strict=True)
        # 0 leaves the interval where one of its ends passes through 0.
        left = [at for _, at in (*sign_changes(places, lows), *sign_changes(places, highs))]
        sure = all(map(math.isfinite, (*lows, *highs)))
        crossovers = []
        for after, at in sign_changes(places, differences):
            low = max(p for p in (*left, min(places)) if p <= at) if sure else NAN
            high = min(p for p in (*left, max(places)) if p >= at) if sure else NAN
            crossovers.append(Crossover(after, *(_value(p, self.family) for p in (at, low, high))))
        return tuple(crossovers)


def condition_curves(
    comparisons: Sequence[Comparison], metrics: Sequence[str]
) -> tuple[ConditionCurve, ...]:
    """Return every method along every family of the conditions, by class, family and metric."""
    return tuple(
        ConditionCurve(
            *(class_name, family, metric, method),
            tuple(step[method].estimate for step in steps),
        )
        for class_name, family, metric, steps in _steps(comparisons, metrics)
        for method in steps[0]
    )


def paired_comparisons(
    comparisons: Sequence[Comparison], metrics: Sequence[str], verdicts: Verdicts
) -> tuple[PairedComparison, ...]:
    """Return the pairs of the methods along every family, by class, family, metric and pair."""
    return tuple(
        PairedComparison(
            class_name,
            family,
            metric,
            method,
            baseline,
            tuple(step[method].estimate.value for step in steps),
            tuple(step[baseline].estimate.value for step in steps),
            tuple(
                verdicts.difference(baseline, method, metric, condition, class_name).lead
                for condition in family.conditions
            ),
        )
        for class_name, family, metric, steps in _steps(comparisons, metrics)
        for method, baseline in pairs_among(list(steps[0]))
    )


def _steps(
    comparisons: Sequence[Comparison], metrics: Sequence[str]
) -> Iterator[tuple[str, Family, str, list[Mapping[str, Quality]]]]:
    """Yield class, family and metric, with the qualities by method at each of its conditions."""
    by_class: dict[str, dict[str, Comparison]] = {}
    for comparison in comparisons:
        by_class.setdefault(comparison.class_name, {})[comparison.condition] = comparison
    for class_name, by_condition in by_class.items():
        for family in families_of(by_condition):
            for metric in metrics:
                steps = [by_condition[c].qualities[metric] for c in family.conditions]
                yield class_name, family, metric, steps


def pairs_among(methods: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of PAIRS that these methods make up."""
    return [
        (method, baseline)
        for first, second in PAIRS
        for method in methods
        for baseline in methods
        if (family_of(method), family_of(baseline)) == (first, second)
    ]


def sign_changes(places: Sequence[float], values: Sequence[float]) -> list[tuple[int, float]]:
    """Return where straight lines through (place, value) pass from one side of 0 to the other.

    Each is (number of the step before, place). Steps without a value (NaN) join nothing. A stretch
    at 0 between two sides counts as its first step.
    """
    sided = [i for i, value in enumerate(values) if value != 0]
    changes = []
    for i, j in pairwise(sided):
        if values[i] * values[j] < 0:
            share = values[i] / (values[i] - values[i + 1])
            changes.append((i, places[i] + share * (places[i + 1] - places[i])))
    return changes


def _ahead(difference: Estimate, method: str, baseline: str) -> str:
    if not math.isfinite(difference.value):
        return NO_VALUE
    return method if difference.low > 0 else baseline if difference.high < 0 else UNDECIDED


def place_of(value: float, family: Family) -> float:
    """Return the place of a value on an axis whose equal steps are equally far apart."""
    return math.log2(value) if family.logarithmic else value


def _value(place: float, family: Family) -> float:
    return 2.0**place if family.logarithmic else place
