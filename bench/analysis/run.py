"""A run as everything that is made of it reads it: a frame with one row a job, and features.

A job is one method on one cloud: it has all its images, or none. So the sums of the scores of its
images are all that means over objects need, and a failed job takes the sums of the blank images of
the same condition and object. A *set of images* is those of one method under one condition on one
class. Memory grows with the number of jobs, not of images.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.sets import FeatureDistances, ImageSet, confidences, read_class_head
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import (
    FURTHER_METRICS,
    IMAGE_METRICS,
    METRICS,
    RECOGNITION_METRICS,
    column,
    declare_metric,
    declared_metric,
    find_extractor,
    is_mean,
)
from bench.catalogue.suites import PROCEDURES, Suite, stored_suite
from bench.judges import VIEWS_WEIGHTS
from bench.records.folder import read_finished
from bench.records.frames import (
    read_features,
    read_job_sums,
    read_records,
    read_scores,
    scored_metrics,
)
from bench.records.job import COLUMNS, JOB
from bench.records.store import ScoredMetric
from data_prep.arrays import Floats
from data_prep.clouds.far_points import FAR_OFF
from data_prep.datasets.dataset import first_names
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.plugins import EXTRACTORS, announced, entry_point_names

VIEWS = "fd-views"


def _sums_of_metric(images: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return for each job the sum of a column over its images, and how many have a value.

    The two are the columns NAME_sum and NAME_count; NaN is no value. Values are added in the order
    of the images, as in `job_frame`, so that sums are equal to the last digit.
    """
    values = images[name].to_numpy(np.float64)
    jobs = images.assign(job=images.groupby(JOB, sort=False, observed=True).ngroup())
    known, names = ~np.isnan(values), jobs.drop_duplicates("job")[JOB]
    at, size = jobs["job"].to_numpy()[known], len(names)
    return names.assign(
        **{f"{name}_sum": np.bincount(at, values[known], size)},
        **{f"{name}_count": np.bincount(at, minlength=size)},
    )


def _planned_jobs(
    methods: Sequence[str], conditions: Sequence[str], objects: Iterable[str]
) -> pd.DataFrame:
    """Return a row for each method, condition and object ("class/name"), the latter sorted."""
    pairs = sorted((name.partition("/")[0], name.partition("/")[2]) for name in objects)
    return (
        pd.DataFrame({"method": list(methods)})
        .merge(pd.DataFrame({"condition": list(conditions)}), how="cross")
        .merge(pd.DataFrame(pairs, columns=["class", "object"]), how="cross")
    )


def full_frame(jobs: pd.DataFrame, manifest: Mapping[str, Any]) -> pd.DataFrame:
    """Return a row for each job of the manifest, with 0 images for one that `jobs` does not have.

    Raises BadInput for a job that the manifest does not have.
    """
    every = _planned_jobs(manifest["methods"], manifest["conditions"], manifest["objects"])
    full = every.merge(jobs, how="left", on=JOB)
    if int(full["planned"].notna().sum()) != len(jobs):
        unknown = jobs.merge(every, how="left", on=JOB, indicator="side")
        name = " ".join(unknown.loc[unknown["side"] != "both", JOB].iloc[0])
        raise BadInput(
            f"records of {name}, which the manifest does not have; start the run again with its "
            "command"
        )
    return _without_nan(full)


def _without_nan(jobs: pd.DataFrame) -> pd.DataFrame:
    """Return the frame with "" and 0 in place of NaN, and with numbers of images as integers."""
    texts = {name: jobs[name].fillna("") for name in ("reason", "notes")}
    numbers = {
        name: jobs[name].fillna(0).astype(np.float64 if name.endswith("_sum") else np.int64)
        for name in map(str, jobs)
        if name.endswith(("_sum", "_count")) or name in ("planned", "drawn")
    }
    return jobs.assign(**texts, **numbers)


