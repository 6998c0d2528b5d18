"""`bench score`: further metrics, also of other packages, on images that a finished run has kept.

The scores are kept beside those of the run, which stays as it is, with tables and golden values.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from bench.analysis.further_metrics import further_rows
from bench.analysis.scored_run import Run, read_run
from bench.catalogue.loaders import chosen_device
from bench.catalogue.metrics import (
    FURTHER_METRICS,
    column,
    extractor_of,
)
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric
from bench.commands.options import DEVICE, Device, RunDirectory, names
from bench.records.record import COLUMNS
from bench.records.run_folder import locked_run
from bench.records.store import open_store
from bench.tables.build import write_tails
from bench.tables.quality import metric_table
from bench.tables.table import Table, write_tables
from data_prep.failures import BadInput
from data_prep.plugins import announced


def score(directory: Path, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
    """Write a table for each metric into `directory`/tables as metric_ID.csv and .md; return all.

    The last is the table of tails, where the run was scored by its metrics, now or before. Raises
    BadInput for a folder without a finished run, missing images, and where a metric fails or gives
    no scores.
    """
    return _score(read_run(directory), metrics)


def _score(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
    """Return `score` of a run that has been read."""
    with locked_run(run.directory):
        tables, tails = score_run_of(run, metrics), write_tails(run)
    return tables if tails is None else [*tables, tails]


def score_run_of(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table]:
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


def score_run(
    directory: RunDirectory,
    metrics: Annotated[
        str | None,
        typer.Option(
            help="Metrics, comma-separated: those on request (see 'bench list metrics'), or "
            "of installed packages. Default: all of installed packages."
        ),
    ] = None,
    device: Annotated[Device, typer.Option(help=DEVICE)] = Device.auto,
) -> None:
    """Measure a finished run with further metrics; print their tables."""
    if device is Device.cuda:
        chosen_device(device)  # an absent one is refused before anything is read
    chosen = names(metrics) or announced("metric")
    if not chosen:
        raise BadInput(
            f"no installed package adds a metric; give --metrics {','.join(FURTHER_METRICS)}, "
            "or see docs/extending.md"
        )
    run = read_run(directory)
    for line in run.not_measured:
        if line.partition(":")[0] in map(extractor_of, chosen):
            raise BadInput(f"{directory}: {line}; start the run again so, which takes it")
    further = [find_metric(metric_id, str(device)) for metric_id in chosen]
    for table in _score(run, further):
        print(table.to_markdown())
