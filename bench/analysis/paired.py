"""Two methods, or one method in two runs, on the same objects: differences, intervals, p values.

A cell is a metric under one condition and of one class. Its difference pairs the two object by
object, failed images scored as blank ones (`bench.analysis.comparison`). Image metrics: interval by
the bootstrap over objects, p value by sign flips of the objects' differences (`sign_flip_p`).
Fréchet distances: both by the jackknife over objects. Holm's step-down procedure (Scandinavian
Journal of Statistics 6, 1979) corrects the p values for the number of cells.

Of n objects no p value of sign flips is below 2^(1-n), so that few objects decide nothing among
many cells, whatever they show: such a cell is not called a tie (`fewest_objects`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import Literal

import numpy as np

from bench.analysis.comparison import Estimate, Quality, difference, paired
from bench.analysis.intervals import FEWEST, MOST_RESAMPLED, jackknife_error, mean_error
from bench.catalogue.metrics import higher_is_better, is_mean
from data_prep.arrays import Floats

Ahead = Literal["a", "b", "tie", "unknown"]
SIGNIFICANCE = 0.05
MOST_EXACT = 16  # objects of which all signs are counted
RESAMPLES = 9999
SEED = 0
AT_ONCE = 2**20  # numbers of the random signs and their sums that are in memory: 8 MB
ROUNDING = 1e-14  # of the sum of the amounts: sums in two orders differ by less


@dataclass(frozen=True)
class Side:
    """One side of a comparison: a method of a run."""

    run: str
    method: str


@dataclass(frozen=True)
class ComparedPair:
    """The qualities of the two sides of a cell by one metric, on the same objects.

    objects  number of objects that have a value on both sides
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
        """Return the metric of both qualities."""
        return self.quality_a.metric

    @property
    def methods(self) -> tuple[str, str]:
        """Return the methods whose images they are, in place of the names of chosen rows."""
        return self.quality_a.method, self.quality_b.method


@dataclass(frozen=True)
class PairedDifference:
    """The difference in a cell.

    difference  b - a, with its 95 % interval; NaN where there are too few objects
    p           of no difference, two-sided; NaN where there are too few objects
    p_holm      corrected for the number of cells that have a p value
    ahead       who is better; a tie where `p_holm` is not below SIGNIFICANCE; unknown where so few
                objects could not have shown a difference
    objects_needed  then the fewest that could; else None
    """

    pair: ComparedPair
    difference: Estimate
    p: float
    p_holm: float
    ahead: Ahead
    objects_needed: int | None


def paired_differences(pairs: Sequence[ComparedPair]) -> list[PairedDifference]:
    """Return the difference of each pair, in their order, corrected for all of them together."""
    changes = [difference(pair.quality_b, pair.quality_a) for pair in pairs]
    values = p_values(pairs, changes)
    tested = sum(not math.isnan(p) for p in values)
    testable = sum(math.isfinite(change.value) for change in changes)  # with enough objects
    differences = []
    for pair, change, p, corrected in zip(pairs, changes, values, holm(values), strict=True):
        needed = None
        if not corrected < SIGNIFICANCE and _undecidable(pair, change, p, tested):
            needed = fewest_objects(testable) if is_mean(pair.metric) else FEWEST
        ahead = "unknown" if needed else _ahead(pair.metric, change, corrected)
        differences.append(PairedDifference(pair, change, p, corrected, ahead, needed))
    return differences


def p_values(pairs: Sequence[ComparedPair], changes: Sequence[Estimate]) -> list[float]:
    """Return the two-sided p value of no difference of each pair; NaN where it has no interval."""
    values = [math.nan] * len(pairs)
    flipped: dict[int, list[tuple[int, Floats]]] = {}  # by the number of objects
    for i, (pair, change) in enumerate(zip(pairs, changes, strict=True)):
        if not math.isfinite(change.low):
            continue
        if is_mean(pair.metric):
            per_object = paired(pair.quality_b, pair.quality_a)
            flipped.setdefault(len(per_object), []).append((i, per_object))
        else:
            without = pair.quality_b.per_object - pair.quality_a.per_object
            error = jackknife_error([without])
            values[i] = error.p_value(change.value) if error else math.nan
    for alike in flipped.values():
        places, rows = zip(*alike, strict=True)
        for i, p in zip(places, sign_flip_p(np.array(rows)), strict=True):
            values[i] = float(p)
    return values


