"""The values of quality tables: each method under each condition on each class, by each metric.

Pure functions of a scored run. A row has its value over the images that exist, its 95 % interval
over objects, and the value with a blank image in place of each failed one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.cells import CellKey, cells, image_keys
from bench.analysis.comparison import NAN, Estimate
from bench.analysis.distances import FeatureDistances, SetDistance, set_distance
from bench.analysis.intervals import (
    clipped,
    interval_of_means,
    jackknife_interval,
    mean_interval,
    median_interval,
)
from bench.analysis.paper import AVERAGE
from bench.analysis.recognition import true_gallery
from bench.analysis.scored import ScoredRun
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import JUDGE, UNDEFINED, column, extractor_of, is_mean, value_range
from bench.judges import answers as judge
from bench.records.record import GROUND_TRUTH
from data_prep.arrays import Floats

NO_VALUE = "no value"


@dataclass(frozen=True)
class QualityRow:
    """One value of a table. A number that does not exist is NaN.

    value              over the images whose outcome is ok
    ci_low, ci_high    95 % interval over objects
    n_ok, n            images that exist and have a value, images there should be
    paper              the published value, on the paper's data
    failures_as_blank  the value with a blank image in place of each failed one
    note               why there is no value, or the reasons of the failures and how many existing
                       images have no value; for the best reconstruction first which method it is
    debiased           a Fréchet distance without the bias of few objects (`intervals.debiased`)
    trained_on         the objects that a network was trained on; "nothing" for methods that are not
                       trained, empty where it is unknown
    objective          what the weights of a network were trained with; empty for other methods
    """

    suite: str
    method: str
    condition: str
    class_name: str
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n_ok: int
    n: int
    paper: float
    failures_as_blank: float
    note: str
    debiased: float = NAN
    trained_on: str = ""
    objective: str = ""

    @property
    def skipped(self) -> bool:
        """Return whether the metric was not measured."""
        return self.note.startswith("skipped")

    @property
    def only_undefined(self) -> bool:
        """Return whether the note is only about existing images without a value."""
        if self.n_ok == self.n:
            return bool(self.note) and self.method not in CHOSEN
        return f" x {NO_VALUE}: " in self.note and "; " not in self.note

    @property
    def failed(self) -> bool:
        """Return whether images are missing."""
        return self.n_ok < self.n and not self.only_undefined


class RowWithSamples(NamedTuple):
    """A row, and what its interval was made from.

    per_object  float64 [G]: by a metric of images the mean of each object that has a value, by a
                distance of sets the distance without each block of objects
                (`bench.metrics.frechet`)
    """

    row: QualityRow
    per_object: Floats


class CellValue(NamedTuple):
    """The value of a cell by a metric; without one, `note` says why.

    undefined  number of existing images without a value of this metric
    """

    estimate: Estimate = Estimate(NAN, NAN, NAN)
    failures_as_blank: float = NAN
    per_object: Floats = np.empty(0)
    note: str = ""
    undefined: int = 0
    debiased: float = NAN


def image_rows(run: ScoredRun, metrics: Sequence[str]) -> list[RowWithSamples]:
    """Return the means over images by metrics of images, for all cells."""
    rows = []
    names = [column(metric) for metric in metrics if metric not in run.skipped]
    for cell, group in cells(run.records):
        ok = group[group["outcome"] == "ok"]
        means = ok.groupby("object", sort=True)[names].mean()
        blank = _blank_for_failed(cell, group, run.records)
        for metric in metrics:
            if metric in run.skipped:
                value = CellValue(note=run.skipped[metric])
            else:
                columns = (frame[column(metric)].to_numpy() for frame in (ok, blank, means))
                value = _mean_of_images(metric, *columns)
            rows.append(_row(run, cell, metric, group, value))
    return rows


def _mean_of_images(metric: str, scores: Floats, blank: Floats, per_object: Floats) -> CellValue:
    images = len(scores)
    if metric in UNDEFINED:  # by any other metric, no value is an error and shows as such
        scores, blank, per_object = (a[~np.isnan(a)] for a in (scores, blank, per_object))
    interval = clipped(mean_interval(per_object), value_range(metric))
    return CellValue(
        Estimate(_mean(scores), *interval),
        _mean(np.concatenate([scores, blank])),
        per_object,
        undefined=images - len(scores),
    )


def set_rows(run: ScoredRun, metric: str) -> list[RowWithSamples]:
    """Return the distances to the true images of the same views by a set metric, for all cells."""
    extractor = extractor_of(metric)
    features, reason = run.features.get(extractor), run.skipped.get(extractor, "")
    return distance_rows(run, metric, set_distance(metric), features, reason)


def distance_rows(
    run: ScoredRun,
    metric: str,
    distance: SetDistance,
    features: FeatureDistances | None,
    reason: str = "",
) -> list[RowWithSamples]:
    """Return the distances by features, for all cells; `reason` says why there are no features."""
    return [
        _row(
            run,
            cell,
            metric,
            group,
            CellValue(note=reason) if features is None else _distance(cell, features, distance),
        )
        for cell, group in cells(run.records)
    ]


def _distance(cell: CellKey, features: FeatureDistances, distance: SetDistance) -> CellValue:
    _, condition, class_name = cell
    drawn = features.images(*cell)
    if len(drawn) < distance.fewest:
        fewest = "two" if distance.fewest == 2 else distance.fewest
        return CellValue(note=f"fewer than {fewest} images")
    value, leave_one_out = distance.between(features, cell, drawn)
    true = features.images(GROUND_TRUTH, "", class_name)
    wanted = set() if drawn == true else set(true) - set(drawn)  # sets of all images take memory
    missing = wanted & set(features.images(FLOOR, condition, class_name)) if wanted else wanted
    with_blank = value
    if missing:
        with_blank, _ = distance.between(features, cell, sorted([*drawn, *missing]))
    return CellValue(
        Estimate(value, *distance.interval(value, leave_one_out)),
        with_blank,
        leave_one_out,
        debiased=distance.debiased(value, leave_one_out),
    )


def recognition_rows(run: ScoredRun) -> list[QualityRow]:
    """Return what the judge recognises in each method's images: the view, and which object it is.

    Angles are medians over images of the error in degrees, with intervals by a bootstrap over
    objects; retrieval is a share of images.
    """
    answers, reason = run.features.get(JUDGE), run.skipped.get(JUDGE, "")
    galleries: dict[str, judge.Gallery] = {}
    rows = []
    for cell, group in cells(run.records):
        ok, blank = group[group["outcome"] == "ok"], _blank_for_failed(cell, group, run.records)
        _, condition, class_name = cell
        if answers is not None and class_name not in galleries:
            galleries = {class_name: true_gallery(answers, class_name)}  # of one class at a time
        for metric in run.suite.control_metrics:
            if answers is None:
                value = CellValue(note=reason)
            elif metric == "retrieval" and (why := judge.why_no_retrieval(galleries[class_name])):
                value = CellValue(note=why)
            elif ok.empty:
                value = CellValue(note="no images")
            else:
                drawn, of_blank = (
                    _per_image(metric, key, images, answers, galleries[class_name])
                    for key, images in ((cell, ok), ((FLOOR, condition, class_name), blank))
                )
                value = _recognised(metric, drawn, of_blank, ok["object"].to_numpy())
            rows.append(_row(run, cell, metric, group, value).row)
    return rows


def _per_image(
    metric: str,
    cell: CellKey,
    records: pd.DataFrame,
    answers: FeatureDistances,
    gallery: judge.Gallery,
) -> Floats:
    """Return the error or the hit of each record's image, in their order."""
    if records.empty:
        return np.empty(0)
    images = image_keys(records)
    answered = answers.of(*cell, images)
    if metric == "azimuth-error-deg":
        return judge.azimuth_error_deg(answered, records["azimuth_deg"].to_numpy())
    if metric == "elevation-error-deg":
        return judge.elevation_error_deg(answered, records["elevation_deg"].to_numpy())
    return judge.found(gallery, answered, images)


