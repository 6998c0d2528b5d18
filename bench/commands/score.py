"""`bench score`: metrics on request, and of other packages, on the images that a run has kept.

The run itself stays as it is: its records, its tables and its golden values.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from bench.analysis.cells import image_keys
from bench.analysis.distances import FRECHET, KERNEL, FeatureDistances, set_distance
from bench.analysis.scored import ScoredRun, read_scored
from bench.analysis.scores import QualityRow, RowWithSamples, distance_rows, image_rows
from bench.catalogue.methods import known_method
from bench.catalogue.metrics import (
    ON_REQUEST,
    WeightsSource,
    column,
    extractor_of,
    higher_is_better,
)
from bench.catalogue.on_request import find_scorer, weights_of
from bench.catalogue.plugins import ImageMetric, SetMetric, metric_ids
from bench.catalogue.suite_types import TableSpec
from bench.commands.options import RunDirectory, names
from bench.metrics.inception_weights import WeightsUnavailable
from bench.records.artifacts import JobName
from bench.records.features import ImageKey
from bench.records.record import GROUND_TRUTH
from bench.report.stored import Sources, open_sources
from bench.running.work import reason_of
from bench.tables.quality import quality_table
from bench.tables.table import Table, write_tables
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images


def score(
    directory: Path,
    metrics: Sequence[ImageMetric | SetMetric],
    weights: Callable[[str], WeightsSource | None] = weights_of,
) -> list[Table[QualityRow]]:
    """Write a table for each metric into `directory`/tables as metric_ID.csv and .md; return all.

    A metric whose weights are not installed is skipped: its rows say why. `weights` returns the
    source of a metric's weights, None for a metric without such a source.

    Raises BadInput for a folder without a finished run, missing images, and where a metric fails or
    gives no scores.
    """
    run = read_scored(directory)
    for metric in metrics:
        if column(metric.id) in run.records.columns:
            raise BadInput(
                f"metric '{metric.id}': the records have a column of that name; rename it"
            )
    sources = open_sources(directory, run.manifest, ())
    features = dict(run.features)
    tables = []
    for metric in metrics:
        reason = _why_skipped(weights(metric.id))
        if isinstance(metric, SetMetric):
            samples = _set_rows(run, sources, metric, features, reason)
            higher = metric.id in ON_REQUEST and higher_is_better(metric.id)
        else:
            records = run.records if reason else scored(run.records, sources, metric)
            skipped = {metric.id: reason} if reason else {}
            samples = image_rows(replace(run, records=records, skipped=skipped), [metric.id])
            higher = metric.higher_is_better
        better = "higher" if higher else "lower"
        title = f"{metric.id}, version {metric.version}: {metric.about} ({better} is better)"
        rows = (sample.row for sample in samples)
        spec = TableSpec("images", f"metric_{metric.id}", title)
        tables.append(quality_table(spec, rows))
    write_tables(directory, tables)
    return tables


def _why_skipped(source: WeightsSource | None) -> str:
    """Return why weights are not available, with the remedy; empty where they are."""
    try:
        if source is not None:
            source.weights(None)
    except WeightsUnavailable as error:
        return f"skipped: weights; {error}"
    return ""


def _set_rows(
    run: ScoredRun,
    sources: Sources,
    metric: SetMetric,
    features: dict[str, FeatureDistances],
    reason: str,
) -> list[RowWithSamples]:
    """Return the rows of a set metric of ours, else of Fréchet and kernel distances.

    `features` by extractor are those of the run; an extractor that it lacks is added, so that
    metrics share the features of the true images.
    """
    if metric.id in ON_REQUEST:
        kinds = {metric.id: set_distance(metric.id)}
    else:
        kinds = {metric.id: FRECHET, f"{metric.id}-kernel": KERNEL}
    extractor = extractor_of(metric.id)
    if extractor not in features and not reason:
        features[extractor] = FeatureDistances(KeptFeatures(run.records, sources, metric))
    return [
        row
        for name, kind in kinds.items()
        for row in distance_rows(run, name, kind, features.get(extractor), reason)
    ]


class KeptFeatures:
    """The features of the images that a run has kept, as `bench.records.features.Features`.

    They are computed on demand, cell by cell; those of the true images are kept.
    """

    def __init__(self, records: pd.DataFrame, sources: Sources, metric: SetMetric) -> None:
        ok = records[records["outcome"] == "ok"]
        cells = ok.groupby(["method", "condition", "class"], sort=False)
        self._images = {cell: sorted(image_keys(group)) for cell, group in cells}
        self._sources, self._metric = sources, metric
        self._true: dict[JobName, Floats] = {}
        for name in records["class"].unique():
            of_class = (images for cell, images in self._images.items() if cell[2] == name)
            self._images[GROUND_TRUTH, "", name] = sorted(set().union(*of_class))

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return the images of a cell, sorted; none for an unknown cell."""
        return self._images.get((method, condition, class_name), [])

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> Floats:
        """Return the features of `images`, [n, d]. Raises BadInput as `score`."""
        of_objects = {}
        for obj in dict.fromkeys(obj for obj, _ in images):
            name = JobName(method, condition, class_name, obj)
            features = self._true.get(name)
            if features is None:
                features = checked_features(self._metric, kept_images(self._sources, name))
            if method == GROUND_TRUTH:
                self._true[name] = features
            of_objects[obj] = features
        return np.stack([of_objects[obj][view] for obj, view in images])