@dataclass(frozen=True, eq=False)
class Run:
    """A run whose images were scored: its jobs, its features, and what it compared.

    jobs      a row for each job, with the columns of `bench.records.frames.job_frame`, sorted by
              method and condition as in the manifest, then by class and object; a job that was not
              run has 0 planned images
    features  features of the images by extractor, the network that they are taken with
    skipped   why an extractor has no features, or a metric no values, by their names
    """

    directory: Path
    suite: Suite
    manifest: dict[str, Any]
    jobs: pd.DataFrame
    features: dict[str, FeatureDistances] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    # Comparisons that were made already, by metrics and methods: see `comparison.compared`.
    comparisons: dict[tuple[tuple[str, ...], frozenset[str]], pd.DataFrame] = field(
        default_factory=dict, repr=False, init=False
    )

    @cached_property
    def _rows(self) -> dict[ImageSet, slice]:
        """Return where the jobs of each set of images stand in the frame, one below the other."""
        indices: Any = self.jobs.groupby(JOB[:3], sort=False).indices
        return {image_set: slice(rows[0], rows[-1] + 1) for image_set, rows in indices.items()}

    @cached_property
    def _columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the jobs as arrays, which are found faster than in a frame."""
        return {str(name): values.to_numpy() for name, values in self.jobs.items()}

    @cached_property
    def image_sets(self) -> list[ImageSet]:
        """Return the sets of images that have been run, by condition, method and class."""
        conditions, methods, classes = (
            self.jobs[name].unique().tolist() for name in ("condition", "method", "class")
        )
        image_sets = []
        for condition, method, class_name in product(conditions, methods, classes):
            image_set = (method, condition, class_name)
            _, planned = self.images(image_set)
            if planned:
                image_sets.append(image_set)
        return image_sets

    @cached_property
    def reasons(self) -> dict[ImageSet, Counter[str]]:
        """Return how many images failed for each reason, by set of images."""
        reasons: dict[ImageSet, Counter[str]] = {}
        failed = self.jobs[self.jobs["drawn"] < self.jobs["planned"]]
        image_sets = zip(*(failed[name] for name in JOB[:3]), strict=True)
        missing = failed["planned"] - failed["drawn"]
        for image_set, reason, count in zip(image_sets, failed["reason"], missing, strict=True):
            reasons.setdefault(image_set, Counter())[reason] += count
        return reasons

    def has(self, metric: str) -> bool:
        """Return whether the jobs have the sums of the scores by a metric of images."""
        return f"{column(metric)}_sum" in self.jobs

    @cached_property
    def objects_of(self) -> dict[str, int]:
        """Return by class how many objects have been run; classes without any are left out."""
        run = self.jobs.loc[self.jobs["planned"] > 0, ["class", "object"]].drop_duplicates()
        return {str(name): int(count) for name, count in run.groupby("class").size().items()}

    def objects(self, image_set: ImageSet) -> NDArray[Any]:
        """Return the names [G] of the objects of a set of images, sorted."""
        return self._column(image_set, "object")

    def numbers(self, image_set: ImageSet) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return how many images of each object [G] exist, and how many should exist."""
        return self._column(image_set, "drawn"), self._column(image_set, "planned")

    def images(self, image_set: ImageSet) -> tuple[int, int]:
        """Return how many images of a set exist, and how many should exist."""
        drawn, planned = self.numbers(image_set)
        return int(drawn.sum()), int(planned.sum())

    def scored(self, image_set: ImageSet, metric: str) -> int:
        """Return how many images of a set have a value by a metric of images."""
        return int(self._column(image_set, f"{column(metric)}_count").sum())

    def _sums(
        self, image_set: ImageSet, metric: str, blanks: bool = False
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return for each object [G] the sum of its images' scores, and how many scores there are.

        With `blanks` they are the scores of the blank images that stand in for failed ones, and of
        no others. The columns of times (`TIMES`) may be given in place of a metric.
        """
        drawn, planned = self.numbers(image_set)
        if blanks:
            image_set = (FLOOR, *image_set[1:])
        if image_set not in self._rows:
            return np.zeros(len(drawn)), np.zeros(len(drawn), np.int64)
        sums, counts = (
            self._column(image_set, f"{column(metric)}_{name}") for name in ("sum", "count")
        )
        if not blanks:
            return sums, counts
        failed = drawn < planned
        return np.where(failed, sums, 0.0), np.where(failed, counts, 0)

    def per_object(self, image_set: ImageSet, metric: str, blanks: bool = False) -> Floats:
        """Return the mean score of each object [G] over its images; NaN where none has a score.

        With `blanks` a failed image has the score of the blank image of the same object.
        """
        sums, counts = self._sums(image_set, metric)
        if blanks:
            of_blank, number = self._sums(image_set, metric, blanks=True)
            sums, counts = sums + of_blank, counts + number
        return np.divide(sums, counts, out=np.full(len(sums), np.nan), where=counts > 0)

    def _column(self, image_set: ImageSet, name: str) -> NDArray[Any]:
        return self._columns[name][self._rows[image_set]]

    @property
    def not_measured(self) -> list[str]:
        """Return a line for each metric that was not measured because its weights are absent."""
        reasons: Mapping[str, str] = self.manifest.get("skipped_metrics", {})
        return [
            f"{metric}: not measured, {reason.removeprefix('skipped: ').removeprefix('weights; ')}"
            for metric, reason in reasons.items()
        ]

    @property
    def far_off(self) -> list[str]:
        """Return a line on the objects whose scale is set by what is far from the rest of them."""
        far = self.jobs[self.jobs["notes"].str.contains(FAR_OFF, regex=False)]
        names = sorted((far["class"] + "/" + far["object"]).unique())
        if not names:
            return []
        return [f"{len(names)} objects are small in their images, {FAR_OFF}: {first_names(names)}"]

    @property
    def headline(self) -> list[str]:
        """Return the metrics of images that decide which method is better, as far as it has them.

        They are those of the suite's headline.
        """
        return self.measured([metric for metric in self.suite.headline if is_mean(metric)])

    def measured(self, metrics: Sequence[str]) -> list[str]:
        """Return the metrics of images and of sets among these that the run has."""
        available = {*self.features} | ({*IMAGE_METRICS} - self.skipped.keys())
        # A metric of `bench score` is declared, and its sums are columns of the jobs.
        return [m for m in metrics if m in available or (declared_metric(m) and self.has(m))]

    def read_images(self, columns: Sequence[str] = COLUMNS, **only: str) -> pd.DataFrame:
        """Return the records of single images, methods and conditions in the manifest's order.

        `only` is as in `bench.records.frames.read_records`. Memory grows with the images.
        """
        records = read_records(self.directory, columns, **only)
        return in_order(records, self.manifest, ("condition", "method"))

    def with_metric(self, metric: str, images: pd.DataFrame) -> Run:
        """Return the run with the sums of a further metric, a column of the frame of `images`."""
        jobs = self.jobs.merge(_sums_of_metric(images, column(metric)), how="left", on=JOB)
        return replace(self, jobs=_without_nan(jobs))

    def with_scores(self, metric: ScoredMetric, images: pd.DataFrame) -> Run:
        """Return the run with a metric that `bench score` has kept, a `value` for each image."""
        declare_metric(metric.id, metric.higher_is_better, metric.decimals)
        if self.has(metric.id):
            return self
        return self.with_metric(metric.id, images.rename(columns={"value": column(metric.id)}))

    def with_further(self, wanted: Iterable[str]) -> Run:
        """Return the run with each wanted metric that `bench score` has kept of it.

        A name that is no metric of `bench score`, of an installed package or of the run is passed
        over: the caller knows what the run has, and refuses it. Raises BadInput for a metric that
        the run was not scored by, naming the command, and for a distance between sets of images,
        which has no value for a single image.
        """
        run = self
        for metric_id in wanted:
            if run.has(metric_id) or metric_id in run.features:
                continue
            known = (*FURTHER_METRICS, *announced("metric"), *scored_metrics(run.directory))
            if metric_id not in known:
                continue
            if metric_id in entry_point_names(EXTRACTORS):
                raise BadInput(
                    f"{metric_id}: is a distance of sets of images; it stands in the table of "
                    f"'bench score {run.directory} --metrics {metric_id}' alone"
                )
            run = run.with_scores(*read_scores(run.directory, metric_id))
        return run


def read_run(directory: Path, manifest: dict[str, Any] | None = None) -> Run:
    """Read a run whose images were scored: a finished one, or one that goes on with its manifest.

    The records are read part by part. Raises BadInput where the folder has no such run, where its
    records cannot be read or are not those that the manifest describes, and for a suite that makes
    its tables itself.
    """
    if manifest is None:
        manifest = read_finished(directory)
        if manifest.get("objects") == []:
            raise BadInput(f"{directory}: a run without objects; start it again with its command")
    if manifest.get("suite") in [suite.id for suite in PROCEDURES]:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} writes its tables itself; they are in "
            f"{directory / 'tables'}"
        )
    try:
        suite = stored_suite(manifest)
    except BadInput as error:
        raise BadInput(f"{directory}: {error}") from error
    stored = {metric: read_features(directory, metric) for metric in suite.extractors}
    jobs = full_frame(read_job_sums(directory), manifest)
    _refuse_missing(directory, jobs)
    features = {m: FeatureDistances(values) for m, values in stored.items() if values is not None}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        if metric not in features:
            skipped.setdefault(metric, "skipped: no features in this run")
    run = Run(directory, suite, manifest, jobs, features, skipped | unmeasured(jobs, skipped))
    for metric in {*suite.class_metrics} & {*RECOGNITION_METRICS}:
        if reason := _why_unrecognised(run):
            run.skipped[metric] = f"skipped: {reason}"
        else:
            answers = confidences(
                run.image_sets, run.features[VIEWS], read_class_head(VIEWS_WEIGHTS)
            )
            run = run.with_metric(metric, pd.concat(answers))
    return run


def _refuse_missing(directory: Path, jobs: pd.DataFrame) -> None:
    """Raise BadInput where the store lacks jobs: means would be over fewer objects."""
    missing = jobs.loc[jobs["planned"] == 0, JOB]
    if len(missing):
        raise BadInput(
            f"{directory}: its store lists no job of {' '.join(missing.iloc[0])} "
            f"({len(missing)} of {len(jobs)} are missing), which the manifest has; start the run "
            "again with its command"
        )


def unmeasured(jobs: pd.DataFrame, reasons: Mapping[str, str]) -> dict[str, str]:
    """Return why metrics that need a network have no value at all, though images exist.

    reasons  by extractor (the network whose features a metric takes), why the run does not have it
    """
    if not jobs["drawn"].any():
        return {}
    without_values = {}
    for metric in IMAGE_METRICS:
        extractor = METRICS[metric].extractor
        if not extractor or f"{column(metric)}_sum" not in jobs:
            continue
        if not jobs[f"{column(metric)}_count"].any():
            reason = reasons.get(extractor, f"skipped: {extractor} is not measured")
            without_values[metric] = reason
    return without_values


def _why_unrecognised(run: Run) -> str:
    """Return why the bundled classifier cannot judge a run's features; an empty text if it can."""
    if VIEWS not in run.features:
        return f"no features of {VIEWS} in this run"
    bundled = f"{find_extractor(VIEWS).version} {file_sha256(VIEWS_WEIGHTS)}"
    identity = run.manifest.get("feature_identity", {}).get(VIEWS, "")
    if identity.removesuffix(" cuda") != bundled:  # the same weights, on a GPU
        return f"the features are not of the bundled weights of {VIEWS}; start the run again"
    known = read_class_head(VIEWS_WEIGHTS).classes
    unknown = [name for name in run.objects_of if name not in known]
    if unknown:
        return f"the classifier of {VIEWS} does not know {', '.join(unknown)}"
    return ""


def in_order(records: pd.DataFrame, manifest: Mapping[str, Any], by: Sequence[str]) -> pd.DataFrame:
    """Return the records sorted by some columns, methods and conditions as in the manifest.

    The sort is stable.
    """
    ranks = {
        "method": {name: rank for rank, name in enumerate(manifest["methods"])},
        "condition": {name: rank for rank, name in enumerate(manifest["conditions"])},
    }

    def sort_key(values: pd.Series[Any]) -> pd.Series[Any]:
        name = str(values.name)
        return values.map(ranks[name]) if name in ranks else values

    return records.sort_values(list(by), key=sort_key, kind="stable", ignore_index=True)