def _recognised(metric: str, values: Floats, blank: Floats, objects: NDArray[Any]) -> CellValue:
    with_blank = np.concatenate([values, blank])
    if metric == "retrieval":
        per_object = np.asarray(pd.Series(values).groupby(objects).mean(), np.float64)
        interval = clipped(mean_interval(per_object), value_range(metric))
        return CellValue(Estimate(_mean(values), *interval), _mean(with_blank))
    estimate = Estimate(float(np.median(values)), *median_interval(values, objects))
    return CellValue(estimate, float(np.median(with_blank)))


def class_rows(run: ScoredRun, metrics: Sequence[str]) -> list[QualityRow]:
    """Return metric by metric the rows of each class, and last the means over classes."""
    rows = []
    for metric in metrics:
        rows += with_averages(
            image_rows(run, [metric]) if is_mean(metric) else set_rows(run, metric)
        )
    return rows


def with_averages(of_metric: Sequence[RowWithSamples]) -> list[QualityRow]:
    """Return the rows of a metric class by class, and last the means over classes."""
    by_class: dict[str, list[QualityRow]] = {}
    by_cell: dict[tuple[str, str], list[RowWithSamples]] = {}
    for sampled in of_metric:
        row = sampled.row
        by_class.setdefault(row.class_name, []).append(row)
        by_cell.setdefault((row.method, row.condition), []).append(sampled)
    return [
        *(row for of_class in by_class.values() for row in of_class),
        *map(_average, by_cell.values()),
    ]


