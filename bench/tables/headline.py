"""The table that a run shows while it goes on, and at its end: few metrics, all methods.

With one class methods are down and conditions across; with several it is the mean over classes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from threadpoolctl import threadpool_limits

from bench.analysis.comparison import NAN, decimals
from bench.analysis.paired import SIGNIFICANCE
from bench.analysis.paper import AVERAGE
from bench.analysis.resolution import POWER, CellResolution, cell_resolutions
from bench.analysis.scored import ScoredRun
from bench.analysis.scores import (
    QualityRow,
    RowWithSamples,
    image_rows,
    set_rows,
    with_averages,
)
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.metrics import is_mean
from bench.catalogue.suite_types import Suite
from bench.records.run_folder import PROTOCOL
from bench.tables.grid import Block, Cell, Grid, TableRow, shown
from bench.tables.quality import QUALITY_COLUMNS, all_methods, annotated, with_chosen_rows
from bench.tables.table import Column, Table, of_protocol

HEADLINE = "headline"
COULD_SHOW = "could show"  # name of the line of resolutions
FEWEST_SHOWN = 12  # objects: intervals of fewer are so wide and so uncertain that they mislead here


def headline(run: ScoredRun) -> Table[QualityRow]:
    """Return the headline metrics of the suite over the objects that are complete."""
    metrics = run.suite.headline
    with threadpool_limits(1):
        rows = image_rows(run, [metric for metric in metrics if is_mean(metric)])
        for metric in metrics:
            rows += [] if is_mean(metric) else set_rows(run, metric)
        measured = run.measured(metrics)
        average = AVERAGE if run.suite.table("classes") else ""
        compared = run.compared(measured) if measured else []
        resolutions = cell_resolutions(compared, measured, SIGNIFICANCE, average)
        return headline_of(run.suite, run.manifest, rows, resolutions)


def headline_of(
    suite: Suite,
    manifest: Mapping[str, Any],
    rows: Sequence[RowWithSamples],
    resolutions: Sequence[CellResolution] = (),
) -> Table[QualityRow]:
    """Return the headline table of the rows of all cells.

    People see intervals from FEWEST_SHOWN objects on, and below each grid the smallest difference
    between the best method and the next that the table can show; its CSV has them before, and the
    resolution of each method against the best. A run that still goes on has no `resolutions`.
    """
    chosen = [row for row, _ in rows]
    if suite.table("classes"):
        of_metrics = ([r for r in rows if r.row.metric == metric] for metric in suite.headline)
        averages = (row for of_metric in of_metrics for row in with_averages(of_metric))
        chosen = [row for row in averages if row.class_name == AVERAGE]
    objects = len(manifest["objects"])
    planned = manifest.get("planned", objects)
    title = f"{' and '.join(suite.headline)}: {objects} of {planned} objects"

    def layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
        if objects < FEWEST_SHOWN:
            yield f"Intervals are shown from {FEWEST_SHOWN} objects on."
            rows = [replace(row, ci_low=NAN, ci_high=NAN) for row in rows]
        elif objects < planned:
            yield (
                "Intervals hold for a number of objects that was fixed beforehand; those of the "
                "table `decided` hold whenever one looks."
            )
        if objects < FEWEST_SHOWN or not any(map(_of_best, resolutions)):
            yield from all_methods(rows)
            return
        yield (
            f"`{COULD_SHOW}`: the smallest difference between the best method and the next that so "
            f"many objects show in {100 * POWER:.0f} % of all runs, at a level of "
            f"{SIGNIFICANCE} for each comparison, not corrected for their number."
        )
        for block in all_methods(rows):
            yield _with_resolutions(block, resolutions) if isinstance(block, Grid) else block

    by_row = {
        (cell.metric, cell.class_name, cell.condition, method): value
        for cell in resolutions
        for method, value in cell.by_method.items()
    }

    def resolution(row: QualityRow) -> float:
        method = row.note.partition("; ")[0] if row.method in CHOSEN else row.method
        return by_row.get((row.metric, row.class_name, row.condition, method), NAN)

    every = with_chosen_rows(annotated(chosen, manifest, {}))
    columns = (*QUALITY_COLUMNS, Column("resolution", resolution))
    table = Table(HEADLINE, title, columns, every, layout)
    return of_protocol(table, suite, manifest[PROTOCOL])


def _of_best(cell: CellResolution) -> str:
    """Return the resolution of the best method and the next, as printed; empty without one."""
    value = cell.by_method[cell.best]
    return shown(value, decimals(cell.metric)) if math.isfinite(value) else ""


def _with_resolutions(grid: Grid, resolutions: Sequence[CellResolution]) -> Grid:
    """Return the grid of a metric with a last line of what its conditions can show."""
    metric = grid.caption.partition(",")[0]
    at = {
        cell.condition: _of_best(cell)
        for cell in resolutions
        if (cell.metric, cell.class_name) == (metric, grid.tags.class_name)
    }
    if grid.corner != "method" or grid.void:
        return grid
    cells = tuple(Cell(at.get(column.name) or "-") for column in grid.columns)
    return replace(grid, lines=(*grid.lines, TableRow(COULD_SHOW, cells)))
