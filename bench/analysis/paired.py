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
from dataclasses import dataclass
from typing import Literal

from bench.analysis.comparison import Comparison, Estimate, Quality, change, paired
from bench.analysis.frame import Run
from bench.analysis.intervals import FEWEST, SIGNIFICANCE
from bench.catalogue.metrics import higher_is_better, is_mean

Ahead = Literal["a", "b", "tie", "unknown"]
KEPT = 5  # decimals of an interval that count: sums in another order differ by 1e-6


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

    difference  b - a, with the interval that decides; NaN where there are too few objects
    p           of no difference, two-sided; NaN where there are too few objects
    cells       the number of cells that p is corrected for: those of the sentence that have one
    """

    pair: ComparedPair
    difference: Estimate
    p: float
    cells: int

    @property
    def p_corrected(self) -> float:
        """Return the p value corrected for the number of cells."""
        return min(1.0, self.p * self.cells) if math.isfinite(self.p) else self.p

    @property
    def level(self) -> float:
        """Return the level of the interval: all those of the sentence hold together in 95 %."""
        return 1 - SIGNIFICANCE / max(self.cells, 1)

    @property
    def lead(self) -> Estimate:
        """Return how much better b is than a, with its interval."""
        if higher_is_better(self.pair.metric):
            return self.difference
        value, low, high = self.difference
        return Estimate(0.0 - value, 0.0 - high, 0.0 - low)  # 0 has no sign

    @property
    def ahead(self) -> Ahead:
        """Return who is better, by an interval without 0; unknown where it has none."""
        if not math.isfinite(self.difference.low):
            return "unknown"
        low, high = (round(end, KEPT) for end in self.lead[1:])
        return "b" if low > 0 else "a" if high < 0 else "tie"

    @property
    def objects_needed(self) -> int | None:
        """Return how many objects an interval takes where these are too few; else None."""
        few = self.ahead == "unknown" and math.isfinite(self.difference.value)
        return FEWEST if few else None


def compared_pair(
    metric: str, in_a: Comparison, in_b: Comparison, a: Side, b: Side
) -> ComparedPair:
    """Return the qualities of two sides on the same objects."""
    quality_a, quality_b = in_a.qualities[metric][a.method], in_b.qualities[metric][b.method]
    objects = len(paired(quality_b, quality_a)) if is_mean(metric) else len(in_a.objects)
    return ComparedPair(in_a.condition, in_a.class_name, a, b, quality_a, quality_b, objects)


def paired_differences(pairs: Sequence[ComparedPair]) -> list[PairedDifference]:
    """Return the difference of each pair, in their order, corrected for all of them together."""
    changes = [change([pair.quality_b], [pair.quality_a]) for pair in pairs]
    tested = sum(of_pair.error is not None for of_pair in changes)
    differences = []
    for pair, of_pair in zip(pairs, changes, strict=True):
        decisive = of_pair.estimate(SIGNIFICANCE / max(tested, 1))
        differences.append(PairedDifference(pair, decisive, of_pair.p, tested))
    return differences


class Verdicts:
    """The verdicts on who is ahead of whom among the methods of a run.

    What is said of two methods is about all conditions, by the metrics of the headline together or
    by one other metric alone, and is corrected for these cells.
    """

    def __init__(self, headline: Sequence[Comparison], further: Sequence[Comparison] = ()) -> None:
        """Take the comparisons by the metrics of the headline, and by those of a table."""
        self._headline, self._further = headline, further
        self._known: dict[tuple[str, ...], dict[tuple[str, ...], PairedDifference]] = {}

    def difference(
        self, a: str, b: str, metric: str, condition: str, class_name: str
    ) -> PairedDifference:
        """Return the difference of two methods in a cell."""
        together = bool(self._headline) and metric in self._headline[0].qualities
        family = (a, b, "" if together else metric)
        if family not in self._known:
            of_family = self._headline if together else self._further
            metrics = list(self._headline[0].qualities) if together else [metric]
            cells = two_methods(of_family, metrics, Side("", a), Side("", b))
            self._known[family] = {
                (cell.pair.metric, cell.pair.condition, cell.pair.class_name): cell
                for cell in cells
            }
        return self._known[family][metric, condition, class_name]

    def shows(self, better: str, worse: str, metric: str, at: Comparison) -> bool:
        """Return whether a method is shown to be better than another in a comparison."""
        cell = self.difference(worse, better, metric, at.condition, at.class_name)
        return cell.ahead == "b"


def verdicts_of(
    run: Run, metrics: Sequence[str] = (), methods: Iterable[str] | None = None
) -> Verdicts:
    """Return the verdicts of a run class by class, also by the metrics of a table."""
    further = run.compared(metrics, methods) if metrics else ()
    return Verdicts(run.compared(run.headline, methods), further)


def two_methods(
    compared: Sequence[Comparison], metrics: Sequence[str], a: Side, b: Side
) -> list[PairedDifference]:
    """Return the differences of two methods by some metrics, which are corrected together.

    Cells that one of them does not have are left out.
    """
    both = {a.method, b.method}
    return paired_differences(
        [
            compared_pair(metric, c, c, a, b)
            for metric in metrics
            for c in compared
            if both <= c.qualities.get(metric, {}).keys()
        ]
    )
