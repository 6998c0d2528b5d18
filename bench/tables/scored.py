"""A run whose images were scored, as the tables read it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.comparison import Comparison, compare
from bench.analysis.distances import FeatureDistances
from bench.analysis.recognition import read_class_head
from bench.catalogue.lookup import find
from bench.catalogue.metrics import (
    IMAGE_METRICS,
    LEARNED_METRICS,
    RECOGNITION_METRICS,
    column,
    find_extractor,
)
from bench.catalogue.suites import LATENT, SPEED, STABILITY, SUITES, Suite
from bench.judges import VIEWS_WEIGHTS
from bench.records.features import Features
from bench.records.journal import read_finished
from bench.records.parquet import read_features, read_records
from bench.tables.classes import with_confidence
from bench.tables.table import TABLES
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256

VIEWS = "fd-views"


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """A run whose images were scored: its records in the order of the tables and its features,
    read once, with the comparisons and distances that have been computed.

    features  by extractor
    skipped   reasons of the extractors without features, and of the metrics without values
    """

    directory: Path
    suite: Suite
    manifest: dict[str, Any]
    records: pd.DataFrame
    features: dict[str, FeatureDistances]
    skipped: dict[str, str]
    _compared: dict[tuple[str, ...], list[Comparison]] = field(default_factory=dict, repr=False)

    def measured(self, metrics: Sequence[str]) -> list[str]:
        """Those of these metrics of images and of sets that the run has."""
        there = {*self.features, *IMAGE_METRICS.keys() - self.skipped.keys()}
        return [metric for metric in metrics if metric in there]

    def compared(self, metrics: Sequence[str]) -> list[Comparison]:
        """The methods on the same objects, by these metrics."""
        if tuple(metrics) not in self._compared:
            self._compared[tuple(metrics)] = compare(self.records, self.features, metrics)
        return self._compared[tuple(metrics)]


def _suite(directory: Path, manifest: Mapping[str, Any]) -> Suite:
    """The suite of a run. Raises BadInput for one that makes its tables itself."""
    made_by_the_run = [suite.id for suite in (LATENT, STABILITY, SPEED)]
    if manifest.get("suite") in made_by_the_run:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} writes its tables itself; they are in "
            f"{directory / TABLES}"
        )
    return find(str(manifest.get("suite")), SUITES, "suite")


def read_scored(directory: Path) -> ScoredRun:
    """A finished run whose images were scored. Raises BadInput for anything else."""
    return scored_run(directory, read_finished(directory))


def scored_run(directory: Path, manifest: dict[str, Any]) -> ScoredRun:
    """A run with this manifest, whose records and features are written.

    Raises BadInput where they cannot be read, for a manifest that does not describe them, and for a
    suite that makes its tables itself.
    """
    suite = _suite(directory, manifest)
    if lacking := [name for name in ("methods", "conditions", "objects") if name not in manifest]:
        raise BadInput(
            f"{directory}: its manifest has no {', '.join(lacking)}; start the run again with its "
            "command"
        )
    found = {metric: read_features(directory, metric) for metric in suite.extractors}
    there = {metric: features for metric, features in found.items() if features is not None}
    return score(directory, suite, manifest, read_records(directory), there)


def score(
    directory: Path,
    suite: Suite,
    manifest: dict[str, Any],
    records: pd.DataFrame,
    found: Mapping[str, Features],
) -> ScoredRun:
    """A run with these records, and features by extractor."""
    records = in_order(records, manifest, ("condition", "method"))
    features = {metric: FeatureDistances(of) for metric, of in found.items()}
    skipped: dict[str, str] = dict(manifest.get("skipped_metrics", {}))
    for metric in suite.extractors:
        if metric not in features:
            skipped.setdefault(metric, "skipped: no features in this run")
    scored = records[records["outcome"] == "ok"]
    for metric, extractor in LEARNED_METRICS.items():
        if len(scored) and scored[column(metric)].isna().all():
            skipped[metric] = skipped.get(extractor, f"skipped: {extractor} is not measured")
    for metric in set(suite.class_metrics) & RECOGNITION_METRICS.keys():
        if reason := _why_unrecognised(manifest, features, records):
            skipped[metric] = f"skipped: {reason}"
        else:
            head = read_class_head(VIEWS_WEIGHTS)
            records = with_confidence(records, features[VIEWS], head)
    return ScoredRun(directory, suite, manifest, records, features, skipped)


def _why_unrecognised(
    manifest: Mapping[str, Any], features: Mapping[str, Features], records: pd.DataFrame
) -> str:
    """Why the bundled classifier cannot be asked about the features of a run; empty if it can."""
    if VIEWS not in features:
        return f"no features of {VIEWS} in this run"
    bundled = f"{find_extractor(VIEWS).version} {file_sha256(VIEWS_WEIGHTS)}"
    if manifest.get("feature_identity", {}).get(VIEWS) != bundled:
        return f"the features are not of the bundled weights of {VIEWS}; start the run again"
    known = read_class_head(VIEWS_WEIGHTS).classes
    strange = [name for name in dict.fromkeys(records["class"]) if name not in known]
    if strange:
        return f"the classifier of {VIEWS} does not know {', '.join(strange)}"
    return ""


def in_order(records: pd.DataFrame, manifest: Mapping[str, Any], by: Sequence[str]) -> pd.DataFrame:
    """Records by some columns, methods and conditions in the order of the manifest; stable."""
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
