"""What a run or a merge writes at its end: tables, figures and the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bench.records.artifacts import Artifact
from bench.records.journal import read_finished, read_manifest
from bench.report.build import write_report
from bench.report.classes import write_class_figures
from bench.report.families import write_beyond_figures
from bench.report.pareto import write_frontier
from bench.report.robustness import write_figures
from bench.running.merge import Merged, merge
from bench.running.protocol import Options
from bench.running.run import Finished, Measured, run, timed
from bench.tables.build import Outputs, scored_run, write_outputs
from bench.tables.classes import CLASSES
from bench.tables.figure import FIGURES
from bench.tables.published import published


def run_suite(options: Options) -> Finished[Outputs]:
    """Run a suite of items, or go on with one; its tables, figures and report are in its folder.

    Raises BadInput for anything the user has to fix; what was done until then is kept.
    """
    finished = run(options, publish)
    _report(finished.outputs)
    return finished


def merge_shards(directories: Sequence[Path], out: Path) -> Merged[Outputs]:
    """Put the shards of a run together in `out`. Raises BadInput as `bench.running.merge.merge`."""
    merged = merge(directories, out, publish)
    _report(merged.outputs)
    return merged


def publish(measured: Measured) -> Outputs:
    """Write the tables and figures of a run whose records and features are written."""
    with timed("tables", measured.seconds):
        outputs = write_outputs(scored_run(measured.directory, read_manifest(measured.directory)))
    with timed("figures", measured.seconds):
        _write_figures(measured.directory, measured.suite, outputs, measured.artifacts)
    return outputs


def printed(outputs: Outputs) -> list[str]:
    """What a command prints of a run, in Markdown."""
    of_all = (table.to_markdown() for table in outputs.tables)
    return [*of_all, outputs.cost, *(table.to_markdown() for table in outputs.further)]


def _report(outputs: Outputs) -> None:
    """The manifest has been finished since the tables were made."""
    run = replace(outputs.run, manifest=read_finished(outputs.run.directory))
    write_report(replace(outputs, run=run))


def _write_figures(
    directory: Path, suite: str, outputs: Outputs, artifacts: Sequence[Artifact]
) -> None:
    by_class = next((t for t in outputs.tables if t.name == CLASSES), None)
    if by_class is not None:
        write_class_figures(directory, by_class, published(suite), artifacts)
    elif outputs.trade is not None:
        frontier, _ = outputs.trade
        write_frontier(directory / FIGURES, frontier.rows)
    elif outputs.curves:
        write_beyond_figures(directory, outputs.curves, artifacts)
    else:
        write_figures(directory, outputs.tables, artifacts)
