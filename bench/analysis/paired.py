"""Who is ahead: two methods, or one method in two runs, on the same objects.

A cell is a metric under one condition and of one class. Its difference pairs the two object by
object, failed images scored as blank ones (`bench.analysis.comparison`). A sentence about several
cells is corrected for their number m (Bonferroni): each cell has the interval of 1 - SIGNIFICANCE /
m, and a side is ahead where this interval leaves out 0. So no interval contradicts its verdict, and
whatever is said of one cell does not depend on the others. `Verdicts` is what all texts about the
methods of a run ask.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import pandas as pd

from bench.analysis.comparison import NAN, VALUE, Estimate, Row
from bench.analysis.intervals import (
    FEWEST,
    NONE,
    SIGNIFICANCE,
    StandardError,
    clipped,
    jackknife_error,
    mean_error,
)
from bench.catalogue.metrics import higher_is_better, is_mean, value_range

if TYPE_CHECKING:
    from bench.analysis.scored_run import Run

Ahead = Literal["a", "b", "tie", "unknown"]
KEPT = 5  # decimals of an interval that count: sums in another order differ by 1e-6
CELL = ["metric", "condition", "class"]
SIDE = ["run", "method", "images_of", "value"]
LEAD = ["lead", "lead_low", "lead_high"]
_DIFFERENCES = [
    *(*CELL, "run_a", "method_a", "run_b", "method_b", "value_a", "value_b"),
    *("difference", "ci_low", "ci_high", "level", "p", "p_corrected", "cells", "ahead"),
    *("objects", "objects_needed", "failed_a", "failed_b", "images_of_a", "images_of_b"),
]


class QualityChange(NamedTuple):
    """A difference of qualities, its standard error, and the least and largest it can be.

    error  None where there are too few objects
    """

    value: float
    error: StandardError | None
    possible: tuple[float, float] = (-math.inf, math.inf)

    def estimate(self, alpha: float = SIGNIFICANCE) -> Estimate:
        """Return the difference with the interval that misses the true one in `alpha`."""
        interval = self.error.interval(self.value, alpha) if self.error else NONE
        return Estimate(self.value, *clipped(interval, self.possible))

    @property
    def p(self) -> float:
        """Return the two-sided p value of no difference; NaN without an error."""
        return self.error.p_value(self.value) if self.error else NAN


def change(a: Sequence[Row], b: Sequence[Row]) -> QualityChange:
    """Return a - b in the mean over classes, by pairing the two object by object.

    Both have a row of a comparison of each class by one metric, in the same order. A class in which
    no object has a value on both sides does not count.
    """
    metric = a[0]["metric"]
    least, largest = value_range(metric)
    possible = (least - largest, largest - least)
    paired = [x["samples"] - y["samples"] for x, y in zip(a, b, strict=True)]
    if is_mean(metric):
        samples = [known for gain in paired if len(known := gain[~np.isnan(gain)])]
        value = float(np.mean([values.mean() for values in samples])) if samples else NAN
        return QualityChange(value, mean_error(samples), possible)
    value = float(np.mean([x["value"] - y["value"] for x, y in zip(a, b, strict=True)]))
    return QualityChange(value, jackknife_error(paired), possible)


def better_by(a: Sequence[Row], b: Sequence[Row]) -> QualityChange:
    """Return by how much `a` is better than `b`, as `change`: above 0 where a is better."""
    return change(a, b) if higher_is_better(a[0]["metric"]) else change(b, a)


def paired_differences(pairs: Sequence[tuple[Row, Row]]) -> pd.DataFrame:
    """Return the difference of each pair, in their order, corrected for all of them together.

    pairs  rows (a, b) of a comparison, or of two of which each has a `run`, on the same objects

    It has a row for each pair:

    * `metric`, `condition` and `class`; of both sides, `_a` and `_b`, the `run`, the `method`,
      the method whose `images_of` they are, and the `value`
    * `difference`: b - a, with `ci_low` and `ci_high`, the interval that decides, of `level`;
      NaN where there are too few objects
    * `p`: of no difference, two-sided; NaN where there are too few objects; `p_corrected`: the
      same for `cells`, the number of pairs that have one
    * `ahead`: "a" or "b", the better one by an interval without 0, "tie", or "unknown" where it
      has none
    * `objects`: number of those that have a value on both sides; `objects_needed`: how many
      an interval takes where these are too few and not all equal, else None
    * `failed_a` and `failed_b`: numbers of images that failed, which count as blank ones
    """
    rows = _bonferroni_differences(pairs)
    needed = pd.Series([row["objects_needed"] for row in rows], dtype=object)
    return pd.DataFrame(rows, columns=_DIFFERENCES).assign(objects_needed=needed)


def _bonferroni_differences(pairs: Sequence[tuple[Row, Row]]) -> list[Row]:
    changes = [change([b], [a]) for a, b in pairs]
    cells = sum(of_pair.error is not None for of_pair in changes)
    alpha = SIGNIFICANCE / max(cells, 1)
    rows = []
    for sides, of_pair in zip(pairs, changes, strict=True):
        a, b = sides
        difference = of_pair.estimate(alpha)
        lead = difference
        if not higher_is_better(a["metric"]):  # 0 has no sign
            lead = Estimate(0.0 - lead.value, 0.0 - lead.high, 0.0 - lead.low)
        ahead = who_is_ahead(lead)
        by_object = b["samples"] - a["samples"]
        known = by_object[~np.isnan(by_object)]
        objects = len(known) if is_mean(a["metric"]) else len(a["objects"])
        # Objects that are all equal need no interval; moves that cancel in the mean are none.
        moved = difference.value != 0 or bool(known.any())
        few = ahead == "unknown" and math.isfinite(difference.value) and moved
        values = (*difference, *lead, 1 - alpha, of_pair.p, min(of_pair.p * cells, 1.0))
        row = {name: a[name] for name in CELL}
        row |= {
            f"{n}_{s}": side.get(n, "") for n in SIDE for s, side in zip("ab", sides, strict=True)
        }
        row |= zip(
            ("difference", *VALUE[1:], *LEAD, "level", "p", "p_corrected"), values, strict=True
        )
        row |= {"cells": cells, "ahead": ahead, "objects": objects}
        row |= {"failed_a": int(a["n"] - a["n_ok"]), "failed_b": int(b["n"] - b["n_ok"])}
        rows.append(row | {"objects_needed": FEWEST if few else None})
    return rows


def undecided(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of `paired_differences` of which nothing can be said.

    They have too few objects, or no value on both sides. Of objects that are all equal it can be
    said that nothing moved.
    """
    is_open = cells["objects_needed"].notna() | cells["difference"].isna()
    return cells[(cells["ahead"] == "unknown") & is_open]


