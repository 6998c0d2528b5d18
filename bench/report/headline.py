"""The headline of a report: one compact table of the values, methods by their first metric."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.analysis.digits import is_coarse
from bench.analysis.scores import QualityRow
from bench.catalogue.conditions import condition_name, condition_words
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import higher_is_better
from bench.report.page import CompactCell, CompactColumn, CompactTable
from bench.tables.grid import MOVED, Tags, ordered, shown
from bench.tables.quality import best_printed, is_worse


def compact_table(rows: Sequence[QualityRow]) -> CompactTable | None:
    """Return the values of the headline, with a column for each metric and condition.

    The best of the first metric stand first, the reference methods last. The best of a column is
    marked, and what is worse than a white image. None without a value.
    """
    rows = [row for row in rows if not row.skipped]
    if not any(math.isfinite(row.value) for row in rows):
        return None
    metrics = ordered(row.metric for row in rows)
    columns = ordered((row.metric, row.condition) for row in rows)
    columns.sort(key=lambda column: metrics.index(column[0]))
    at = {(row.method, row.metric, row.condition): row for row in rows}
    best: set[tuple[str, str, str]] = set()
    blank: dict[tuple[str, str], QualityRow] = {}
    for metric, condition in columns:
        of_column = [row for row in rows if (row.metric, row.condition) == (metric, condition)]
        best |= {(method, metric, condition) for _, _, method in best_printed(of_column)}
        if floor := [row for row in of_column if row.method == FLOOR]:
            blank[metric, condition] = floor[0]

    def cell(method: str, column: tuple[str, str]) -> CompactCell:
        row = at.get((method, *column))
        if row is None or not math.isfinite(row.value):
            return CompactCell("–", None, row.note if row else "not measured")
        digits, coarse = row.decimals, is_coarse(row.metric, row.measured_method)
        texts = [f"{method}, {row.metric}, {condition_words(row.condition)}"]
        if math.isfinite(row.ci_low):
            ends = shown(row.ci_low, digits), shown(row.ci_high, digits)
            texts.append("95 % interval {} to {}".format(*ends))
        if row.failed:
            texts.append(f"{row.n_ok} of {row.n} images, the others scored as blank ones")
        return CompactCell(
            MOVED * coarse + shown(row.value, digits) + "*" * row.failed,
            row.value,
            "; ".join(texts),
            best=(method, *column) in best,
            below=column in blank and is_worse(row, blank[column]),
        )

    def place(method: str) -> tuple[bool, float]:
        of_first = [_signed(r) for r in rows if (r.method, r.metric) == (method, metrics[0])]
        values = [value for value in of_first if math.isfinite(value)]
        mean = sum(values) / len(values) if values else -math.inf
        return role(method) in ("ceiling", "floor"), -mean

    def tags(method: str) -> Tags:
        of_method = [row for row in rows if row.method == method]
        outcomes = {
            "failed": any(row.failed for row in of_method),
            "ok": any(row.n_ok > 0 for row in of_method),
        }
        return Tags(method=method, outcomes=tuple(o for o, occurs in outcomes.items() if occurs))

    methods = sorted(ordered(row.method for row in rows), key=place)
    names = [condition_name(condition) for _, condition in columns]
    return CompactTable(
        tuple(
            CompactColumn(
                *(metric, name.kind * (name.kind != "points"), name.short, name.words),
                higher_is_better(metric),
                Tags(condition=condition),
            )
            for (metric, condition), name in zip(columns, names, strict=True)
        ),
        tuple(
            (method, role(method), tags(method), tuple(cell(method, c) for c in columns))
            for method in methods
        ),
        failed=any(row.failed for row in rows),
        coarse=any(is_coarse(row.metric, row.measured_method) for row in rows),
    )


def _signed(row: QualityRow) -> float:
    """Return the value in the digits that it is printed with, signed so that more is better."""
    value = round(row.value, row.decimals)
    return value if higher_is_better(row.metric) else -value
