"""The steps after the jobs of a run, in their order: tables, further metrics, figures, report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from bench.analysis.run import Run, read_run
from bench.catalogue.metrics import column, metrics_device
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric
from bench.catalogue.suites import Suite
from bench.records.folder import locked_run, read_finished, read_manifest
from bench.records.frames import Artifact, stored_artifacts
from bench.records.job import COLUMNS, JobName, timed
from bench.records.store import open_store
from bench.report.build import write_report
from bench.report.plots import FIGURES
from bench.report.run_figures import (
    write_beyond_figures,
    write_class_figures,
    write_figures,
    write_frontier,
)
from bench.running.options import Options, device_of
from bench.running.run import RunResult, Watch, run
from bench.scoring import further_rows
from bench.tables.build import Outputs, paper_values, write_outputs, write_tails
from bench.tables.quality import metric_table
from bench.tables.table import Table, write_tables
from data_prep.failures import BadInput


def run_suite(options: Options, watch: Watch) -> RunResult[Outputs]:
    """Run a suite, or go on with a run of it, and write its tables, figures and report.

    watch  returns the reporter of progress, see `bench.running.run.run`

    Tables and figures are written while the folder is locked. The report is written afterwards,
    because it needs the finished run's manifest. Raises BadInput for an error that the user has to
    fix; finished jobs are kept.
    """
    device = metrics_device(device_of(options)) if options.metrics else "cpu"
    further = [find_metric(metric_id, device) for metric_id in options.metrics or ()]
    finished = run(options, partial(write_tables_and_figures, further=further), watch)
    if finished.outputs is not None:
        scored = replace(finished.outputs.run, manifest=read_finished(finished.directory))
        write_report(replace(finished.outputs, run=scored))
    return finished


def write_tables_and_figures(
    directory: Path, seconds: dict[str, float], further: Sequence[ImageMetric | SetMetric] = ()
) -> Outputs:
    """Write the tables and figures of a run whose jobs are done and listed, and return them.

    directory  the folder of the run, which the caller has locked
    seconds    gets the time of each stage, which is added to what it has
    further    metrics beside those of the suite; they are taken of the images now, and each has a
               table of its own
    """
    with timed("tables", seconds):
        outputs = write_outputs(read_run(directory, read_manifest(directory)))
    if further:
        with timed("further metrics", seconds):
            tables = _write_metric_tables(outputs.run, further)
        # A metric may have a table from before, of the scores that have been replaced now.
        written = {table.name for table in tables}
        others = (table for table in outputs.tables if table.name not in written)
        outputs = replace(outputs, tables=(*others, *tables), tails=write_tails(outputs.run))
    with timed("figures", seconds):
        _write_figures(directory, outputs.run.suite, outputs, stored_artifacts(directory))
    return outputs


def score_run(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
    """Score a finished run by some metrics, and return the tables, which are written, too.

    Each metric has a table, metric_ID.csv and .md. The last table is that of the tails, where the
    run has been scored by the metrics that it shows, now or before. The folder is locked meanwhile.
    Raises BadInput for missing images, and where a metric fails or gives no scores.
    """
    with locked_run(run.directory):
        tables, tails = _write_metric_tables(run, metrics), write_tails(run)
    return tables if tails is None else [*tables, tails]


def _write_metric_tables(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
    """Score a run by some metrics, write a table of each, and return the tables.

    The caller has locked the folder. Raises BadInput as `score_run`, and for a metric whose id is
    the name of a column of the records.
    """
    for metric in metrics:
        if column(metric.id) in COLUMNS:
            raise BadInput(
                f"metric '{metric.id}': the records have a column of that name; rename it"
            )
    with open_store(run.directory, write=True) as store:
        rows = further_rows(run, metrics, store)
    tables = [metric_table(run, *each) for each in zip(metrics, rows, strict=True)]
    write_tables(run.directory, tables)
    return tables


def _write_figures(
    directory: Path, suite: Suite, outputs: Outputs, artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write the figures of the kind that the suite declares."""
    by_class = None  # the table that compares classes, where the suite has one
    if classes := suite.table("classes"):
        by_class = next((table for table in outputs.tables if table.name == classes.name), None)
    if suite.figures == "classes" and by_class is not None:
        write_class_figures(directory, by_class, outputs.headline, paper_values(suite), artifacts)
    elif suite.figures == "frontier" and outputs.frontier_tables is not None:
        frontier, _ = outputs.frontier_tables
        write_frontier(directory / FIGURES, frontier.frame)
    elif suite.figures == "condition sweep" and not outputs.curves.empty:
        write_beyond_figures(directory, outputs.curves, artifacts)
    else:  # also where a run has too few methods or conditions for the figures of its suite
        write_figures(directory, outputs.tables, artifacts)
