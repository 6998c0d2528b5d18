"""Two methods, or one method in two runs, on the same objects: differences, intervals, p values.

A cell is a metric under one condition and of one class. Its difference pairs the two object by
object, failed images scored as blank ones (`bench.analysis.comparison`). Image metrics: interval by
the bootstrap over objects, p value by random sign flips of the objects' differences (all of them
where there are at most 13 objects). Fréchet distances: both by the jackknife over objects. Holm's
step-down procedure (Scandinavian Journal of Statistics 6, 1979) corrects the p values for the
number of cells. Pure functions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.analysis.comparison import Estimate, Quality, difference, paired
from bench.analysis.intervals import jackknife_error
from bench.catalogue.metrics import higher_is_better, is_mean

Floats = NDArray[np.float64]
Ahead = Literal["a", "b", "tie", "unknown"]
SIGNIFICANCE = 0.05
RESAMPLES = 9999
SEED = 0


@dataclass(frozen=True)
class Side:
    """One side of a comparison: a method of a run."""

    run: str
    method: str


@dataclass(frozen=True)
class Pair:
    """A cell: the qualities of its two sides by one metric, on the same objects.

    objects  of these, how many have a value on both sides
    """

    condition: str
    class_name: str
    a: Side
    b: Side
    quality_a: Quality
    quality_b: Quality
    objects: int

    @property
    def metric(self) -> str:
        """Of both qualities."""
        return self.quality_a.metric


@dataclass(frozen=True)
class PairedDifference:
    """What differs in a cell.

    difference  b - a, with its 95 % interval; NaN where there are too few objects
    p           of no difference, two-sided; NaN where there are too few objects
    p_holm      corrected for the number of cells that have a p value
    ahead       who is better; a tie where `p_holm` is not below SIGNIFICANCE
    """

    pair: Pair
    difference: Estimate
    p: float
    p_holm: float
    ahead: Ahead

    def turned(self) -> PairedDifference:
        """The same with its sides exchanged."""
        pair = replace(
            self.pair,
            a=self.pair.b,
            b=self.pair.a,
            quality_a=self.pair.quality_b,
            quality_b=self.pair.quality_a,
        )
        value, low, high = self.difference
        exchanged: dict[Ahead, Ahead] = {"a": "b", "b": "a"}
        ahead = exchanged.get(self.ahead, self.ahead)
        return replace(self, pair=pair, difference=Estimate(-value, -high, -low), ahead=ahead)


def paired_differences(pairs: Sequence[Pair]) -> list[PairedDifference]:
    """The difference of each pair, in their order, corrected for all of them together."""
    changes = [difference(pair.quality_b, pair.quality_a) for pair in pairs]
    values = [p_value(pair, change) for pair, change in zip(pairs, changes, strict=True)]
    return [
        PairedDifference(pair, change, p, corrected, _ahead(pair.metric, change, corrected))
        for pair, change, p, corrected in zip(pairs, changes, values, holm(values), strict=True)
    ]


def p_value(pair: Pair, change: Estimate) -> float:
    """Two-sided p value of no difference; NaN where the cell has no interval."""
    if not math.isfinite(change.low):
        return math.nan
    if is_mean(pair.metric):
        return sign_flip_p(paired(pair.quality_b, pair.quality_a))
    found = jackknife_error([pair.quality_b.per_object - pair.quality_a.per_object])
    return found.p_value(change.value) if found else math.nan


def sign_flip_p(differences: Floats) -> float:
    """Two-sided p value of a mean of 0 for differences [G] whose signs are as likely as not.

    All 2^G signs where these are no more than RESAMPLES, else RESAMPLES random ones and those that
    were observed, from a fixed seed. 1 where all differences are 0. Raises ValueError for G < 2.
    """
    from scipy.stats import permutation_test

    found = permutation_test(
        (differences,),
        np.mean,
        permutation_type="samples",
        vectorized=True,
        n_resamples=RESAMPLES,
        rng=np.random.default_rng(SEED),
    )
    return float(min(found.pvalue, 1.0))


def holm(p_values: Sequence[float]) -> list[float]:
    """P values corrected for their number, in their order; NaN stays and does not count."""
    known = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    corrected = [math.nan] * len(p_values)
    largest = 0.0
    for rank, (p, i) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        corrected[i] = largest
    return corrected


def _ahead(metric: str, change: Estimate, p_holm: float) -> Ahead:
    if math.isnan(p_holm):
        return "unknown"
    if p_holm >= SIGNIFICANCE or change.value == 0:
        return "tie"
    return "b" if (change.value > 0) == higher_is_better(metric) else "a"
