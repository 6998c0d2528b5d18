"""The metrics of `bench score`: they are taken of the images that a finished run has kept.

A metric may be of another package: where it raises an error, or returns what are no scores, that is
refused with the name of the metric.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from functools import cache, lru_cache
from itertools import product

import numpy as np
import pandas as pd

from bench.analysis.digits import decimals
from bench.analysis.run import Run
from bench.analysis.sets import FeatureDistances
from bench.analysis.values import distance_rows, image_rows
from bench.catalogue.metrics import FURTHER_METRICS, declare_metric
from bench.catalogue.plugins import ImageMetric, SetMetric
from bench.metrics.inception_weights import WeightsUnavailable
from bench.records.frames import ImageKey, read_scores
from bench.records.job import GROUND_TRUTH, JobName, unpack
from bench.records.store import ScoredMetric, Store
from bench.running.work import reason_of
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images

_READ = 8  # jobs whose images are held in memory, about 1 MB each


def further_rows(
    run: Run, metrics: Sequence[ImageMetric | SetMetric], store: Store
) -> list[pd.DataFrame]:
    """Return the values of each metric, and write the scores of images into the store of the run.

    Raises BadInput for missing images, and where a metric fails or gives no scores.
    """
    images = _KeptImages(store)
    rows = []
    for metric in metrics:
        if isinstance(metric, SetMetric):
            rows.append(_set_rows(run, images, metric))
        else:
            rows.append(_image_rows(run, images, metric, store))
    return rows


class _KeptImages:
    """The images that the complete run in a store has kept, by the names of its jobs."""

    def __init__(self, store: Store) -> None:
        self.jobs = [row for row in store.listed() if row.has_images]  # object by object
        self._keys = {row.name: row.key for row in self.jobs}
        self._read = lru_cache(_READ)(lambda key: unpack(store.array(key)))

    def of(self, name: JobName) -> UInt8Images:
        """Return the images [V, H, W, 3] of a job. Raises BadInput where they are gone."""
        if name not in self._keys:
            raise BadInput(
                f"{' '.join(name)}: its images are gone; start the run again with its command"
            )
        return self._read(self._keys[name])


def _image_rows(run: Run, images: _KeptImages, metric: ImageMetric, store: Store) -> pd.DataFrame:
    """Return the means over objects, and write the scores into the store of the run.

    The rows are marked as skipped where a package that the metric needs is not installed.
    """
    scores: dict[str, Floats] = {}
    try:
        # Object by object: a network need not look at the true images again for each method.
        for key, name, _ in images.jobs:
            if name.method != GROUND_TRUTH and key not in scores:
                scores[key] = checked_scores(metric, images.of(name.truth), images.of(name))
    except WeightsUnavailable as error:
        skipped = {metric.id: f"skipped: {error}"}
        declare_metric(metric.id, metric.higher_is_better, digits_of(np.empty(0)))
        return image_rows(replace(run, skipped=skipped), [metric.id])
    values = np.concatenate([*scores.values()]) if scores else np.empty(0)
    digits = decimals(metric.id) if metric.id in FURTHER_METRICS else digits_of(values)
    better = metric.higher_is_better
    store.put_scores(ScoredMetric(metric.id, metric.version, metric.about, better, digits), scores)
    run = replace(run, skipped={}).with_scores(*read_scores(run.directory, metric.id))
    return image_rows(run, [metric.id])


def digits_of(values: Floats) -> int:
    """Return how many digits after the point to print: three of the standard deviation, 0 to 6."""
    spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
    return 3 if spread == 0 else int(np.clip(2 - np.floor(np.log10(spread)), 0, 6))


def _set_rows(run: Run, images: _KeptImages, metric: SetMetric) -> pd.DataFrame:
    """Return the rows of the Fréchet and of the kernel distance by the features of a metric.

    They are marked as skipped where a package that the metric needs is not installed.
    """
    frechet, kernel = metric.id, f"{metric.id}-kernel"
    features = FeatureDistances(_KeptFeatures(images, metric, run.manifest["views"]))
    try:
        rows = [
            distance_rows(run, frechet, kernel=False, features=features),
            distance_rows(run, kernel, kernel=True, features=features),
        ]
    except WeightsUnavailable as error:
        reason = f"skipped: {error}"
        rows = [distance_rows(run, name, False, None, reason) for name in (frechet, kernel)]
    return pd.concat(rows, ignore_index=True)


class _KeptFeatures:
    """The features of kept images, as `bench.records.frames.Features`.

    Those of true images are computed once and stay in memory, the others are computed when asked.
    """

    def __init__(self, images: _KeptImages, metric: SetMetric, views: int) -> None:
        self._images, self._metric, self._views = images, metric, views
        self._true = cache(self._computed)

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return the images of a method at a condition, sorted; none where there is no job."""
        image_set = (method, condition, class_name)
        objects = sorted(
            job.name.object_id for job in self._images.jobs if job.name[:3] == image_set
        )
        return list(product(objects, range(self._views)))

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> Floats:
        """Return the features of `images`, [n, d]. Raises BadInput where the metric has none."""
        features = self._true if method == GROUND_TRUTH else self._computed
        of_objects: dict[str, Floats] = {}
        for obj, _ in images:
            if obj not in of_objects:
                of_objects[obj] = features(JobName(method, condition, class_name, obj))
        return np.stack([of_objects[obj][view] for obj, view in images])

    def _computed(self, name: JobName) -> Floats:
        return checked_features(self._metric, self._images.of(name))


def _call(
    metric: ImageMetric | SetMetric, function: Callable[..., object], *images: UInt8Images
) -> Floats:
    """Return the values of a function of the metric.

    Raises BadInput for whatever the function raises, but for WeightsUnavailable, by which a metric
    says that a package it needs is not installed.
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
    if values.ndim != 2 or not values.shape[1] or not _finite_for(values, images):
        raise BadInput(
            f"metric '{metric.id}': gives features {list(values.shape)}, "
            f"{np.isfinite(values).sum()} finite, for {len(images)} images; fix that package"
        )
    return values


def checked_scores(metric: ImageMetric, truth: UInt8Images, drawn: UInt8Images) -> Floats:
    """Return scores [V] of images [V, H, W, 3]. Raises BadInput where the metric has none."""
    values = _call(metric, metric.score, truth, drawn)
    if values.ndim != 1 or not _finite_for(values, drawn):
        like_truth = ""
        if np.array_equal(truth, drawn):
            like_truth = "; they are identical to the true ones"
        raise BadInput(
            f"metric '{metric.id}': gives {values.shape} values, "
            f"{np.isfinite(values).sum()} finite, for {len(drawn)} images{like_truth}; fix that "
            f"package ('bench test {metric.id}')"
        )
    return values


def _finite_for(values: Floats, images: UInt8Images) -> bool:
    """Return whether there is a finite value, or a row of such, for each image."""
    return len(values) == len(images) and bool(np.isfinite(values).all())
