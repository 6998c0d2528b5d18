"""A run whose images were scored, as everything that is made of it reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.comparison import Comparison, compare
from bench.analysis.distances import FeatureDistances
from bench.analysis.recognition import read_class_head, with_confidence
from bench.catalogue.claims import ENTERED
from bench.catalogue.metrics import (
    IMAGE_METRICS,
    LEARNED_METRICS,
    RECOGNITION_METRICS,
    column,
    find_extractor,
)
from bench.catalogue.suites import LATENT, SPEED, STABILITY, Suite
from bench.catalogue.truth import stored_suite
from bench.judges import VIEWS_WEIGHTS
from bench.records.features import Features
from bench.records.parquet import read_features, read_records
from bench.records.run_folder import read_finished
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256

VIEWS = "fd-views"


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """A run's scored records in the order of the tables, its features, and what it compared.

    features  by extractor
    skipped   reasons of the extractors without features, and of the metrics without values
    """

    directory: Path
    suite: Suite
    manifest: dict[str, Any]
    records: pd.DataFrame
    features: dict[str, FeatureDistances]
    skipped: dict[str, str]
    _compared: dict[tuple[str, ...], list[Comparison]] = field(
        default_factory=dict, repr=False, init=False
    )

    def measured(self, metrics: Sequence[str]) -> list[str]:
        """Return the metrics of images and of sets among these that the run has."""
        available = {*self.features, *IMAGE_METRICS.keys() - self.skipped.keys()}
        return [metric for metric in metrics if metric in available]

    def compared(self, metrics: Sequence[str]) -> list[Comparison]:
        """Return the methods on the same objects by these metrics; computed once."""
        if tuple(metrics) not in self._compared:
            claimed = self.manifest.get(ENTERED, ())
            self._compared[tuple(metrics)] = compare(self.records, self.features, metrics, claimed)
        return self._compared[tuple(metrics)]


def read_scored(directory: Path, older: bool = False) -> ScoredRun:
    """Return a finished run whose images were scored. Raises BadInput for anything else.

    A run of an `older` version of the protocol is allowed where that is true.
    """
    run = scored_run(directory, read_finished(directory, older))
    if not run.manifest["objects"]:
        raise BadInput(f"{directory}: a run without objects; start it again with its command")
    return run


def scored_run(directory: Path, manifest: dict[str, Any]) -> ScoredRun:
    """Return a run with this manifest, whose records and features are written.

    Raises BadInput where they cannot be read, for a manifest that does not describe them, and for a
    suite that makes its tables itself.
    """
    if manifest.get("suite") in [suite.id for suite in (LATENT, STABILITY, SPEED)]:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} writes its tables itself; they are in "
            f"{directory / 'tables'}"
        )
    suite = stored_suite(manifest)
    if missing := [name for name in ("methods", "conditions", "objects") if name not in manifest]:
        raise BadInput(
            f"{directory}: its manifest has no {', '.join(missing)}; start the run again with its "
            "command"
        )
    stored = {metric: read_features(directory, metric) for metric in suite.extractors}
    features = {metric: values for metric, values in stored.items() if values is not None}
    return score(directory, suite, manifest, read_records(directory), features)


def score(
    directory: Path,
    suite: Suite,
    manifest: dict[str, Any],
    records: pd.DataFrame,
    features: Mapping[str, Features],
) -> ScoredRun:
    """Return a run with these records, and features by extractor."""
    records = in_order(records, manifest, ("condition", "method"))
    distances = {metric: FeatureDistances(values) for metric, values in features.items()}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        if metric not in distances:
            skipped.setdefault(metric, "skipped: no features in this run")
    scored = records[records["outcome"] == "ok"]
    for metric, extractor in LEARNED_METRICS.items():
        if len(scored) and scored[column(metric)].isna().all():
            skipped[metric] = skipped.get(extractor, f"skipped: {extractor} is not measured")
    for metric in set(suite.class_metrics) & RECOGNITION_METRICS.keys():
        if reason := _why_unrecognised(manifest, distances, records):
            skipped[metric] = f"skipped: {reason}"
        else:
            head = read_class_head(VIEWS_WEIGHTS)
            records = with_confidence(records, distances[VIEWS], head)
    return ScoredRun(directory, suite, manifest, records, distances, skipped)


def _why_unrecognised(
    manifest: Mapping[str, Any], features: Mapping[str, Features], records: pd.DataFrame
) -> str:
    """Return why the bundled classifier cannot judge the features of a run; empty if it can."""
    if VIEWS not in features:
        return f"no features of {VIEWS} in this run"
    bundled = f"{find_extractor(VIEWS).version} {file_sha256(VIEWS_WEIGHTS)}"
    identity = manifest.get("feature_identity", {}).get(VIEWS, "")
    if identity.removesuffix(" cuda") != bundled:  # the same weights, on a GPU
        return f"the features are not of the bundled weights of {VIEWS}; start the run again"
    known = read_class_head(VIEWS_WEIGHTS).classes
    unknown = [name for name in dict.fromkeys(records["class"]) if name not in known]
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
