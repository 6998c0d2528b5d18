"""The table that a run shows while it goes on, and at its end: few metrics, all methods.

With one class methods are down and conditions across; with several it is the mean over classes.
Failed images are scored as blank ones, so that all methods have values of the same objects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from bench.analysis.comparison import NAN
from bench.analysis.frame import Run
from bench.analysis.paper import AVERAGE
from bench.analysis.scores import (
    QualityRow,
    image_rows,
    set_rows,
    with_averages,
)
from bench.catalogue.metrics import is_mean
from bench.records.run_folder import PROTOCOL
from bench.tables.grid import Block
from bench.tables.quality import all_methods, annotated, with_chosen_rows
from bench.tables.table import Table, columns_of, of_protocol

HEADLINE = "headline"
_LEGEND = (
    "All methods: value [95 % interval over objects], failed images scored as blank ones; n_ok/n "
    "images."
)
FEWEST_SHOWN = 12  # objects: intervals of fewer are so wide and so uncertain that they mislead here


def headline(run: Run, metrics: Sequence[str] | None = None) -> Table[QualityRow]:
    """Return the headline metrics of the suite over the objects that are complete.

    `metrics` are those that the run has while it goes on, by default all. People see intervals from
    FEWEST_SHOWN objects on; its CSV has them before.
    """
    suite, manifest = run.suite, run.manifest
    wanted = suite.headline if metrics is None else metrics
    with threadpool_limits(1):
        rows = image_rows(run, [metric for metric in wanted if is_mean(metric)], True)
        for metric in wanted:
            rows += [] if is_mean(metric) else set_rows(run, metric)
    chosen = [row for row, _ in rows]
    if suite.table("classes"):
        of_metrics = ([r for r in rows if r.row.metric == metric] for metric in suite.headline)
        with threadpool_limits(1):
            averages = [row for of_metric in of_metrics for row in with_averages(of_metric)]
        chosen = [row for row in averages if row.class_name == AVERAGE]
    objects = len(manifest["objects"])
    planned = manifest.get("planned", objects)
    title = f"{' and '.join(suite.headline)}: {objects} of {planned} objects"

    def layout(rows: Sequence[QualityRow]) -> Iterator[Block]:
        if objects < FEWEST_SHOWN:
            yield f"Intervals are shown from {FEWEST_SHOWN} objects on."
            rows = [replace(row, ci_low=NAN, ci_high=NAN) for row in rows]
        elif objects < planned:
            yield (
                "Intervals hold for a number of objects that was fixed beforehand, not for a run "
                "that is ended when its values please."
            )
        # The value itself is the one with blank images.
        yield from all_methods([replace(row, failures_as_blank=NAN) for row in rows], _LEGEND)

    every = with_chosen_rows(annotated(chosen, manifest, {}))
    table = Table.of_rows(HEADLINE, title, columns_of(QualityRow), every, layout)
    return of_protocol(table, suite, manifest[PROTOCOL])