def _average(of_cell: Sequence[RowWithSamples]) -> QualityRow:
    """Return the mean over the classes that have a value, each counting alike."""
    rows = [sampled.row for sampled in of_cell]
    first = rows[0]
    valued = [sampled for sampled in of_cell if math.isfinite(sampled.row.value)]
    missing = [row.class_name for row in rows if not math.isfinite(row.value)]
    value, debiased = NAN, NAN
    if valued:
        value = float(np.mean([sampled.row.value for sampled in valued]))
        debiased = float(np.mean([sampled.row.debiased for sampled in valued]))
    samples = [sampled.per_object for sampled in valued]
    mean = is_mean(first.metric)
    interval = interval_of_means(samples) if mean else jackknife_interval(value, samples)
    low, high = clipped(interval, value_range(first.metric))
    note = f"without {', '.join(missing)}" if missing else ""
    return QualityRow(
        suite=first.suite,
        method=first.method,
        condition=first.condition,
        class_name=AVERAGE,
        metric=first.metric,
        value=value,
        ci_low=low,
        ci_high=high,
        n_ok=sum(row.n_ok for row in rows),
        n=sum(row.n for row in rows),
        paper=NAN,
        failures_as_blank=float(np.mean([row.failures_as_blank for row in rows])),
        note=note if valued else first.note,
        debiased=debiased,
    )


def _blank_for_failed(cell: CellKey, group: pd.DataFrame, records: pd.DataFrame) -> pd.DataFrame:
    """Return the records of the blank images in place of a cell's failed ones, where they exist."""
    failed = group[group["outcome"] == "failed"]
    if failed.empty:
        return records.iloc[:0]
    # Under the same condition, though a blank image does not depend on it: its record may be
    # missing or failed under another.
    blank = records[
        (records["method"] == FLOOR)
        & (records["condition"] == cell[1])
        & (records["outcome"] == "ok")
        & (records["class"] == cell[2])
    ]
    return blank.merge(failed[["object", "view"]], on=["object", "view"])


def _row(
    run: ScoredRun, cell: CellKey, metric: str, group: pd.DataFrame, value: CellValue
) -> RowWithSamples:
    """Return a row with the counts and the reasons for failures that its records give."""
    outcomes = group["outcome"].tolist()
    pairs = zip(outcomes, group["reason"].tolist(), strict=True)
    reasons = Counter(reason for outcome, reason in pairs if outcome == "failed")
    counts = outcomes.count("ok"), len(outcomes)
    return quality_row(run.suite.id, cell, metric, counts, reasons, value)


def quality_row(
    suite: str,
    cell: CellKey,
    metric: str,
    images: tuple[int, int],
    reasons: Counter[str],
    value: CellValue,
) -> RowWithSamples:
    """Return the row of a value. `images` are those that exist and that should."""
    message = [f"{count} x {reason}" for reason, count in reasons.most_common()]
    if value.undefined:
        message.append(f"{value.undefined} x {NO_VALUE}: {UNDEFINED[metric]}")
    drawn, planned = images
    row = QualityRow(
        suite,
        *cell,
        metric,
        *value.estimate,
        n_ok=drawn - value.undefined,
        n=planned,
        paper=NAN,
        failures_as_blank=value.failures_as_blank,
        note=value.note or "; ".join(message),
        debiased=value.debiased,
    )
    return RowWithSamples(row, value.per_object)


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else NAN
