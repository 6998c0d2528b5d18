"""Who is ahead: two methods, or one method in two runs, on the same objects.

A *criterion* is a metric under one condition and of one class. By each criterion the difference of
the two is taken object by object, failed images scored as blank ones (`bench.analysis.compare`).
A sentence about several criteria is corrected for their number m (Bonferroni): each difference has
the interval of 1 - SIGNIFICANCE / m, and a side is ahead where this interval leaves out 0. So no
interval contradicts its verdict. All texts about the methods of a run ask `Verdicts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import pandas as pd

from bench.analysis.compare import NAN, VALUE, Estimate, Row, compared
from bench.analysis.intervals import (
    FEWEST,
    NO_INTERVAL,
    SIGNIFICANCE,
    StandardError,
    clipped,
    jackknife_error,
    mean_error,
)
from bench.catalogue.metrics import higher_is_better, is_mean, value_range

if TYPE_CHECKING:
    from bench.analysis.run import Run

Ahead = Literal["a", "b", "tie", "unknown"]
# Decimals of the ends of an interval that decide whether it holds 0: the same scores, added in
# another order, differ by 1e-6.
INTERVAL_DECIMALS = 5
CRITERION = ["metric", "condition", "class"]  # the columns that together name a comparison
LEAD_COLUMNS = ["lead", "lead_low", "lead_high"]  # how much better b is than a, with its interval
_SIDE_COLUMNS = ["run", "method", "images_of", "value"]  # of each side: with the end _a or _b
_DIFFERENCES = [
    *CRITERION,
    "run_a",
    "method_a",
    "run_b",
    "method_b",
    "value_a",
    "value_b",
    "difference",
    "ci_low",
    "ci_high",
    "level",
    "p",
    "p_corrected",
    "cells",
    "ahead",
    "objects",
    "objects_needed",
    "failed_a",
    "failed_b",
    "images_of_a",
    "images_of_b",
]


class QualityChange(NamedTuple):
    """A difference of two values by one metric.

    error     its standard error; None where there are too few objects
    possible  the least and the largest value that the difference can have
    """

    value: float
    error: StandardError | None
    possible: tuple[float, float] = (-math.inf, math.inf)

    def estimate(self, alpha: float = SIGNIFICANCE) -> Estimate:
        """Return the difference with the interval that misses the true one in `alpha`."""
        interval = self.error.interval(self.value, alpha) if self.error else NO_INTERVAL
        return Estimate(self.value, *clipped(interval, self.possible))

    @property
    def p(self) -> float:
        """Return the two-sided p value of there being no difference; NaN without an error."""
        return self.error.p_value(self.value) if self.error else NAN


def change(a: Sequence[Row], b: Sequence[Row]) -> QualityChange:
    """Return the mean over classes of a - b.

    a, b  rows of a comparison by one metric, one for each class, both in the same order

    By a metric that is a mean over objects the objects are paired, and a class without an object
    that has a value on both sides is left out. By other metrics the classes' values are subtracted.
    """
    metric = a[0]["metric"]
    least, largest = value_range(metric)
    possible = (least - largest, largest - least)
    paired = [x["samples"] - y["samples"] for x, y in zip(a, b, strict=True)]
    if is_mean(metric):
        valued = [gain[~np.isnan(gain)] for gain in paired]
        samples = [gain for gain in valued if len(gain)]
        value = float(np.mean([values.mean() for values in samples])) if samples else NAN
        return QualityChange(value, mean_error(samples), possible)
    value = float(np.mean([x["value"] - y["value"] for x, y in zip(a, b, strict=True)]))
    return QualityChange(value, jackknife_error(paired), possible)


def better_by(a: Sequence[Row], b: Sequence[Row]) -> QualityChange:
    """Return by how much `a` is better than `b`: as `change`, but over 0 where a is better."""
    return change(a, b) if higher_is_better(a[0]["metric"]) else change(b, a)


def paired_differences(pairs: Sequence[tuple[Row, Row]]) -> pd.DataFrame:
    """Return the difference of each pair, in their order, corrected for all of them together.

    pairs  rows (a, b) on the same objects, of one comparison or of those of two runs, which then
           have a column `run`

    It has a row for each pair:

    * `metric`, `condition` and `class`
    * `run_a`, `method_a`, `images_of_a` (the method that drew the images) and `value_a` of the one
      side; `run_b` and so on of the other
    * `difference`: b - a, with `ci_low` and `ci_high`, the interval by which it is decided who is
      ahead; `level`: the level of this interval, .95 or more. NaN where there are too few objects
    * `p`: the two-sided p value of there being no difference; `p_corrected`: p times `cells`, the
      number of pairs that have a p value, at most 1. NaN where there are too few objects
    * `ahead`: "a" or "b", the better one by an interval without 0; "tie" where it holds 0;
      "unknown" where there is no interval
    * `objects`: the number of objects that have a value on both sides; `objects_needed`: how many
      an interval needs, where these are too few and not all equal, else None
    * `failed_a` and `failed_b`: numbers of images that failed, which count as blank ones
    """
    rows = _bonferroni_differences(pairs)
    needed = pd.Series([row["objects_needed"] for row in rows], dtype=object)
    return pd.DataFrame(rows, columns=_DIFFERENCES).assign(objects_needed=needed)


def _bonferroni_differences(pairs: Sequence[tuple[Row, Row]]) -> list[Row]:
    """Return a row for each pair as `paired_differences`, and with LEAD_COLUMNS."""
    changes = [change([b], [a]) for a, b in pairs]
    tested = sum(of_pair.error is not None for of_pair in changes)
    return [
        _difference_row(a, b, of_pair, tested)
        for (a, b), of_pair in zip(pairs, changes, strict=True)
    ]


def _difference_row(a: Row, b: Row, change_to_b: QualityChange, tested: int) -> Row:
    """Return the row of one pair; `tested` pairs with a p value are corrected for together."""
    alpha = SIGNIFICANCE / max(tested, 1)
    difference = change_to_b.estimate(alpha)
    lead = difference
    if not higher_is_better(a["metric"]):  # 0 - x, as -x makes -0 of a difference of 0
        lead = Estimate(0.0 - lead.value, 0.0 - lead.high, 0.0 - lead.low)
    ahead = who_is_ahead(lead)
    by_object = b["samples"] - a["samples"]
    known = by_object[~np.isnan(by_object)]
    # Where no object moved, nothing has to be decided. Objects may also move with a mean of 0.
    moved = difference.value != 0 or bool(known.any())
    too_few = ahead == "unknown" and math.isfinite(difference.value) and moved
    row: Row = {name: a[name] for name in CRITERION}
    for name in _SIDE_COLUMNS:
        row |= {f"{name}_a": a.get(name, ""), f"{name}_b": b.get(name, "")}
    row |= zip(("difference", *VALUE[1:]), difference, strict=True)
    row |= zip(LEAD_COLUMNS, lead, strict=True)
    return row | {
        "level": 1 - alpha,
        "p": change_to_b.p,
        "p_corrected": min(change_to_b.p * tested, 1.0),
        "cells": tested,
        "ahead": ahead,
        "objects": len(known) if is_mean(a["metric"]) else len(a["objects"]),
        "failed_a": int(a["n"] - a["n_ok"]),
        "failed_b": int(b["n"] - b["n_ok"]),
        "objects_needed": FEWEST if too_few else None,
    }


def lead_of(row: Row) -> Estimate:
    """Return how much better b is than a, of a row of `Verdicts.difference`."""
    return Estimate(row["lead"], row["lead_low"], row["lead_high"])


def undecided(differences: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of `paired_differences` of which nothing can be said.

    They have too few objects, or no value on both sides. Where no object has moved the row is not
    among them: it can be said that nothing changed.
    """
    is_open = differences["objects_needed"].notna() | differences["difference"].isna()
    return differences[(differences["ahead"] == "unknown") & is_open]


