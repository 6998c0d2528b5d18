"""The table that a run shows while it goes on, and at its end: few metrics, all methods.

With one class methods are down and conditions across; with several it is the mean over classes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from bench.analysis.comparison import NAN
from bench.analysis.paper import AVERAGE
from bench.analysis.scored import ScoredRun
from bench.analysis.scores import QualityRow, class_rows, image_rows, set_rows
from bench.catalogue.metrics import is_mean
from bench.records.run_folder import PROTOCOL
from bench.tables.grid import Block
from bench.tables.quality import all_methods, annotated, with_chosen_rows
from bench.tables.table import Table, columns_of, of_protocol

HEADLINE = "headline"
FEWEST_SHOWN = 12  # objects: intervals of fewer are so wide and so uncertain that they mislead here


def headline(run: ScoredRun) -> Table[QualityRow]:
    """Return the headline metrics of the suite over the objects that are complete.

    People see intervals from FEWEST_SHOWN objects on; its CSV has them before.
    """
    metrics = run.suite.headline
    with threadpool_limits(1):
        if run.suite.table("classes"):
            rows = [row for row in class_rows(run, metrics) if row.class_name == AVERAGE]
        else:
            sampled = image_rows(run, [metric for metric in metrics if is_mean(metric)])
            for metric in metrics:
                sampled += [] if is_mean(metric) else set_rows(run, metric)
            rows = [row for row, _ in sampled]
    objects = len(run.manifest["objects"])
    planned = run.manifest.get("planned", objects)
    title = f"{' and '.join(metrics)}: {objects} of {planned} objects"

    def layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
        if objects < FEWEST_SHOWN:
            yield f"Intervals are shown from {FEWEST_SHOWN} objects on."
            rows = [replace(row, ci_low=NAN, ci_high=NAN) for row in rows]
        yield from all_methods(rows)

    shown = with_chosen_rows(annotated(rows, run, {}))
    table = Table(HEADLINE, title, columns_of(QualityRow), shown, layout)
    return of_protocol(table, run.suite, run.manifest[PROTOCOL])
