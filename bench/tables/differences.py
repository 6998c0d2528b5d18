"""The table of `bench compare`: two runs, or two methods of one run, paired object by object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from bench.analysis.comparison import ALL
from bench.analysis.digits import decimals, is_coarse
from bench.analysis.intervals import FEWEST
from bench.analysis.paired import KEPT, PairedDifference
from bench.analysis.run_pairs import Differences
from bench.catalogue.metrics import higher_is_better
from bench.tables import markdown
from bench.tables.grid import (
    BOLD,
    NOTHING,
    Annotation,
    Block,
    Cell,
    marked,
    number,
    ordered,
    pivot,
    shown,
)
from bench.tables.table import Table, columns

_MARKS = {
    "a": BOLD,
    "b": BOLD,
    "tie": Annotation("tie", "{value}{interval} ="),
}
_TOO_FEW = Annotation("too few objects", "{value}{interval} ?")


def differences_table(differences: Differences) -> Table[PairedDifference]:
    """Return a row for each cell; people see a grid for each metric and class."""
    csv = (
        *columns(("metric", "pair.metric"), ("condition", "pair.condition")),
        *columns(("class", "pair.class_name"), ("run_a", "pair.a.run")),
        *columns(("method_a", "pair.a.method"), ("run_b", "pair.b.run")),
        *columns(("method_b", "pair.b.method"), ("value_a", "pair.quality_a.estimate.value")),
        *columns(("value_b", "pair.quality_b.estimate.value")),
        *columns(("difference", "difference.value"), ("ci_low", "difference.low")),
        *columns(("ci_high", "difference.high"), "level", "p", "p_corrected", "cells"),
        *columns("ahead", ("objects", "pair.objects"), "objects_needed"),
    )
    title = f"{differences.b} against {differences.a}, scored against {differences.truth}"
    layout = partial(_layout, differences.remarks)
    return Table.of_rows("differences", title, csv, differences.cells, layout)


def _layout(remarks: Sequence[str], rows: Sequence[PairedDifference]) -> Iterator[Block]:
    yield _legend(rows)
    yield from remarks
    if any(row.pair.objects < FEWEST for row in rows):
        yield f"Fewer than {FEWEST} objects have no interval, and show no difference."
    for metric, class_name in ordered((r.pair.metric, r.pair.class_name) for r in rows):
        of_grid = [r for r in rows if (r.pair.metric, r.pair.class_name) == (metric, class_name)]
        better = "higher" if higher_is_better(metric) else "lower"
        yield f"## {markdown.cell(f'{metric}, {class_name}')} ({better} is better)"
        yield pivot(
            of_grid,
            "pair.b.method",
            "pair.condition",
            difference_cell,
            corner="method",
            line_name=_methods,
        )


def _legend(rows: Sequence[PairedDifference]) -> str:
    """Return the meaning of the marks that the cells can have."""
    legend = (
        "Each cell: value of a, value of b, and b - a with its interval, paired object by object, "
        "failed images scored as blank ones."
    )
    if any(row.cells for row in rows):
        legend += (
            f" {intervals_in_words(rows)} **Bold**: the two differ, the interval leaves out 0. "
            "`=`: no difference is shown, it holds 0."
        )
    if needed := [row.objects_needed for row in rows if row.objects_needed]:
        legend += f" `?`: {too_few(max(needed))}."
    return legend


def intervals_in_words(rows: Sequence[PairedDifference]) -> str:
    """Return a sentence on the intervals that decide; empty where no cell has one."""
    several = len({row.pair.class_name for row in rows}) > 1
    levels: dict[tuple[int, float], bool] = {}
    for row in rows:
        if row.cells:
            levels[row.cells, row.level] = row.pair.class_name == ALL
    parts = [
        f"{100 * level:.4g} %"
        + (f", which is 95 % for all {cells} cells together" if cells > 1 else "")
        + (" of all objects" if pooled else " of the classes") * several
        for (cells, level), pooled in levels.items()
    ]
    return f"Intervals are of {'; and of '.join(parts)}." if parts else ""


def too_few(objects_needed: int) -> str:
    """Return the words for a cell that so few objects cannot decide."""
    return f"too few objects to decide: at least {objects_needed}"


def _methods(row: PairedDifference) -> str:
    a, b = row.pair.a.method, row.pair.b.method
    return b if a == b else f"{b} against {a}"


def difference_cell(row: PairedDifference) -> Cell:
    """Return both values and their difference with its interval; a dash where it has none."""
    if not math.isfinite(row.difference.value):
        return NOTHING
    metric, methods = row.pair.metric, row.pair.methods
    digits = decimals(metric, *methods)
    of_a, of_b = row.pair.quality_a.estimate, row.pair.quality_b.estimate
    values = f"{shown(of_a.value, digits)} to {shown(of_b.value, digits)}: "
    special = _TOO_FEW if row.objects_needed else _MARKS.get(row.ahead)
    decisive = min(map(abs, row.difference[1:]))
    while row.ahead in ("a", "b") and digits < KEPT and not round(decisive, digits):
        digits += 1  # an interval that leaves out 0 does not print it
    cell = number(row.difference, f"{{:+.{digits}f}}".format, special=special)
    return marked(replace(cell, text=values + cell.text), is_coarse(metric, *methods))