def sign_flip_p(differences: Floats) -> Floats:
    """Return the two-sided p values of a mean of 0 for rows of differences [..., n], [...].

    The signs of a row are as likely as not. Of up to MOST_EXACT objects all 2^n signs are counted;
    of more, RESAMPLES random ones from a fixed seed and those that were observed. Where none of
    these is as extreme as what was observed, Student's p value (of the paired t test) stands in, as
    far as it is smaller, but never below 2^(1-n), the smallest p value of all signs. Of more than
    MOST_RESAMPLED objects it is Student's p value alone. 1 where all differences are 0.
    """
    rows = differences.reshape(-1, differences.shape[-1])
    if rows.shape[1] <= MOST_EXACT:
        p = _exact_p(rows)
    elif rows.shape[1] <= MOST_RESAMPLED:
        p = _resampled_p(rows)
    else:
        p = np.array([_student_p(row) for row in rows])
    return p.reshape(differences.shape[:-1])


def _exact_p(rows: Floats) -> Floats:
    """Return the p values of rows [k, n] by all signs."""
    size = rows.shape[1]
    half = size // 2
    # A sum and its negative are equally extreme, so that the sign of one object can stay.
    first = _all_signs(size - half)[: 2 ** (size - half - 1)]
    second = _all_signs(half)
    p = np.empty(len(rows))
    for i, row in enumerate(rows):
        sums = (first @ row[: size - half])[:, None] + second @ row[size - half :]
        extreme = np.abs(sums) >= abs(row.sum()) - ROUNDING * np.abs(row).sum()
        p[i] = extreme.mean()
    return p


def _all_signs(size: int) -> Floats:
    return np.array(list(product((1.0, -1.0), repeat=size)))


def _resampled_p(rows: Floats) -> Floats:
    """Return the p values of rows [k, n] by random signs, below their floor by Student's."""
    size = rows.shape[1]
    rng = np.random.default_rng(SEED)
    observed, slack = rows.sum(axis=1), ROUNDING * np.abs(rows).sum(axis=1)
    above, below = np.ones(len(rows)), np.ones(len(rows))  # what was observed is one of them
    at_once = max(1, AT_ONCE // (2 * size + len(rows)))
    for start in range(0, RESAMPLES, at_once):
        both = np.tile([1.0, -1.0], (min(at_once, RESAMPLES - start), size, 1))
        sums = rng.permuted(both, axis=-1)[..., 0] @ rows.T
        above += (sums >= observed - slack).sum(axis=0)
        below += (sums <= observed + slack).sum(axis=0)
    p = np.minimum(2 * np.minimum(above, below) / (RESAMPLES + 1), 1.0)
    for i in np.flatnonzero(p <= 2 / (RESAMPLES + 1)):
        p[i] = min(p[i], _student_p(rows[i]))
    return p


def _student_p(row: Floats) -> float:
    """Return the p value of the paired t test, not below that of all signs; 1 without an error."""
    error = mean_error([row])
    return max(error.p_value(float(row.mean())), 2.0 ** (1 - len(row))) if error else 1.0


def fewest_objects(cells: int) -> int:
    """Return the fewest objects that can show a difference of an image metric in one of the cells.

    The smallest n, not below FEWEST, with 2^(1-n) cells < SIGNIFICANCE: p values of sign flips are
    not below 2^(1-n), and Holm's procedure multiplies the smallest by the number of cells.
    """
    return next(n for n in count(FEWEST) if 2.0 ** (1 - n) * cells < SIGNIFICANCE)


def _undecidable(pair: ComparedPair, change: Estimate, p: float, tested: int) -> bool:
    """Return whether a cell has too few objects for any difference among `tested` cells."""
    of_images = is_mean(pair.metric)
    per_object = paired(pair.quality_b, pair.quality_a)
    objects = len(per_object) if of_images else pair.objects
    if math.isnan(p):
        return math.isfinite(change.value) and objects < FEWEST
    # What is equal on every object does not differ, however few there are.
    return of_images and bool(per_object.any()) and 2.0 ** (1 - objects) * tested >= SIGNIFICANCE


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values corrected for their number, in their order; NaN stays and does not count."""
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
