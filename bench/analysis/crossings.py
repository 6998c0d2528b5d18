"""Methods along families of conditions: which is ahead, and where that changes. Pure.

Methods are compared on the same objects, failed images scored as blank ones
(`bench.analysis.comparison`). Between the conditions that were measured a curve is a straight line
on the axis of the family: on the logarithm where the axis is logarithmic.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.analysis.comparison import NAN, Comparison, Estimate, Quality, lead
from bench.catalogue.families import Family, families_of
from bench.catalogue.lookup import family_of

# Who is set against whom; settings and weights of a method (`pc2pix@FILE`) stand for it too.
PAIRS = (("splat-net", "surface-apss"), ("pc2pix", "surface-apss"), ("splat-net", "pc2pix"))
UNDECIDED = "undecided"
NO_VALUE = "no value"


@dataclass(frozen=True)
class ConditionCurve:
    """One method along a family: `estimates` are of its conditions, in their order."""

    class_name: str
    family: Family
    metric: str
    method: str
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class Crossover:
    """Where two curves cross.

    after      the number of the step after which they do, from 0: before the next one, or at it
    at         on the axis
    low, high  around it, as far as the interval of the lead holds 0: an end of the family where it
               still does there; NaN where a lead has no interval
    """

    after: int
    at: float
    low: float
    high: float


@dataclass(frozen=True)
class PairedComparison:
    """Two methods along a family by one metric.

    values, rival_values  of both, at each step
    leads                 how much better the method is than its rival, paired over objects
    """

    class_name: str
    family: Family
    metric: str
    method: str
    rival: str
    values: tuple[float, ...]
    rival_values: tuple[float, ...]
    leads: tuple[Estimate, ...]

    @property
    def sides(self) -> tuple[Family, str, str]:
        """Family, method and rival."""
        return self.family, self.method, self.rival

    @property
    def ahead(self) -> tuple[str, ...]:
        """At each step whose lead has an interval on its side of 0; else UNDECIDED or NO_VALUE."""
        return tuple(_ahead(of, self.method, self.rival) for of in self.leads)

    @property
    def crossings(self) -> tuple[Crossover, ...]:
        """All within the family, in its order. A lead that touches 0 and comes back is none."""
        places = [place_of(value, self.family) for value in self.family.values]
        leads, lows, highs = zip(*self.leads, strict=True)
        # 0 leaves the interval where one of its ends passes through 0.
        left = [at for _, at in (*sign_changes(places, lows), *sign_changes(places, highs))]
        sure = all(map(math.isfinite, (*lows, *highs)))
        made = []
        for after, at in sign_changes(places, leads):
            low = max(p for p in (*left, min(places)) if p <= at) if sure else NAN
            high = min(p for p in (*left, max(places)) if p >= at) if sure else NAN
            made.append(Crossover(after, *(_value(p, self.family) for p in (at, low, high))))
        return tuple(made)


def condition_curves(
    comparisons: Sequence[Comparison], metrics: Sequence[str]
) -> tuple[ConditionCurve, ...]:
    """Every method along every family that the conditions make up: by class, family and metric."""
    return tuple(
        ConditionCurve(
            class_name, family, metric, method, tuple(step[method].estimate for step in steps)
        )
        for class_name, family, metric, steps in _steps(comparisons, metrics)
        for method in steps[0]
    )


def paired_comparisons(
    comparisons: Sequence[Comparison], metrics: Sequence[str]
) -> tuple[PairedComparison, ...]:
    """The pairs that there are, along every family: by class, family, metric and pair."""
    return tuple(
        PairedComparison(
            class_name,
            family,
            metric,
            method,
            rival,
            tuple(step[method].estimate.value for step in steps),
            tuple(step[rival].estimate.value for step in steps),
            tuple(lead(step[method], step[rival]) for step in steps),
        )
        for class_name, family, metric, steps in _steps(comparisons, metrics)
        for method, rival in pairs_among(list(steps[0]))
    )


def _steps(
    comparisons: Sequence[Comparison], metrics: Sequence[str]
) -> Iterator[tuple[str, Family, str, list[Mapping[str, Quality]]]]:
    """Class, family and metric, with the qualities by method at each condition of the family."""
    by_class: dict[str, dict[str, Comparison]] = {}
    for comparison in comparisons:
        by_class.setdefault(comparison.class_name, {})[comparison.condition] = comparison
    for class_name, by_condition in by_class.items():
        for family in families_of(by_condition):
            for metric in metrics:
                steps = [by_condition[c].qualities[metric] for c in family.conditions]
                yield class_name, family, metric, steps


def pairs_among(methods: Sequence[str]) -> list[tuple[str, str]]:
    """The pairs of PAIRS that these methods make up."""
    return [
        (method, rival)
        for one, other in PAIRS
        for method in methods
        for rival in methods
        if (family_of(method), family_of(rival)) == (one, other)
    ]


def sign_changes(places: Sequence[float], values: Sequence[float]) -> list[tuple[int, float]]:
    """Where straight lines through (place, value) pass from one side of 0 to the other.

    Each as (number of the step after which, place). Steps without a value (NaN) join nothing. Of
    a stretch at 0 between two sides it is the first step.
    """
    sided = [i for i, value in enumerate(values) if value != 0]
    found = []
    for i, j in pairwise(sided):
        if values[i] * values[j] < 0:
            share = values[i] / (values[i] - values[i + 1])
            found.append((i, places[i] + share * (places[i + 1] - places[i])))
    return found


def _ahead(of: Estimate, method: str, rival: str) -> str:
    if not math.isfinite(of.value):
        return NO_VALUE
    return method if of.low > 0 else rival if of.high < 0 else UNDECIDED


def place_of(value: float, family: Family) -> float:
    """Where a value stands on an axis whose equal steps are equally far apart."""
    return math.log2(value) if family.logarithmic else value


def _value(place: float, family: Family) -> float:
    return 2.0**place if family.logarithmic else place
