"""Methods chosen by measurements: the best of a group at a condition, the best within a budget.

A network should not be compared with a weak rival, and which rival is strong depends on the cloud
and on the metric. So the tables have *chosen rows*. A chosen row is no method of its own: it
shows, for each metric and condition, the method of a group (such as all reconstructions) that had
the best images of validation objects. The choice uses no test object.

`results/costs.csv` has a line for each method whose cost was measured by `python -m
studies.measurements costs`, a run of the suite `speed`. A line has two times in milliseconds: that
of preparing a new cloud of 2,048 points and drawing one view of it, and that of each further view
which the same call draws. Both are medians over four chairs, in processor time on one thread. On a
machine that does nothing else, processor time is the time by the clock.

A method that draws in grey and was not trained on a single class has a score, too: the mean of
`ssim` and 1 - `lpips` over 107 real meshes of 13 classes at 2,048 points, with true images in grey
(`results/docs/real-meshes-grey.csv`). A higher score is better. Scores at more points are not known
yet: those at 2,048 stand for them.

`results/costs-by-points.csv` has the times of these methods at several numbers of points, by
`python -m studies.costs_by_points`. They come from a machine with other work, so that only their
ratios are used: how many times dearer one view is than at 2,048 points.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from bench.catalogue.lookup import family_of
from data_prep.failures import BadInput

BEST_CLASSICAL = "best-classical"
BEST_LEARNED_3D = "best-learned-3d"
# The file of rankings, written by `python -m studies.chosen_order`. For each metric and condition
# it lists the reconstructions, the best first, by their images of validation objects of 13 classes.
# Three metrics have rankings of their own; all others share one, by the mean of a method's ranks by
# ssim-object and lpips. At the conditions 2048, 1024, 512, noise-0.05 and noise-0.10 all methods
# were measured; at the other conditions the last methods of a ranking keep the places that an
# earlier measurement gave them.
RANKINGS = Path(__file__).resolve().parents[2] / "results" / "chosen.csv"
OTHER_METRICS = "*"  # stands in the column "metric" for all metrics without a ranking of their own
COSTS = RANKINGS.with_name("costs.csv")  # the file of costs and scores that the module describes
# The file of costs at several numbers of points, written by `python -m studies.costs_by_points`.
COSTS_BY_POINTS = RANKINGS.with_name("costs-by-points.csv")
MOST_MEASURED = 262_144  # the most points in that file; costs of more are extrapolated
FEWEST_MEASURED = 2048  # the fewest points in that file, those of a cloud of the benchmark
MEASURED_ON = "an AMD EPYC"  # the processor of these costs: family 25, model 17; on 2026-11-30
_UNITS_MS = {"ms": 1.0, "s": 1000.0}  # milliseconds in each unit that a budget may have
_LEARNED_3D = ("occupancy-net",)  # the methods whose networks learned shapes in 3D, the best first

MetricAtCondition = tuple[str, str]  # the id of a metric, and the id of a condition


@dataclass(frozen=True)
class _ChosenRow:
    """A row of tables that shows, for each metric and condition, the best method of a group.

    id       the name of the row in tables and comparisons
    ranking  the methods of the group for each metric and condition, the best first
    fewest   how many methods of the group a run must have; with fewer there is nothing to choose
             from, and the run has no such row
    """

    id: str
    ranking: Mapping[MetricAtCondition, tuple[str, ...]]
    fewest: int

    def best(
        self, wanted: Iterable[MetricAtCondition], methods: Iterable[str]
    ) -> dict[MetricAtCondition, str]:
        """Return which of the methods the row shows for each wanted metric and condition.

        A metric and condition is left out where it has no ranking, and where `methods` has fewer
        than `fewest` methods of the ranking.
        """
        available = set(methods)
        best: dict[MetricAtCondition, str] = {}
        for metric, condition in wanted:
            shared = self.ranking.get((OTHER_METRICS, condition), ())
            ranking = self.ranking.get((metric, condition), shared)
            ranked = [method for method in ranking if method in available]
            if len(ranked) >= self.fewest:
                best[metric, condition] = ranked[0]
        return best

    def in_words(self, best: Mapping[MetricAtCondition, str]) -> str:
        """Return a sentence that says which method the row shows.

        Metrics for which it shows the same methods at the same conditions are named together.
        """
        conditions_of: dict[str, dict[str, list[str]]] = {}  # by metric, then by method
        for (metric, condition), method in best.items():
            conditions_of.setdefault(metric, {}).setdefault(method, []).append(condition)
        metrics_of: dict[str, list[str]] = {}  # by the words for methods and conditions
        for metric, by_method in conditions_of.items():
            parts = [f"`{method}` at {', '.join(at)}" for method, at in by_method.items()]
            metrics_of.setdefault("; ".join(parts), []).append(metric)
        if len(metrics_of) > 1:
            texts = [f"by {', '.join(metrics)} {text}" for text, metrics in metrics_of.items()]
        else:
            texts = list(metrics_of)
        return f"`{self.id}`, chosen on validation objects, is {'; '.join(texts)}."


def _rankings() -> dict[MetricAtCondition, tuple[str, ...]]:
    """Return the rankings of the file, by metric and condition."""
    rankings = {}
    with RANKINGS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            rankings[row["metric"], row["condition"]] = tuple(row["best_first"].split())
    return rankings


_CLASSICAL = _rankings()
_ROWS = (
    _ChosenRow(BEST_CLASSICAL, _CLASSICAL, fewest=2),
    # This row is shown even when a run has only one of these networks, for readers look for the
    # best network that learned in 3D under this name.
    _ChosenRow(BEST_LEARNED_3D, dict.fromkeys(_CLASSICAL, _LEARNED_3D), fewest=1),
)
CHOSEN = {row.id: row for row in _ROWS}


@dataclass(frozen=True)
class MeasuredMethod:
    """A line of the file of costs: a method, its times in milliseconds, and its score.

    one_view_ms      the time of preparing a new cloud and drawing one view of it
    further_view_ms  the time of each further view that the same call draws
    score            the score that the module describes; None for a method without one
    """

    method: str
    one_view_ms: float
    further_view_ms: float
    score: float | None

    def cloud_ms(self, views: int) -> float:
        """Return the milliseconds of preparing a cloud and drawing `views` of it in one call."""
        return self.one_view_ms + (views - 1) * self.further_view_ms


def measured_methods() -> dict[str, MeasuredMethod]:
    """Return the lines of the file of costs, by the ids of their methods."""
    measured = {}
    with COSTS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            measured[row["method"]] = MeasuredMethod(
                method=row["method"],
                one_view_ms=float(row["one_view_ms"]),
                further_view_ms=float(row["further_view_ms"]),
                score=float(row["score"]) if row["score"] else None,
            )
    return measured


def cost_of(method_id: str, costs: Mapping[str, MeasuredMethod]) -> MeasuredMethod | None:
    """Return the measured cost of a method; None where there is none.

    A variant that was not measured (METHOD@VARIANT) has the cost of its METHOD.
    """
    return costs.get(method_id, costs.get(family_of(method_id)))


def times_by_points() -> dict[str, dict[int, float]]:
    """Return the milliseconds of one view by the number of points, for each method measured."""
    times: dict[str, dict[int, float]] = {}
    with COSTS_BY_POINTS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            times.setdefault(row["method"], {})[int(row["points"])] = float(row["one_view_ms"])
    return times


def times_dearer(times: Mapping[int, float], points: int) -> float:
    """Return how many times dearer one view is than at the fewest points that were measured.

    Logarithms are interpolated; beyond the most points the last slope goes on. Fewer points than
    the fewest cost as much as these.

    times  milliseconds by the number of points, at least two
    """
    import numpy as np  # `bench list` answers at once

    counts, logs = np.log(sorted(times)), np.log([times[count] for count in sorted(times)])
    wanted = math.log(max(points, 1))
    log = float(np.interp(wanted, counts, logs))
    slope = (logs[-1] - logs[-2]) / (counts[-1] - counts[-2])
    log += max(wanted - counts[-1], 0.0) * float(slope)
    return math.exp(log - logs[0])


def best_within(budget_ms: float, points: int = FEWEST_MEASURED) -> MeasuredMethod:
    """Return the method with the best score that draws one view of a new cloud within a budget.

    Its cost is that at this number of points. Above 2,048 points the choice is among the methods
    that were measured with more.

    Raises BadInput for a budget below the cost of the cheapest method with a score; the message
    names that method and its cost.
    """
    by_points = times_by_points()
    scores: dict[MeasuredMethod, float] = {}
    for method in measured_methods().values():
        if method.score is None:
            continue
        times = by_points.get(method.method, {})
        if points <= FEWEST_MEASURED:
            scores[method] = method.score
        elif len(times) > 1:
            cost_ms = method.one_view_ms * times_dearer(times, points)
            scores[replace(method, one_view_ms=cost_ms)] = method.score
    affordable = [method for method in scores if method.one_view_ms <= budget_ms]
    if not affordable:
        cheapest = min(scores, key=lambda method: method.one_view_ms)
        # Rounded up to 0.1 ms, so that a budget of this number is enough.
        least = math.ceil(10 * cheapest.one_view_ms) / 10
        raise BadInput(
            f"budget {budget_ms:g}ms: the cheapest method is {cheapest.method} with {least:g} ms "
            f"for one image{of_points(points)}; give at least {least:g}ms"
        )
    return max(affordable, key=lambda method: scores[method])


def of_points(points: int) -> str:
    """Return " of N points" where a cost is that of more than 2,048 points, else nothing."""
    return f" of {points:,} points" if points > FEWEST_MEASURED else ""


def budget_ms_of(text: str) -> float:
    """Return the milliseconds of a budget like "50ms" or "0.2s". Raises BadInput for other text."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(ms|s)", text.strip())
    budget = 0.0
    if match:
        number, unit = match.groups()
        budget = float(number) * _UNITS_MS[unit]
    if budget == 0:
        raise BadInput(f"budget {text}: give a time over 0 with its unit, as in 50ms or 0.2s")
    return budget
