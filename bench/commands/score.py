"""`bench score`: further metrics, also of other packages, on images that a finished run has kept.

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

from bench.analysis.digits import decimals
from bench.analysis.distances import FRECHET, KERNEL, FeatureDistances
from bench.analysis.frame import Run, read_run
from bench.analysis.scores import (
    QualityRow,
    RowWithSamples,
    distance_rows,
    image_keys,
    image_rows,
)
from bench.catalogue.loaders import chosen_device
from bench.catalogue.metrics import (
    FURTHER_METRICS,
    column,
    declare_metric,
    extractor_of,
    higher_is_better,
)
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric, metric_ids
from bench.commands.options import DEVICE, Device, RunDirectory, names
from bench.metrics.inception_weights import WeightsUnavailable
from bench.records.artifacts import JobName
from bench.records.features import ImageKey
from bench.records.image_scores import ScoredMetric, digits_of, write_scores
from bench.records.record import COLUMNS, GROUND_TRUTH
from bench.records.stored_artifacts import Artifact
from bench.report.stored import Sources, open_sources
from bench.running.work import reason_of
from bench.tables.further_metrics import metric_table
from bench.tables.table import Table, write_tables
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images

IMAGES = ("method", "condition", "class", "object", "view", "outcome")


def score(directory: Path, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table[QualityRow]]:
    """Write a table for each metric into `directory`/tables as metric_ID.csv and .md; return all.

    Raises BadInput for a folder without a finished run, missing images, and where a metric fails or
    gives no scores.
    """
    return score_run_of(read_run(directory), metrics)


def score_run_of(run: Run, metrics: Sequence[ImageMetric | SetMetric]) -> list[Table[QualityRow]]:
    """Return `score` of a run whose records are written, and write its tables."""
    for metric in metrics:
        if column(metric.id) in COLUMNS:
            raise BadInput(
                f"metric '{metric.id}': the records have a column of that name; rename it"
            )
    sources = open_sources(run.directory, run.manifest, ())
    tables = []
    for metric in metrics:
        if isinstance(metric, SetMetric):
            samples, higher = _set_rows(run, sources, metric), higher_is_better(metric.id)
        else:
            samples, higher = _image_rows(run, sources, metric), metric.higher_is_better
        rows = (sample.row for sample in samples)
        tables.append(metric_table(run, metric.id, metric.version, metric.about, higher, rows))
    write_tables(run.directory, tables)
    return tables


def _image_rows(run: Run, sources: Sources, metric: ImageMetric) -> list[RowWithSamples]:
    """Return the means over images, and keep the scores beside the records of the run.

    Skipped where something optional is not installed.
    """
    try:
        records = scored(run.read_images(IMAGES), sources, metric)
    except WeightsUnavailable as error:
        skipped = {metric.id: f"skipped: {error}"}
        declare_metric(metric.id, metric.higher_is_better, digits_of(np.empty(0)))
        return image_rows(replace(run, skipped=skipped), [metric.id])
    values = records[column(metric.id)].to_numpy(np.float64)
    further = metric.id in FURTHER_METRICS
    better, digits = metric.higher_is_better, decimals(metric.id) if further else digits_of(values)
    declare_metric(metric.id, better, digits)
    kept = ScoredMetric(metric.id, metric.version, metric.about, better, digits)
    write_scores(run.directory, kept, records, values)
    return image_rows(replace(run.with_metric(metric.id, records), skipped={}), [metric.id])


def _set_rows(run: Run, sources: Sources, metric: SetMetric) -> list[RowWithSamples]:
    """Return the rows of Fréchet and kernel distances; skipped where something is not installed."""
    kinds = {metric.id: FRECHET, f"{metric.id}-kernel": KERNEL}
    features = FeatureDistances(KeptFeatures(run.read_images(IMAGES), sources, metric))
    try:
        return [
            row for name, kind in kinds.items() for row in distance_rows(run, name, kind, features)
        ]
    except WeightsUnavailable as error:
        reason = f"skipped: {error}"
        return [row for name in kinds for row in distance_rows(run, name, FRECHET, None, reason)]


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
    """Return the records of existing images with a column for the metric.

    Raises BadInput as `score`.
    """
    ok = records[records["outcome"] == "ok"]
    values = pd.Series(np.nan, index=ok.index)
    # A method that sees no cloud has one artifact for all conditions.
    by_artifact: dict[Artifact | None, Floats] = {}
    # Object by object: a network need not look at the true images again for each method.
    for cell, group in ok.groupby(["class", "object", "method", "condition"], sort=False):
        class_name, obj, method, condition = map(str, cell)  # type: ignore[arg-type]  # pandas: a tuple
        item = JobName(method, condition, class_name, obj)
        artifact = sources.artifacts.get(item)
        if artifact not in by_artifact:
            drawn, truth = kept_images(sources, item), kept_images(sources, item.truth)
            by_artifact[artifact] = checked_scores(metric, truth, drawn)
        values[group.index] = by_artifact[artifact][group["view"].to_numpy()]
    return ok.assign(**{column(metric.id): values})


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
    """Return the values of a function of the metric. Raises BadInput for whatever it raises.

    But for WeightsUnavailable, by which a metric says that it cannot be taken here.
    """
    try:
        with redirect_stdout(sys.stderr):  # stdout is for the tables
            return np.asarray(function(*images), np.float64)
    except WeightsUnavailable:
        raise
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
            help="Metrics, comma-separated: those on request (see 'bench list metrics'), or "
            "of installed packages. Default: all of installed packages."
        ),
    ] = None,
    device: Annotated[Device, typer.Option(help=DEVICE)] = Device.auto,
) -> None:
    """Measure a finished run with further metrics; print their tables."""
    if device is Device.cuda:
        chosen_device(device)  # an absent one is refused before anything is read
    chosen = names(metrics) or metric_ids()
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
    for table in score_run_of(run, further):
        print(table.to_markdown())
