"""What a run or a merge puts out at its end: tables, figures and the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.records.artifacts import Artifact
from bench.report.build import Made, write_report
from bench.report.classes import write_class_figures
from bench.report.families import write_beyond_figures
from bench.report.pareto import write_frontier
from bench.report.robustness import write_figures
from bench.running.merge import Merged, merge
from bench.running.protocol import Options
from bench.running.run import Finished, Measured, run, timed
from bench.tables.build import (
    Beyond,
    Trade,
    write_beyond,
    write_cost,
    write_orderings,
    write_tables,
    write_trade,
)
from bench.tables.classes import CLASSES
from bench.tables.figure import FIGURES
from bench.tables.orderings import Ordering
from bench.tables.published import published
from bench.tables.quality import Row
from bench.tables.table import Table


@dataclass(frozen=True)
class Outputs:
    """The tables of a run.

    trade      quality against cost; None for a suite without
    orderings  SR against pc2pix class by class; None for a suite without
    beyond     methods along families of conditions; None for a suite without
    """

    tables: tuple[Table[Row], ...]
    cost: str
    trade: Trade | None
    orderings: Table[Ordering] | None
    beyond: Beyond | None


def run_suite(options: Options) -> Finished[Outputs]:
    """Run a suite of items, or go on with one; its tables, figures and report are in its folder.

    Raises BadInput for anything the user has to fix; what was done until then is kept.
    """
    finished = run(options, publish)
    _report(finished.directory, finished.outputs)
    return finished


def merge_shards(directories: Sequence[Path], out: Path) -> Merged[Outputs]:
    """Put the shards of a run together in `out`. Raises BadInput as `bench.running.merge.merge`."""
    merged = merge(directories, out, publish)
    _report(out, merged.outputs)
    return merged


def publish(measured: Measured) -> Outputs:
    """Write the tables and figures of a run whose records and features are written."""
    with timed("tables", measured.seconds):
        outputs = write_all_tables(measured.directory)
    with timed("figures", measured.seconds):
        _write_figures(measured.directory, measured.suite, outputs, measured.artifacts)
    return outputs


def write_all_tables(directory: Path) -> Outputs:
    """Make the tables of a run from its records and features, and write them."""
    return Outputs(
        tables=tuple(write_tables(directory)),
        cost=write_cost(directory),
        trade=write_trade(directory),
        orderings=write_orderings(directory),
        beyond=write_beyond(directory),
    )


def printed(outputs: Outputs) -> list[str]:
    """What a command prints of a run, in Markdown."""
    texts = [*(table.to_markdown() for table in outputs.tables), outputs.cost]
    if outputs.trade is not None:
        texts += [outputs.trade.frontier.to_markdown(), outputs.trade.points.to_markdown()]
    if outputs.orderings is not None:
        texts.append(outputs.orderings.to_markdown())
    if outputs.beyond is not None and outputs.beyond.crossings is not None:
        texts.append(outputs.beyond.crossings.to_markdown())
    return texts


def _report(directory: Path, outputs: Outputs) -> None:
    write_report(directory, made=Made(outputs.tables, outputs.orderings, outputs.beyond))


def _write_figures(
    directory: Path, suite: str, outputs: Outputs, artifacts: Sequence[Artifact]
) -> None:
    by_class = next((t for t in outputs.tables if t.name == CLASSES), None)
    along = outputs.beyond
    if by_class is not None:
        write_class_figures(directory, by_class, published(suite), artifacts)
    elif outputs.trade is not None:
        write_frontier(directory / FIGURES, outputs.trade.frontier.rows)
    elif along is not None and along.courses:
        write_beyond_figures(directory, along.courses, artifacts)
    else:
        write_figures(directory, outputs.tables, artifacts)
