"""A run whose images were scored, as everything that is made of it reads it."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.comparison import Comparison, compare
from bench.analysis.distances import FeatureDistances
from bench.analysis.object_sums import ObjectSums, sum_records
from bench.analysis.recognition import confidences, read_class_head
from bench.catalogue.images import ENTERED
from bench.catalogue.metrics import (
    IMAGE_METRICS,
    RECOGNITION_METRICS,
    declared_metric,
    find_extractor,
    is_mean,
)
from bench.catalogue.suites import PROCEDURES, Suite, stored_suite
from bench.judges import VIEWS_WEIGHTS
from bench.records.features import Features
from bench.records.parquet import read_features, read_records
from bench.records.record import COLUMNS
from bench.records.run_folder import read_finished
from data_prep.clouds.far_points import FAR_OFF
from data_prep.datasets.dataset import listed
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256

VIEWS = "fd-views"


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """A run's scores, summed by object, its features, and what it compared.

    features  by extractor
    skipped   reasons of the extractors without features, and of the metrics without values
    """

    directory: Path
    suite: Suite
    manifest: dict[str, Any]
    sums: ObjectSums
    features: dict[str, FeatureDistances]
    skipped: dict[str, str]
    _compared: dict[tuple[tuple[str, ...], frozenset[str]], list[Comparison]] = field(
        default_factory=dict, repr=False, init=False
    )

    @property
    def not_measured(self) -> list[str]:
        """Return a line for each metric that a run has no values of for want of its weights."""
        reasons: Mapping[str, str] = self.manifest.get("skipped_metrics", {})
        return [
            f"{metric}: not measured, {reason.removeprefix('skipped: ').removeprefix('weights; ')}"
            for metric, reason in reasons.items()
        ]

    @property
    def far_off(self) -> list[str]:
        """Return a line on the objects whose scale is set by what is far from the rest of them."""
        records = read_records(self.directory, ("class", "object", "notes"))
        far = records[records["notes"].str.contains(FAR_OFF, regex=False)]
        names = (far["class"] + "/" + far["object"]).unique().tolist()
        if not names:
            return []
        return [f"{len(names)} objects are small in their images, {FAR_OFF}: {listed(names)}"]

    @property
    def headline(self) -> list[str]:
        """Return the metrics of images of the headline that the run has: those that judge."""
        return self.measured([metric for metric in self.suite.headline if is_mean(metric)])

    def measured(self, metrics: Sequence[str]) -> list[str]:
        """Return the metrics of images and of sets among these that the run has."""
        available = {*self.features} | ({*IMAGE_METRICS} - self.skipped.keys())
        # Scores that were kept beside the records:
        available.update(m for m in self.sums.metrics if declared_metric(m))
        return [metric for metric in metrics if metric in available]

    def compared(
        self,
        metrics: Sequence[str],
        methods: Iterable[str] | None = None,
        among: Mapping[tuple[str, str], Container[str]] | None = None,
    ) -> list[Comparison]:
        """Return methods on the same objects by these metrics, by default all; computed once.

        `among` has the objects that take part, by condition and class; by default all.
        """
        key = tuple(metrics), frozenset(self.manifest["methods"] if methods is None else methods)
        entered = self.manifest.get(ENTERED, ())
        if among is not None:
            return compare(self.sums, self.features, metrics, key[1], entered, among)
        if key not in self._compared:
            self._compared[key] = compare(self.sums, self.features, metrics, key[1], entered)
        return self._compared[key]

    def read_images(self, columns: Sequence[str] = COLUMNS, **only: str) -> pd.DataFrame:
        """Return the records of single images, methods and conditions in the manifest's order.

        `only` is as in `bench.records.parquet.read_records`. Memory grows with the images.
        """
        records = read_records(self.directory, columns, **only)
        return in_order(records, self.manifest, ("condition", "method"))


def read_scored(directory: Path, older: bool = False) -> ScoredRun:
    """Return a finished run whose images were scored. Raises BadInput for anything else.

    A run of an `older` version of the protocol is allowed where that is true.
    """
    manifest = read_finished(directory, older)
    if manifest.get("objects") == []:
        raise BadInput(f"{directory}: a run without objects; start it again with its command")
    return scored_run(directory, manifest)


def scored_run(directory: Path, manifest: dict[str, Any]) -> ScoredRun:
    """Return a run with this manifest, whose records and features are written.

    Raises BadInput where they cannot be read, for a manifest that does not describe them, and for a
    suite that makes its tables itself.
    """
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
    features = {metric: values for metric, values in stored.items() if values is not None}
    return score(directory, suite, manifest, sum_records(directory, manifest), features)


def score(
    directory: Path,
    suite: Suite,
    manifest: dict[str, Any],
    sums: ObjectSums,
    features: Mapping[str, Features],
) -> ScoredRun:
    """Return a run with these sums, and features by extractor."""
    distances = {metric: FeatureDistances(values) for metric, values in features.items()}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        if metric not in distances:
            skipped.setdefault(metric, "skipped: no features in this run")
    skipped |= sums.unmeasured(skipped)
    for metric in {*suite.class_metrics} & {*RECOGNITION_METRICS}:
        if reason := _why_unrecognised(manifest, distances, sums):
            skipped[metric] = f"skipped: {reason}"
        else:
            head = read_class_head(VIEWS_WEIGHTS)
            sums.add_metric(metric, confidences(sums.cells, distances[VIEWS], head))
    return ScoredRun(directory, suite, manifest, sums, distances, skipped)


def _why_unrecognised(
    manifest: Mapping[str, Any], features: Mapping[str, Features], sums: ObjectSums
) -> str:
    """Return why the bundled classifier cannot judge the features of a run; empty if it can."""
    if VIEWS not in features:
        return f"no features of {VIEWS} in this run"
    bundled = f"{find_extractor(VIEWS).version} {file_sha256(VIEWS_WEIGHTS)}"
    identity = manifest.get("feature_identity", {}).get(VIEWS, "")
    if identity.removesuffix(" cuda") != bundled:  # the same weights, on a GPU
        return f"the features are not of the bundled weights of {VIEWS}; start the run again"
    known = read_class_head(VIEWS_WEIGHTS).classes
    unknown = [name for name in sums.objects_of if name not in known]
    if unknown:
        return f"the classifier of {VIEWS} does not know {', '.join(unknown)}"
    return ""


def in_order(records: pd.DataFrame, manifest: Mapping[str, Any], by: Sequence[str]) -> pd.DataFrame:
    """Return the records sorted by some columns, methods and conditions as in the manifest.

    The sort is stable.
    """
    ranks = {
        column: {name: i for i, name in enumerate(manifest[plural])}
        for column, plural in (("method", "methods"), ("condition", "conditions"))
    }
    return records.sort_values(
        list(by),
        key=lambda values: values.map(ranks[str(values.name)]) if values.name in ranks else values,
        kind="stable",
        ignore_index=True,
    )