def who_is_ahead(lead: Estimate) -> Ahead:
    """Return the better side by the interval of b's lead: "tie" where that holds 0.

    "unknown" where there is no interval.
    """
    if not math.isfinite(lead.low):
        return "unknown"
    if round(lead.low, INTERVAL_DECIMALS) > 0:
        return "b"
    if round(lead.high, INTERVAL_DECIMALS) < 0:
        return "a"
    return "tie"


def by_method(compared: pd.DataFrame) -> dict[str, dict[tuple[str, ...], Row]]:
    """Return the rows of a comparison by method, and then by criterion."""
    rows: dict[str, dict[tuple[str, ...], Row]] = {}
    for row in compared.to_dict("records"):
        rows.setdefault(row["method"], {})[tuple(row[name] for name in CRITERION)] = row
    return rows


def two_methods(compared: pd.DataFrame, metrics: Sequence[str], a: str, b: str) -> pd.DataFrame:
    """Return the differences of two methods by some metrics, which are corrected together.

    Rows are in the order of the metrics. A criterion that one of the two has no row of is left out.
    """
    rows = by_method(compared)
    of_a, of_b = rows.get(a, {}), rows.get(b, {})
    shared = [criterion for criterion in of_a if criterion in of_b]
    pairs = []
    for metric in metrics:
        of_metric = [criterion for criterion in shared if criterion[0] == metric]
        pairs += [(of_a[criterion], of_b[criterion]) for criterion in of_metric]
    return paired_differences(pairs)


class Verdicts:
    """The verdicts on who is ahead of whom among the methods of a run.

    Two methods are compared under all conditions and on all classes. The metrics of the headline
    are corrected for together; each further metric is corrected for alone.
    """

    def __init__(self, headline: pd.DataFrame, further: pd.DataFrame | None = None) -> None:
        """Take the comparison by the headline's metrics, and that by the metrics of a table."""
        self._together = set(headline["metric"])
        self._headline = by_method(headline)
        self._further = self._headline if further is None else by_method(further)
        self._known: dict[tuple[str, ...], dict[tuple[str, ...], Row]] = {}

    def difference(self, a: str, b: str, metric: str, condition: str, class_name: str) -> Row:
        """Return the difference of two methods by a criterion, as a row of `paired_differences`.

        It also has `lead` with `lead_low` and `lead_high`: how much better b is than a.
        """
        of_headline = metric in self._together
        family = (
            a,
            b,
            "" if of_headline else metric,
        )  # comparisons that are corrected together for their number
        if family not in self._known:
            rows = self._headline if of_headline else self._further
            of_a, of_b = rows[a], rows[b]
            criteria = [criterion for criterion in of_a if criterion in of_b]
            if not of_headline:
                criteria = [criterion for criterion in criteria if criterion[0] == metric]
            pairs = [(of_a[criterion], of_b[criterion]) for criterion in criteria]
            differences = _bonferroni_differences(pairs)
            self._known[family] = dict(zip(criteria, differences, strict=True))
        return self._known[family][metric, condition, class_name]

    def shows(self, better: str, worse: str, at: Row) -> bool:
        """Return whether a method is shown to be better than another, by the criterion of a row."""
        metric, condition, class_name = (at[name] for name in CRITERION)
        return self.difference(worse, better, metric, condition, class_name)["ahead"] == "b"


def verdicts_of(run: Run, metrics: Sequence[str], methods: Iterable[str] | None = None) -> Verdicts:
    """Return the verdicts of a run, by the metrics of its headline and by those of a table."""
    return Verdicts(compared(run, run.headline, methods), compared(run, metrics, methods))
