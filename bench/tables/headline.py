"""The table that a run shows while it goes on, and at its end: few metrics, all methods.

Of one class, methods down and conditions across; of several, the mean over classes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from bench.catalogue.metrics import is_mean
from bench.records.journal import PROTOCOL
from bench.tables.classes import AVERAGE, class_table
from bench.tables.quality import QualityRow, all_methods, image_table, set_table, with_objectives
from bench.tables.scored import ScoredRun
from bench.tables.table import NAN, Block, Table, columns_of, of_protocol

HEADLINE = "headline"
FEWEST_SHOWN = 12  # objects: intervals of fewer are so wide and so uncertain that they mislead here


def headline(run: ScoredRun) -> Table[QualityRow]:
    """Return the metrics that the suite has for it, of the objects that are complete.

    People see intervals from FEWEST_SHOWN objects on; its CSV has them before.
    """
    suite, metrics = run.suite, run.suite.headline
    images = tuple(metric for metric in metrics if is_mean(metric))
    sets = tuple(metric for metric in metrics if not is_mean(metric))
    shown = replace(suite, image_metrics=images, set_metrics=sets)
    of_features = run.features, run.skipped
    with threadpool_limits(1):
        if suite.class_metrics:
            of_classes = replace(shown, class_metrics=metrics)
            made = class_table(run.records, *of_features, of_classes, {}).rows
            rows = [row for row in made if row.class_name == AVERAGE]
        else:
            rows = [
                *image_table("", "", run.records, run.skipped, shown, {}).rows,
                *set_table("", "", run.records, *of_features, shown, {}).rows,
            ]
    objects = len(run.manifest["objects"])
    planned = run.manifest.get("planned", objects)
    title = f"{' and '.join(metrics)}: {objects} of {planned} objects"

    def layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
        if objects < FEWEST_SHOWN:
            yield f"Intervals are shown from {FEWEST_SHOWN} objects on."
            rows = [replace(row, ci_low=NAN, ci_high=NAN) for row in rows]
        yield from all_methods(rows)

    table = Table(HEADLINE, title, columns_of(QualityRow), tuple(rows), layout)
    table = of_protocol(table, run.manifest[PROTOCOL])
    return with_objectives(table, dict(run.manifest.get("objectives", {})))