def who_is_ahead(lead: Estimate) -> Ahead:
    """Return the better side by an interval of b's lead without 0, or why none is."""
    if not math.isfinite(lead.low):
        return "unknown"
    return "b" if round(lead.low, KEPT) > 0 else "a" if round(lead.high, KEPT) < 0 else "tie"


def by_method(compared: pd.DataFrame) -> dict[str, dict[tuple[str, ...], Row]]:
    """Return the rows of a comparison by method and cell."""
    rows: dict[str, dict[tuple[str, ...], Row]] = {}
    for row in compared.to_dict("records"):
        rows.setdefault(row["method"], {})[tuple(row[name] for name in CELL)] = row
    return rows


def two_methods(compared: pd.DataFrame, metrics: Sequence[str], a: str, b: str) -> pd.DataFrame:
    """Return the differences of two methods by some metrics, which are corrected together.

    Rows are by metric, in the order of these. Cells that one of them does not have are left out.
    """
    rows = by_method(compared)
    of_a, of_b = rows.get(a, {}), rows.get(b, {})
    cells = [cell for metric in metrics for cell in of_a if cell[0] == metric and cell in of_b]
    return paired_differences([(of_a[cell], of_b[cell]) for cell in cells])


class Verdicts:
    """The verdicts on who is ahead of whom among the methods of a run.

    What is said of two methods is about all conditions, by the metrics of the headline together or
    by one other metric alone, and is corrected for these cells.
    """

    def __init__(self, headline: pd.DataFrame, further: pd.DataFrame | None = None) -> None:
        """Take the comparisons by the metrics of the headline, and by those of a table."""
        self._together = set(headline["metric"])
        self._headline = by_method(headline)
        self._further = self._headline if further is None else by_method(further)
        self._known: dict[tuple[str, ...], dict[tuple[str, ...], Row]] = {}

    def difference(self, a: str, b: str, metric: str, condition: str, class_name: str) -> Row:
        """Return the difference of two methods in a cell, as a row of `paired_differences`.

        It also has `lead` with `lead_low` and `lead_high`: how much better b is than a.
        """
        together = metric in self._together
        family = (a, b, "" if together else metric)
        if family not in self._known:
            of_a, of_b = ((self._headline if together else self._further)[m] for m in (a, b))
            cells = [c for c in of_a if c in of_b and (together or c[0] == metric)]
            rows = _bonferroni_differences([(of_a[cell], of_b[cell]) for cell in cells])
            self._known[family] = dict(zip(cells, rows, strict=True))
        return self._known[family][metric, condition, class_name]

    def shows(self, better: str, worse: str, at: Row) -> bool:
        """Return whether a method is shown to be better than another in the cell of a row."""
        metric, condition, class_name = (at[name] for name in CELL)
        return self.difference(worse, better, metric, condition, class_name)["ahead"] == "b"


def verdicts_of(run: Run, metrics: Sequence[str], methods: Iterable[str] | None = None) -> Verdicts:
    """Return the verdicts of a run class by class, also by the metrics of a table."""
    return Verdicts(run.compared(run.headline, methods), run.compared(metrics, methods))
