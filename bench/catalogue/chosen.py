"""Methods chosen by measurements: the best of a group at a condition, the best within a budget.

A network should not be compared with a weak rival, and which rival is strong depends on the cloud
and on the metric. So the tables have a row that is, by each metric and at each condition, the
method of a group that had the best images on validation objects; no test object has a part in the
choice.

`results/costs.csv` has a line for each method that was measured by `python -m studies.measurements
costs`, a run of the suite `speed`: the milliseconds of one view of a new cloud of 2,048 points, its
preparation included, and of each view more in the same call, medians over four chairs, in
processor time on one thread. On a machine that does nothing else that is the time by the clock.
That of upsampled-wrap was measured beside alpha-wrap on another machine (988 and 179 ms, further
views 5.08 and 2.49 ms), and is given by the ratio.
Methods in grey that know objects of any kind also have a score, the mean of `ssim` and 1 - `lpips`
over 107 real meshes of 13 classes at 2,048 points, truth in grey
(`results/docs/real-meshes-grey.csv`); more is better.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.catalogue.lookup import family_of
from data_prep.failures import BadInput

BEST_CLASSICAL = "best-classical"
BEST_LEARNED_3D = "best-learned-3d"
# By metric and condition, the best first, of validation objects of 13 classes
# (`python -m studies.chosen_order`); by other metrics than three the mean of the ranks by
# ssim-object and lpips. 2048, 1024, 512 and noise up to 0.10 were measured with all methods;
# elsewhere the last ones stand as in an earlier measurement.
RANKINGS = Path(__file__).resolve().parents[2] / "results" / "chosen.csv"
OTHER_METRICS = "*"  # in place of a metric, for those without a ranking of their own
COSTS = RANKINGS.with_name("costs.csv")
MEASURED_ON = "an AMD EPYC"  # family 25, model 17; 2026-11-27
_UNITS_MS = {"ms": 1.0, "s": 1000.0}
_LEARNED_3D = ("occupancy-net",)

Cell = tuple[str, str]  # metric and condition


@dataclass(frozen=True)
class _ChosenRow:
    """A row that is, by each metric and at each condition, the best method of a group.

    id       its name in tables and comparisons
    ranking  the methods of the group by metric and condition, the best first
    fewest   methods of the group that a run must have for the row to be a choice
    """

    id: str
    ranking: Mapping[Cell, tuple[str, ...]]
    fewest: int

    def best(self, cells: Iterable[Cell], methods: Iterable[str]) -> dict[Cell, str]:
        """Return the best of the methods by each metric and condition that has one.

        None has with fewer than `fewest` of the group, nor where there is no ranking.
        """
        available = set(methods)
        best: dict[Cell, str] = {}
        for metric, condition in cells:
            others = self.ranking.get((OTHER_METRICS, condition), ())
            ranking = self.ranking.get((metric, condition), others)
            ranked = [method for method in ranking if method in available]
            if len(ranked) >= self.fewest:
                best[metric, condition] = ranked[0]
        return best

    def in_words(self, best: Mapping[Cell, str]) -> str:
        """Return a sentence on which method the row is; metrics with the same methods together."""
        by_metric: dict[str, dict[str, list[str]]] = {}
        for (metric, condition), method in best.items():
            by_metric.setdefault(metric, {}).setdefault(method, []).append(condition)
        metrics: dict[str, list[str]] = {}
        for metric, conditions in by_metric.items():
            parts = (f"`{method}` at {', '.join(at)}" for method, at in conditions.items())
            metrics.setdefault("; ".join(parts), []).append(metric)
        several = len(metrics) > 1
        texts = (f"by {', '.join(m)} {text}" if several else text for text, m in metrics.items())
        return f"`{self.id}`, chosen on validation objects, is {'; '.join(texts)}."


def _rankings() -> dict[Cell, tuple[str, ...]]:
    with RANKINGS.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return {(r["metric"], r["condition"]): tuple(r["best_first"].split()) for r in rows}


_CLASSICAL = _rankings()
_ROWS = (
    _ChosenRow(BEST_CLASSICAL, _CLASSICAL, fewest=2),
    # One network that learned in 3D is enough: readers look for the best of them by this name.
    _ChosenRow(BEST_LEARNED_3D, dict.fromkeys(_CLASSICAL, _LEARNED_3D), fewest=1),
)
CHOSEN = {row.id: row for row in _ROWS}


@dataclass(frozen=True)
class MeasuredMethod:
    """A method with the milliseconds of its views of a cloud, and its score or None.

    one_view_ms      preparing a new cloud and drawing one view of it, in a call of its own
    further_view_ms  each view more in the same call
    """

    method: str
    one_view_ms: float
    further_view_ms: float
    score: float | None

    def cloud_ms(self, views: int) -> float:
        """Return the milliseconds of a new cloud with so many views, drawn in one call."""
        return self.one_view_ms + (views - 1) * self.further_view_ms


def measured_methods() -> dict[str, MeasuredMethod]:
    """Return the lines of the table by method."""
    with COSTS.open(encoding="utf-8", newline="") as file:
        return {
            row["method"]: MeasuredMethod(
                row["method"],
                float(row["one_view_ms"]),
                float(row["further_view_ms"]),
                float(row["score"]) if row["score"] else None,
            )
            for row in csv.DictReader(file)
        }


def cost_of(method_id: str, costs: Mapping[str, MeasuredMethod]) -> MeasuredMethod | None:
    """Return the cost of a method, or for one that was not measured that of its family."""
    return costs.get(method_id, costs.get(family_of(method_id)))


def best_within(budget_ms: float) -> MeasuredMethod:
    """Return the method with the best score that draws a view of a new cloud within a budget.

    Raises BadInput for a budget below the cheapest, which it names with its cost.
    """
    scored = {m: m.score for m in measured_methods().values() if m.score is not None}
    within = [m for m in scored if m.one_view_ms <= budget_ms]
    if not within:
        cheapest = min(scored, key=lambda m: m.one_view_ms)
        least = math.ceil(10 * cheapest.one_view_ms) / 10  # rounded up, so that giving it is enough
        raise BadInput(
            f"budget {budget_ms:g}ms: the cheapest method is {cheapest.method} with {least:g} ms "
            f"for one image; give at least {least:g}ms"
        )
    return max(within, key=lambda m: scored[m])


def budget_ms_of(text: str) -> float:
    """Return the milliseconds of a budget like "50ms" or "0.2s". Raises BadInput for other text."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(ms|s)", text.strip())
    budget = float(match[1]) * _UNITS_MS[match[2]] if match else 0.0
    if not budget:
        raise BadInput(f"budget {text}: give a time over 0 with its unit, as in 50ms or 0.2s")
    return budget
