"""`bench score`: metrics of other packages, taken of the images that a finished run has kept.

The run itself stays as it is: its records, its tables and what they are compared with. A score is a
pure function of images, so there is nothing to keep but the tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bench.catalogue.metrics import column
from bench.catalogue.plugins import ImageMetric, find_metric, metric_ids
from bench.commands.options import RunDirectory, names
from bench.records.artifacts import Item
from bench.report.stored import Sources, open_sources
from bench.running.work import reason_of
from bench.tables.quality import Row, image_rows, quality_table
from bench.tables.scored import read_scored
from bench.tables.table import Table, write_tables
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images


def score(directory: Path, metric_ids: Sequence[str]) -> list[Table[Row]]:
    """A table for each metric, written into `directory`/tables as metric_ID.csv and .md.

    Raises BadInput for what is no finished run, an unknown metric, images that are not there any
    more, and where a metric fails or gives no scores.
    """
    metrics = [find_metric(metric_id) for metric_id in metric_ids]
    run = read_scored(directory)
    for metric in metrics:
        if column(metric.id) in run.records.columns:
            raise BadInput(
                f"metric '{metric.id}': the records have a column of that name; rename it"
            )
    sources = open_sources(directory, run.manifest, ())
    made = []
    for metric in metrics:
        records = scored(run.records, sources, metric)
        rows = (one.row for one in image_rows([metric.id], records, run.suite, {}))
        better = "higher" if metric.higher_is_better else "lower"
        title = f"{metric.id}, version {metric.version}: {metric.about} ({better} is better)"
        made.append(
            quality_table(f"metric_{metric.id}", title, rows, "", False, digits=lambda metric: 3)
        )
    write_tables(directory, made)
    return made


def scored(records: pd.DataFrame, sources: Sources, metric: ImageMetric) -> pd.DataFrame:
    """The records with a column for the metric, NaN where there is no image.

    Raises BadInput as `score`.
    """
    values = pd.Series(np.nan, index=records.index)
    ok = records[records["outcome"] == "ok"]
    for cell, group in ok.groupby(["method", "condition", "class", "object"], sort=False):
        item = Item(*map(str, cell))  # type: ignore[arg-type]  # pandas: of several columns a tuple
        drawn, truth = sources.images(item), sources.images(item.truth)
        if drawn is None or truth is None:
            raise BadInput(
                f"{' '.join(item)}: its pictures are not there any more; start the run again with "
                "its command"
            )
        views = group["view"].to_numpy()
        values[group.index] = checked_scores(metric, truth, drawn)[views]
    return records.assign(**{column(metric.id): values})


def checked_scores(
    metric: ImageMetric, truth: UInt8Images, drawn: UInt8Images
) -> NDArray[np.float64]:
    """Scores [V] of images [V, H, W, 3]. Raises BadInput where the metric has none."""
    try:
        found = np.asarray(metric.score(truth, drawn), np.float64)
    except Exception as error:  # whatever a stranger's function raises
        raise BadInput(f"metric '{metric.id}': {reason_of(error)}; fix that package") from error
    if found.shape != (len(drawn),) or not np.isfinite(found).all():
        raise BadInput(
            f"metric '{metric.id}': gives {found.shape} values, {np.isfinite(found).sum()} finite, "
            f"for {len(drawn)} pictures; fix that package"
        )
    return found


def score_run(
    directory: RunDirectory,
    metrics: Annotated[
        str | None,
        typer.Option(help="Metrics, comma-separated. Default: all of installed packages."),
    ] = None,
) -> None:
    """Measure a finished run with metrics of other packages; print their tables."""
    chosen = names(metrics) or metric_ids()
    if not chosen:
        raise BadInput("no installed package adds a metric; see docs/adding-a-metric.md")
    for made in score(directory, chosen):
        print(made.to_markdown())
