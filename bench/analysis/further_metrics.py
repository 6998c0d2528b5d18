"""Runs with scores of further image metrics, which `bench score` has kept beside the records."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from bench.analysis.scored import ScoredRun
from bench.catalogue.metrics import FURTHER_METRICS, column, declare_metric
from bench.catalogue.plugins import metric_ids
from bench.records.image_scores import ScoredMetric, read_scores, scored_ids
from data_prep.failures import BadInput
from data_prep.plugins import EXTRACTORS, entry_point_names


def with_further(run: ScoredRun, wanted: Iterable[str]) -> ScoredRun:
    """Return the run with sums of each wanted metric that it does not have.

    Metrics that are neither on request nor of an installed package, nor scored, are left to the
    caller, who knows what the run has. Raises BadInput for a metric that the run was not scored by,
    naming the command, and for a distance of sets, which has no value for an image.
    """
    for metric_id in wanted:
        if metric_id in run.sums.metrics or metric_id in run.features:
            continue
        if metric_id not in (*FURTHER_METRICS, *metric_ids(), *scored_ids(run.directory)):
            continue
        if metric_id in entry_point_names(EXTRACTORS):
            raise BadInput(
                f"{metric_id}: is a distance of sets of images; it stands in the table of "
                f"'bench score {run.directory} --metrics {metric_id}' alone"
            )
        run = with_scores(run, *read_scores(run.directory, metric_id))
    return run


def with_scores(run: ScoredRun, metric: ScoredMetric, images: pd.DataFrame) -> ScoredRun:
    """Return the run with sums of a metric, which has a `value` for each existing image."""
    declare_metric(metric.id, metric.higher_is_better, metric.decimals)
    if metric.id not in run.sums.metrics:
        run.sums.add_metric(metric.id, [images.rename(columns={"value": column(metric.id)})])
    return run
