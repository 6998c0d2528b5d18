"""The outputs of a run: tables, figures and the report."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from bench.analysis.scored_run import read_run
from bench.catalogue.metrics import metrics_device
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric
from bench.catalogue.suites import Suite
from bench.commands.options import Format
from bench.commands.score import score_run_of
from bench.commands.terminal import LiveTable, Terminal, shown
from bench.records.frames import Artifact, stored_artifacts
from bench.records.job import JobName, timed
from bench.records.run_folder import read_finished, read_manifest
from bench.report.build import REPORT, write_report
from bench.report.figure import FIGURES
from bench.report.run_figures import (
    write_beyond_figures,
    write_class_figures,
    write_figures,
    write_frontier,
)
from bench.running.options import Options, device_of
from bench.running.run import RunResult, run
from bench.tables.build import Outputs, paper_values, write_outputs, write_tails
from bench.tables.latex import PREAMBLE
from bench.tables.markdown import visible
from bench.tables.table import TABLES, Table


def run_suite(options: Options) -> RunResult[Outputs]:
    """Run a suite, or go on with one, and write its tables, figures and report.

    Raises BadInput for an error that the user has to fix; finished jobs are kept.
    """
    device = metrics_device(device_of(options)) if options.metrics else "cpu"
    further = [find_metric(metric_id, device) for metric_id in options.metrics or ()]
    finished = run(options, partial(publish, further=further), partial(Terminal, LiveTable().table))
    if finished.outputs is not None:
        _report(finished.outputs)
    return finished


def publish(
    directory: Path, seconds: dict[str, float], further: Sequence[ImageMetric | SetMetric] = ()
) -> Outputs:
    """Write the tables and figures of a run whose jobs are done and listed.

    The time of each stage is added to `seconds`. `further` are metrics that are taken of its images
    now, each with a table of its own.
    """
    with timed("tables", seconds):
        outputs = write_outputs(read_run(directory, read_manifest(directory)))
    if further:
        with timed("further metrics", seconds):
            tables = score_run_of(outputs.run, further)
        again = {table.name for table in tables}  # scored before, and now once more
        before = (table for table in outputs.tables if table.name not in again)
        outputs = replace(outputs, tables=(*before, *tables), tails=write_tails(outputs.run))
    with timed("figures", seconds):
        _write_figures(directory, outputs.run.suite, outputs, stored_artifacts(directory))
    return outputs


def print_outputs(outputs: Outputs, format_: Format | None) -> None:
    """Print all tables of a run; without a format, the headline table and two paths."""
    directory = outputs.run.directory
    if format_ is None:
        print("\n".join(shown(outputs.headline)))
        print(f"report: {directory / REPORT}\ntables: {directory / TABLES}")
    elif format_ is Format.md:
        tables = (table.to_markdown() for table in outputs.tables)
        print("\n".join([*tables, outputs.cost, *(t.to_markdown() for t in outputs.further)]))
    else:
        first = [outputs.headline] * (format_ is Format.latex)
        print(in_format([*first, *outputs.tables, *outputs.further], format_), end="")


def in_format(tables: Sequence[Table], format_: Format) -> str:
    """Return tables as one text.

    In CSV, tables with the same columns share a header, and an empty line stands before others.
    JSON is a list of tables with their rows, null for a missing value. Where stdout is a terminal,
    control characters in names are escaped, as nothing else there may give it orders.
    """
    text = _in_format(tables, format_)
    return "\n".join(map(visible, text.split("\n"))) if sys.stdout.isatty() else text


def _in_format(tables: Sequence[Table], format_: Format) -> str:
    if format_ is Format.md:
        return "\n".join(table.to_markdown() for table in tables)
    if format_ is Format.latex:
        return "\n".join([PREAMBLE, *(table.to_latex() for table in tables)])
    if format_ is Format.json:
        listed = [
            {"name": table.name, "title": table.title, "rows": table.to_rows()} for table in tables
        ]
        return json.dumps(listed, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    rows: dict[str, list[str]] = {}
    for table in tables:
        header, _, values = table.to_csv().partition("\n")
        rows.setdefault(header, []).append(values)
    return "\n".join(f"{header}\n{''.join(values)}" for header, values in rows.items())


def _report(outputs: Outputs) -> None:
    # The manifest has been finished since the tables were made.
    run = replace(outputs.run, manifest=read_finished(outputs.run.directory))
    write_report(replace(outputs, run=run))


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
