"""The tables of a finished run, from its records, and the files they are kept in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import compared
from bench.analysis.differences import verdicts_of
from bench.analysis.frontier import frontier_verdicts, thinned_clouds
from bench.analysis.paper import Published, orderings
from bench.analysis.run import Run
from bench.analysis.sets import ImageSet
from bench.analysis.sweeps import condition_curves, condition_leads
from bench.analysis.tails import INVENTED, tail_images, tail_rows
from bench.catalogue.suites import Suite
from bench.entered.claims import ENTERED
from bench.records.folder import PROTOCOL
from bench.records.frames import scored_metrics
from bench.records.job import TIMES
from bench.tables import markdown
from bench.tables.frontier import frontier_table, points_table
from bench.tables.grid import grid
from bench.tables.paper import orderings_table, published
from bench.tables.quality import (
    HEADLINE_TABLE,
    QUALITY_TABLES,
    further_tables,
    headline,
    metric_table_name,
)
from bench.tables.sweeps import condition_sweep_table
from bench.tables.table import Table, of_protocol, remove_stale, write_tables
from bench.tables.tails import TAILS, tails_table
from data_prep.files.atomic_write import write_whole

COST_FILE = "cost.md"  # in the folder of a run


def tables(run: Run) -> list[Table]:
    """Return the tables of quality that the suite of a run declares."""
    paper = paper_values(run.suite)
    with threadpool_limits(1):  # the same last digits on any number of cores
        return [
            _of_run(run, QUALITY_TABLES[spec.kind](run, spec, paper))
            for spec in run.suite.tables
            if spec.kind in QUALITY_TABLES
        ]


def paper_values(suite: Suite) -> Published:
    """Return the paper's values of a suite; none for a truth in grey, which the paper lacks."""
    return published(suite.id) if suite.truth == "coloured" else {}


def _of_run(run: Run, table: Table) -> Table:
    return of_protocol(table, run.suite, run.manifest[PROTOCOL])


def class_orderings(run: Run) -> Table | None:
    """Return which of the paper's orderings in Table 5 hold; None without SR or pc2pix."""
    if (spec := run.suite.table("orderings")) is None:
        return None
    with threadpool_limits(1):
        frame = orderings(run, paper_values(run.suite))
    return None if frame.empty else _of_run(run, orderings_table(spec, run.suite.id, frame))


def curves(run: Run) -> pd.DataFrame:
    """Return `condition_curves` of a run; a suite without such a table gives no rows."""
    with threadpool_limits(1):
        return condition_curves(compared(run, run.measured(run.suite.condition_sweep)))


def condition_sweep(run: Run) -> Table | None:
    """Return which method of a pair is ahead along the families; None without such a pair."""
    spec, metrics = run.suite.table("condition sweep"), run.measured(run.suite.condition_sweep)
    if spec is None or not metrics:
        return None
    with threadpool_limits(1):
        leads = condition_leads(curves(run), verdicts_of(run, metrics))
    return None if leads.empty else _of_run(run, condition_sweep_table(spec, run.suite.id, leads))


def frontier_tables(run: Run) -> tuple[Table, Table] | None:
    """Return the tables of quality against cost, and against the number of points.

    None where the suite does not declare them. They are not among `tables`, with which golden
    values are compared: times differ from run to run.
    """
    frontier, points = run.suite.table("frontier"), run.suite.table("points")
    if frontier is None or points is None:
        return None
    metrics, views = run.measured(run.suite.frontier), int(run.manifest["views"])
    with threadpool_limits(1):
        by_cloud = compared(run, metrics)
        placed = frontier_verdicts(by_cloud, views, verdicts_of(run, metrics))
        fewer = thinned_clouds(by_cloud, views)
    by_cost = frontier_table(frontier, placed, how_timed(run.manifest))
    return _of_run(run, by_cost), _of_run(run, points_table(points, fewer))


