"""Quality against cost in tables: the frontier, and what fewer points save."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bench.analysis.comparison import Comparison, Estimate, decimals, milliseconds
from bench.analysis.frontier import Place, Thinned, places, thinned
from bench.tables import markdown
from bench.tables.table import csv_text

PLACE_HEADER = (
    *("condition", "class", "views", "metric", "method", "cost_ms", "cost_ci_low", "cost_ci_high"),
    *("value", "ci_low", "ci_high", "n_ok", "n", "verdict", "rival"),
)
POINTS_HEADER = (
    *("class", "metric", "method", "condition", "points", "views"),
    *("cost_ms", "cost_ci_low", "cost_ci_high", "value", "ci_low", "ci_high"),
    *("lost", "lost_ci_low", "lost_ci_high"),
)
MARKS = {"tied": " =", "reference": " *ref*"}


@dataclass(frozen=True)
class FrontierTable:
    """The places of all methods, at each condition and for each number of views.

    remark  what people have to know to read it
    """

    places: tuple[Place, ...]
    remark: str
    name: str = "frontier"

    def to_csv(self) -> str:
        """Numbers with 6 decimals; an empty field where there is none."""
        return csv_text(
            PLACE_HEADER,
            (
                [
                    *(p.condition, p.class_name, p.views, p.metric, p.method),
                    *map(_field, (*p.cost_ms, *p.quality)),
                    *(p.n_ok, p.n, p.verdict, p.rival),
                ]
                for p in self.places
            ),
        )

    def to_markdown(self) -> str:
        """A table for each condition and number of views: methods by rising cost."""
        lines = ["# Quality against cost", "", self.remark, "", _LEGEND, ""]
        for cell in dict.fromkeys((p.condition, p.class_name, p.views) for p in self.places):
            of_cell = [p for p in self.places if (p.condition, p.class_name, p.views) == cell]
            condition, class_name, views = cell
            title = f"{condition}, {class_name}, {_of_views(views)}"
            lines += [f"## {markdown.cell(title)}", "", *_cell_lines(of_cell), ""]
        return "\n".join(lines)


_LEGEND = (
    "**Bold**: on the frontier, no other is at least as good for at most that cost. `=`: something "
    "that costs no more is at least as good, but the paired difference may be none (its 95 % "
    "interval holds 0). Neither: clearly dominated. *ref*: no choice, it sees the mesh or no "
    "cloud. Costs in milliseconds for a cloud with its views, median over objects; qualities "
    "are means over objects, failed pictures scored as blank ones. [95 % interval over objects]."
)


@dataclass(frozen=True)
class PointsTable:
    """What a method loses and saves where a cloud has fewer points."""

    rows: tuple[Thinned, ...]
    views: int
    name: str = "points"

    def to_csv(self) -> str:
        """As `FrontierTable.to_csv`."""
        return csv_text(
            POINTS_HEADER,
            (
                [
                    *(r.class_name, r.metric, r.method, r.condition, r.points, self.views),
                    *map(_field, (*r.cost_ms, *r.quality, *r.lost)),
                ]
                for r in self.rows
            ),
        )

    def to_markdown(self) -> str:
        """A table for each metric: a row for each method, numbers of points across."""
        lines = [
            "# Quality against the number of points",
            "",
            f"Clouds with {_of_views(self.views)}: value, loss against the full cloud [95 % "
            "interval, paired over objects], milliseconds. A loss under 0 is a gain.",
            "",
        ]
        for cell in dict.fromkeys((row.class_name, row.metric) for row in self.rows):
            rows = [row for row in self.rows if (row.class_name, row.metric) == cell]
            counts = sorted({row.points for row in rows}, reverse=True)
            at = {(row.method, row.points): row for row in rows}
            lines += [
                f"## {markdown.cell(cell[1])}, {markdown.cell(cell[0])}",
                "",
                markdown.row(["method", *(f"{count} points" for count in counts)]),
                "|---" * (len(counts) + 1) + "|",
            ]
            for method in dict.fromkeys(row.method for row in rows):
                told = [_thinned_cell(at[method, n]) if (method, n) in at else "-" for n in counts]
                lines.append(markdown.row([markdown.cell(method), *told]))
            lines.append("")
        return "\n".join(lines)


def frontier_table(
    comparisons: Sequence[Comparison], metrics: Sequence[str], views: int, remark: str
) -> FrontierTable:
    """Places for clouds with so many views, and with one: the frontier is another."""
    return FrontierTable(
        tuple(
            place
            for count in dict.fromkeys((views, 1))
            for comparison in comparisons
            for place in places(comparison, metrics, count)
        ),
        remark,
    )


def points_table(
    comparisons: Sequence[Comparison], metrics: Sequence[str], views: int
) -> PointsTable:
    """What fewer points cost and save, for clouds with so many views."""
    return PointsTable(tuple(thinned(comparisons, metrics, views)), views)


def _cell_lines(of_cell: Sequence[Place]) -> list[str]:
    metrics = list(dict.fromkeys(p.metric for p in of_cell))
    at = {(p.method, p.metric): p for p in of_cell}
    costs = {p.method: p for p in of_cell}
    by_cost = sorted(costs.values(), key=lambda p: (not math.isfinite(p.cost_ms.value), p.cost_ms))
    lines = [
        markdown.row(["method", "ms", *map(markdown.cell, metrics), "pictures"]),
        "|---" * (len(metrics) + 3) + "|",
    ]
    for p in by_cost:
        qualities = [_quality_cell(at[p.method, metric]) for metric in metrics]
        cost = milliseconds(p.cost_ms.value) + _interval(p.cost_ms, milliseconds)
        lines.append(markdown.row([markdown.cell(p.method), cost, *qualities, f"{p.n_ok}/{p.n}"]))
    return lines


def _quality_cell(place: Place) -> str:
    text = _shown(place.metric, place.quality.value)
    if place.verdict == "frontier":
        text = f"**{text}**"
    return (
        text
        + _interval(place.quality, lambda v: _shown(place.metric, v))
        + MARKS.get(place.verdict, "")
    )


def _thinned_cell(row: Thinned) -> str:
    text = _shown(row.metric, row.quality.value)
    if math.isfinite(row.lost.low) and any(row.lost):
        lost = _shown(row.metric, row.lost.value, "+")
        text += f", {lost}" + _interval(row.lost, lambda v: _shown(row.metric, v, "+"))
    return f"{text}, {milliseconds(row.cost_ms.value)} ms"


def _shown(metric: str, value: float, sign: str = "") -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:{sign}.{decimals(metric)}f}"


def _interval(estimate: Estimate, shown: Callable[[float], str]) -> str:
    if not math.isfinite(estimate.low):
        return ""
    return f" [{shown(estimate.low)}, {shown(estimate.high)}]"


def _of_views(views: int) -> str:
    return "1 view" if views == 1 else f"{views} views"


def _field(value: float) -> str:
    return f"{value:.6f}" if math.isfinite(value) else ""