def scored(records: pd.DataFrame, sources: Sources, metric: ImageMetric) -> pd.DataFrame:
    """Return the records with a column for the metric, NaN for a failed image.

    Raises BadInput as `score`.
    """
    values = pd.Series(np.nan, index=records.index)
    ok = records[records["outcome"] == "ok"]
    blind: dict[tuple[str, str, str], Floats] = {}  # images that are the same at all conditions
    # Object by object: a network need not look at the true images again for each method.
    for cell, group in ok.groupby(["class", "object", "method", "condition"], sort=False):
        class_name, obj, name, condition = map(str, cell)  # type: ignore[arg-type]  # pandas: a tuple
        item = JobName(name, condition, class_name, obj)
        method, same = known_method(name), (name, class_name, obj)
        scores = blind.get(same)
        if scores is None:
            drawn, truth = kept_images(sources, item), kept_images(sources, item.truth)
            scores = checked_scores(metric, truth, drawn)
        if method is not None and not method.sees_cloud:
            blind[same] = scores
        values[group.index] = scores[group["view"].to_numpy()]
    return records.assign(**{column(metric.id): values})


def kept_images(sources: Sources, name: JobName) -> UInt8Images:
    """Return the images [V, H, W, 3] of a job. Raises BadInput where they are gone."""
    images = sources.images(name)
    if images is None:
        raise BadInput(
            f"{' '.join(name)}: its images are gone; start the run again with its command"
        )
    return images


def _call(
    metric: ImageMetric | SetMetric, function: Callable[..., object], *images: UInt8Images
) -> Floats:
    """Return the values of a function of the metric. Raises BadInput for whatever it raises."""
    try:
        with redirect_stdout(sys.stderr):  # stdout is for the tables
            return np.asarray(function(*images), np.float64)
    except (Exception, SystemExit) as error:  # whatever a stranger's function raises
        raise BadInput(f"metric '{metric.id}': {reason_of(error)}; fix that package") from error


def checked_features(metric: SetMetric, images: UInt8Images) -> Floats:
    """Return features [V, d] of images [V, H, W, 3]. Raises BadInput where the metric has none."""
    values = _call(metric, metric.features, images)
    shaped = values.ndim == 2 and len(values) == len(images) and values.shape[1] > 0
    if not shaped or not np.isfinite(values).all():
        raise BadInput(
            f"metric '{metric.id}': gives features {list(values.shape)}, "
            f"{np.isfinite(values).sum()} finite, for {len(images)} images; fix that package"
        )
    return values


def checked_scores(metric: ImageMetric, truth: UInt8Images, drawn: UInt8Images) -> Floats:
    """Return scores [V] of images [V, H, W, 3]. Raises BadInput where the metric has none."""
    values = _call(metric, metric.score, truth, drawn)
    if values.shape != (len(drawn),) or not np.isfinite(values).all():
        like_truth = "; they are identical to the true ones" * np.array_equal(truth, drawn)
        raise BadInput(
            f"metric '{metric.id}': gives {values.shape} values, "
            f"{np.isfinite(values).sum()} finite, for {len(drawn)} images{like_truth}; fix that "
            f"package ('bench test {metric.id}')"
        )
    return values


def score_run(
    directory: RunDirectory,
    metrics: Annotated[
        str | None,
        typer.Option(
            help="Metrics, comma-separated: of installed packages (default: all), and "
            f"{', '.join(ON_REQUEST)}."
        ),
    ] = None,
) -> None:
    """Measure a finished run with metrics on request or of other packages; print their tables."""
    chosen = names(metrics) or metric_ids()
    if not chosen:
        raise BadInput(
            f"no installed package adds a metric; give --metrics: {', '.join(ON_REQUEST)}"
        )
    for table in score(directory, [find_scorer(metric_id) for metric_id in chosen]):
        print(table.to_markdown())