def tails(run: Run) -> Table | None:
    """Return the worst images of each method; None without the scores of invented holes or parts.

    They are metrics on request, so that a run has the table once it was scored by one of them.
    """
    if not {*INVENTED} & {*scored_metrics(run.directory)}:
        return None
    images = tail_images(run)
    rows = tail_rows(images, run.suite.id)
    return _of_run(run, tails_table(rows)) if {*INVENTED} & {*rows["metric"]} else None


def write_tails(run: Run) -> Table | None:
    """Return `tails` of a run whose folder is locked, and write the table where there is one."""
    table = tails(run)
    if table is not None:
        write_tables(run.directory, [table])
    return table


@dataclass(frozen=True)
class Outputs:
    """The tables of a run: each field is what the function of the same name returns."""

    run: Run
    headline: Table
    tables: tuple[Table, ...]
    tails: Table | None
    cost: str
    frontier_tables: tuple[Table, Table] | None
    orderings: Table | None
    curves: pd.DataFrame
    condition_sweep: Table | None

    @property
    def further(self) -> list[Table]:
        """Return the tables of this run that not every run has."""
        optional = (*(self.frontier_tables or ()), self.orderings, self.condition_sweep, self.tails)
        return [table for table in optional if table is not None]


def make_outputs(run: Run) -> Outputs:
    """Return all tables of a run."""
    return Outputs(
        run,
        headline=headline(run),
        tables=(*tables(run), *further_tables(run)),
        tails=tails(run),
        cost=cost_table(run),
        frontier_tables=frontier_tables(run),
        orderings=class_orderings(run),
        curves=curves(run),
        condition_sweep=condition_sweep(run),
    )


def write_outputs(run: Run) -> Outputs:
    """Make the tables of a run and write them; tables that it no longer has are removed."""
    outputs = make_outputs(run)
    written = [outputs.headline, *outputs.tables, *outputs.further]
    write_tables(run.directory, written)
    of_suite = (spec.name for spec in run.suite.tables)
    of_images = map(metric_table_name, scored_metrics(run.directory))
    remove_stale(run.directory, written, [HEADLINE_TABLE, TAILS, *of_suite, *of_images])
    write_whole(run.directory / COST_FILE, outputs.cost.encode())
    return outputs


def how_timed(manifest: Mapping[str, Any]) -> str:
    """Return a sentence on how the times of a run were taken."""
    workers = manifest.get("workers")
    if workers == 1:
        beside = "nothing beside it"
    elif workers is None:
        beside = "it is not known what ran beside it"
    else:
        beside = f"{workers} workers at a time: compare costs within this run only"
    cpu = manifest.get("machine", {}).get("cpu", "an unknown processor")
    return (
        f"Wall time of one thread on {markdown.cell(str(cpu))}, {beside}; all {manifest['views']} "
        "views of a cloud drawn in one call."
    )


def cost_table(run: Run) -> str:
    """Return the median costs in milliseconds, per cloud and per view, as Markdown.

    It is kept apart from the tables of results, because times differ from run to run.
    """
    claimed = run.manifest.get(ENTERED, ())
    conditions = list(dict.fromkeys(condition for _, condition, _ in run.image_sets))
    lines = []
    for method in dict.fromkeys(method for method, _, _ in run.image_sets):
        line = [method]
        for condition in conditions:
            of_classes = [s for s in run.image_sets if s[:2] == (method, condition)]
            if not any(run.images(image_set)[0] for image_set in of_classes):
                line.append("-")
                continue
            prepare_ms, draw_ms = (_median_ms(run, of_classes, name) for name in TIMES)
            times = f"{prepare_ms:.1f} + {draw_ms:.1f}"
            line.append(f"{times} claimed" if method in claimed else times)
        lines.append(line)
    title = "# Cost: median milliseconds to prepare a cloud + to draw a view (one thread)"
    return markdown.document([title, how_timed(run.manifest), grid(["method", *conditions], lines)])


def _median_ms(run: Run, image_sets: Sequence[ImageSet], name: str) -> float:
    """Return the median of a column of times over the objects of all classes, in milliseconds."""
    seconds = np.concatenate([run.per_object(image_set, name) for image_set in image_sets])
    return 1000 * float(np.nanmedian(seconds))
