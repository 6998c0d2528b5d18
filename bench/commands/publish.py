"""The end of a run: records, features, tables and figures from what its jobs came to."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.records.artifacts import Artifact
from bench.records.parquet import JobRow, artifacts_of, write_features, write_jobs, write_records
from bench.records.record import GROUND_TRUTH, Record
from bench.report.classes import write_class_figures
from bench.report.families import write_beyond_figures
from bench.report.pareto import write_frontier
from bench.report.robustness import FIGURES, write_figures
from bench.tables.build import (
    Beyond,
    Trade,
    write_beyond,
    write_cost,
    write_orderings,
    write_tables,
    write_trade,
)
from bench.tables.classes import ClassTable
from bench.tables.orderings import OrderingsTable
from bench.tables.published import published
from bench.tables.quality import Table


@dataclass(frozen=True)
class Outputs:
    """The tables of a run.

    trade      quality against cost; None for a suite without
    orderings  SR against pc2pix class by class; None for a suite without
    beyond     methods along families of conditions; None for a suite without
    """

    tables: tuple[Table, ...]
    cost: str
    trade: Trade | None
    orderings: OrderingsTable | None
    beyond: Beyond | None


def write_outputs(
    directory: Path,
    suite: str,
    jobs: Sequence[JobRow],
    records: Callable[[JobRow], Sequence[Record]],
    features: Iterable[str],
    seconds: dict[str, float],
) -> Outputs:
    """Write all that is made from results into a directory with a manifest.

    jobs      all jobs in the order of the plan: ground truths, then items
    records   gives those of a job; asked for once for each item
    features  extractors whose features are in the artifacts
    seconds   gets what each stage took
    """
    artifacts = artifacts_of(directory, jobs)
    with timed("tables", seconds):
        write_records(directory, [job for job in jobs if job.item.method != GROUND_TRUTH], records)
        write_jobs(directory, jobs)
        for metric in features:
            write_features(directory, metric, artifacts)
        outputs = Outputs(
            tables=tuple(write_tables(directory)),
            cost=write_cost(directory),
            trade=write_trade(directory),
            orderings=write_orderings(directory),
            beyond=write_beyond(directory),
        )
    with timed("figures", seconds):
        _write_figures(directory, suite, outputs, artifacts)
    return outputs


def _write_figures(
    directory: Path, suite: str, outputs: Outputs, artifacts: Sequence[Artifact]
) -> None:
    by_class = next((t for t in outputs.tables if isinstance(t, ClassTable)), None)
    along = outputs.beyond
    if by_class is not None:
        write_class_figures(directory, by_class, published(suite), artifacts)
    elif outputs.trade is not None:
        write_frontier(directory / FIGURES, outputs.trade.frontier.places)
    elif along is not None and along.courses:
        write_beyond_figures(directory, along.courses, artifacts)
    else:
        write_figures(directory, outputs.tables, artifacts)


@contextmanager
def timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Within, time goes to `seconds[stage]`, rounded to tenths."""
    start = time.perf_counter()
    yield
    seconds[stage] = round(time.perf_counter() - start, 1)
