"""What follows the jobs of a run, in its order: tables, further metrics, figures and the report."""

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
    """Run a suite, or go on with one, and write its tables, figures and report.

    `watch` is as for `bench.running.run.run`. Tables and figures are written while the folder is
    locked, the report afterwards, when the manifest says that the run is finished. Raises BadInput
    for an error that the user has to fix; finished jobs are kept.
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

    The time of each stage is added to `seconds`. `further` are metrics that are taken of its images
    now, each with a table of its own. The folder is locked by the caller.
    """
    with timed("tables", seconds):
        outputs = write_outputs(read_run(directory, read_manifest(directory)))
    if further:
        with timed("further metrics", seconds):
            tables = _write_metric_tables(outputs.run, further)
        again = {table.name for table in tables}  # scored before, and now once more
        before = (table for table in outputs.tables if table.name not in again)
        outputs = replace(outputs, tables=(*before, *tables), tails=write_tails(outputs.run))
    with timed("figures", seconds):
        _write_figures(directory, outputs.run.suite, outputs, stored_artifacts(directory))
    return outputs


def score_run(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
    """Write a table of each metric of a finished run, metric_ID.csv and .md; return all.

    The last is the table of tails, where the run was scored by its metrics, now or before. The
    folder is locked meanwhile. Raises BadInput for missing images, and where a metric fails or
    gives no scores.
    """
    with locked_run(run.directory):
        tables, tails = _write_metric_tables(run, metrics), write_tails(run)
    return tables if tails is None else [*tables, tails]


def _write_metric_tables(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
    """Write the tables of metrics of a run whose folder is locked, and return them."""
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
    classes = suite.table("classes")
    by_class = next((t for t in outputs.tables if classes and t.name == classes.name), None)
    if suite.figures == "classes" and by_class is not None:
        write_class_figures(directory, by_class, outputs.headline, paper_values(suite), artifacts)
    elif suite.figures == "frontier" and outputs.frontier_tables is not None:
        frontier, _ = outputs.frontier_tables
        write_frontier(directory / FIGURES, frontier.frame)
    elif suite.figures == "condition sweep" and not outputs.curves.empty:
        write_beyond_figures(directory, outputs.curves, artifacts)
    else:  # also for a part of a run that has no family of conditions
        write_figures(directory, outputs.tables, artifacts)
