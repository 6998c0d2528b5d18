"""The tables of further metrics that a run was scored by (`bench score`)."""

from __future__ import annotations

from collections.abc import Iterable

from bench.analysis.frame import Run
from bench.analysis.scores import QualityRow, image_rows
from bench.catalogue.suites import TableSpec
from bench.records.frames import read_scores, scored_metrics
from bench.tables.quality import quality_table
from bench.tables.table import Table, of_truth
from data_prep.failures import BadInput
from data_prep.progress import log


def metric_table(
    run: Run,
    metric_id: str,
    version: int,
    about: str,
    higher: bool,
    rows: Iterable[QualityRow],
) -> Table[QualityRow]:
    """Return the table of a further metric."""
    better = "higher" if higher else "lower"
    title = f"{metric_id}, version {version}: {about} ({better} is better)"
    spec = TableSpec("images", f"metric_{metric_id}", title)
    return of_truth(quality_table(spec, rows), run.suite)


def further_tables(run: Run) -> list[Table[QualityRow]]:
    """Return the tables of all image metrics that a run was scored by.

    Scores of records that have changed since are left out, and a line on stderr names them.
    """
    tables = []
    for metric_id in scored_metrics(run.directory):
        try:
            metric, images = read_scores(run.directory, metric_id)
        except BadInput as error:
            log(str(error))
            continue
        rows = (sample.row for sample in image_rows(run.with_scores(metric, images), [metric_id]))
        about = metric.version, metric.about, metric.higher_is_better
        tables.append(metric_table(run, metric_id, *about, rows))
    return tables
