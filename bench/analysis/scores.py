"""The values of quality tables: each method under each condition on each class, by each metric.

Pure functions of a scored run. A row has its value over the images that exist, its 95 % interval
over objects, and the value with a blank image in place of each failed one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from bench.analysis.comparison import NAN, Estimate
from bench.analysis.digits import decimals
from bench.analysis.distances import CellKey, FeatureDistances, SetDistance, set_distance
from bench.analysis.frame import Run
from bench.analysis.intervals import (
    clipped,
    interval_of_means,
    jackknife_interval,
    mean_interval,
    median_interval,
)
from bench.analysis.paper import AVERAGE
from bench.analysis.recognition import true_gallery
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import JUDGE, extractor_of, is_mean, metric_facts, value_range
from bench.judges import answers as judge
from bench.records.frames import ImageKey, read_records
from bench.records.record import GROUND_TRUTH, JOB
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
    def measured_method(self) -> str:
        """Return the method whose images they are, in the row of a chosen one too."""
        if self.method in CHOSEN and not self.skipped:
            return self.note.partition("; ")[0]
        return self.method

    @property
    def decimals(self) -> int:
        """Return the digits after the point that the value is printed with."""
        return decimals(self.metric, self.measured_method)

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


def image_rows(run: Run, metrics: Sequence[str], blanks: bool = False) -> list[RowWithSamples]:
    """Return the means over images by metrics of images, for all cells.

    With `blanks` values and intervals are those with a blank image in place of each failed one.
    """
    return [
        quality_row(
            run,
            cell,
            metric,
            CellValue(note=run.skipped[metric])
            if metric in run.skipped
            else _mean_of_images(run, cell, metric, blanks),
        )
        for cell in run.cells
        for metric in metrics
    ]


def _mean_of_images(run: Run, cell: CellKey, metric: str, blanks: bool) -> CellValue:
    drawn, _ = run.images(cell)
    total, count = (values.sum().item() for values in run.sums(cell, metric))
    of_blank, number = (values.sum().item() for values in run.sums(cell, metric, blanks=True))
    missing = drawn - count
    if missing and not metric_facts(metric).undefined:  # an error, and shows as such
        total = of_blank = NAN
    per_object = run.per_object(cell, metric, blanks)
    per_object = per_object[~np.isnan(per_object)]
    as_blank = _ratio(total + of_blank, count + number)
    value = as_blank if blanks else _ratio(total, count)
    return CellValue(
        Estimate(value, *clipped(mean_interval(per_object), value_range(metric))),
        as_blank,
        per_object,
        undefined=missing if metric_facts(metric).undefined else 0,
    )


def set_rows(run: Run, metric: str) -> list[RowWithSamples]:
    """Return the distances to the true images of the same views by a set metric, for all cells."""
    extractor = extractor_of(metric)
    features, reason = run.features.get(extractor), run.skipped.get(extractor, "")
    return distance_rows(run, metric, set_distance(metric), features, reason)


def distance_rows(
    run: Run,
    metric: str,
    distance: SetDistance,
    features: FeatureDistances | None,
    reason: str = "",
) -> list[RowWithSamples]:
    """Return the distances by features, for all cells; `reason` says why there are no features."""
    return [
        quality_row(
            run,
            cell,
            metric,
            CellValue(note=reason) if features is None else _distance(cell, features, distance),
        )
        for cell in run.cells
    ]


def _distance(cell: CellKey, features: FeatureDistances, distance: SetDistance) -> CellValue:
    _, condition, class_name = cell
    drawn = features.images(*cell)
    if len(drawn) < 2:
        return CellValue(note="fewer than two images")
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


def recognition_rows(run: Run) -> list[QualityRow]:
    """Return what the judge recognises in each method's images: the view, and which object it is.

    Angles are medians over images of the error in degrees, with intervals by a bootstrap over
    objects; retrieval is a share of images.
    """
    answers, reason = run.features.get(JUDGE), run.skipped.get(JUDGE, "")
    galleries: dict[str, judge.Gallery] = {}
    rows = []
    for cell in run.cells:
        values = dict.fromkeys(run.suite.control_metrics, CellValue(note=reason))
        if answers is not None:
            if cell[2] not in galleries:
                galleries = {cell[2]: true_gallery(answers, cell[2])}  # of one class at a time
            images = _images(run, cell)
            values = {m: _recognised(m, cell, images, answers, galleries[cell[2]]) for m in values}
        for metric, value in values.items():
            rows.append(quality_row(run, cell, metric, value).row)
    return rows


def _images(run: Run, cell: CellKey) -> pd.DataFrame:
    columns = ("object", "view", "azimuth_deg", "elevation_deg", "outcome")
    return read_records(run.directory, columns, **dict(zip(JOB[:3], cell, strict=True)))


def image_keys(records: pd.DataFrame) -> list[ImageKey]:
    """Return object and view of each record."""
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))


def _recognised(
    metric: str,
    cell: CellKey,
    images: pd.DataFrame,
    answers: FeatureDistances,
    gallery: judge.Gallery,
) -> CellValue:
    """Return what is recognised in a cell. `images` are its records."""
    if metric == "retrieval" and (why := judge.why_no_retrieval(gallery)):
        return CellValue(note=why)
    exists = images["outcome"] == "ok"
    if not exists.any():
        return CellValue(note="no images")
    values = _per_image(metric, cell, images[exists], answers, gallery)
    # Under the same condition, though a blank image does not depend on it: it may be missing or
    # failed under another.
    of_blank = (FLOOR, *cell[1:])
    failed = images[images["outcome"] == "failed"]
    known = set(answers.images(*of_blank)) if len(failed) else set()
    failed = failed[[image in known for image in image_keys(failed)]]
    with_blank = np.concatenate([values, _per_image(metric, of_blank, failed, answers, gallery)])
    objects = images["object"][exists].to_numpy()
    if metric == "retrieval":
        per_object = np.asarray(pd.Series(values).groupby(objects).mean(), np.float64)
        interval = clipped(mean_interval(per_object), value_range(metric))
        return CellValue(Estimate(float(values.mean()), *interval), float(with_blank.mean()))
    estimate = Estimate(float(np.median(values)), *median_interval(values, objects))
    return CellValue(estimate, float(np.median(with_blank)))


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


def class_rows(run: Run, metrics: Sequence[str]) -> list[QualityRow]:
    """Return metric by metric the rows of each class, and last the means over classes."""
    rows = []
    for metric in metrics:
        rows += with_averages(
            image_rows(run, [metric]) if is_mean(metric) else set_rows(run, metric)
        )
    return rows


def with_averages(of_metric: Sequence[RowWithSamples]) -> list[QualityRow]:
    """Return the rows of a metric class by class, and last the means over classes.

    These are of the same classes for all methods: of those in which any of them has a value.
    """
    by_class: dict[str, list[QualityRow]] = {}
    by_cell: dict[tuple[str, str], list[RowWithSamples]] = {}
    known: dict[str, set[str]] = {}  # by condition: classes that any method has a value of
    for sampled in of_metric:
        row = sampled.row
        if math.isfinite(row.value):
            known.setdefault(row.condition, set()).add(row.class_name)
        by_class.setdefault(row.class_name, []).append(row)
        by_cell.setdefault((row.method, row.condition), []).append(sampled)
    return [
        *(row for of_class in by_class.values() for row in of_class),
        *(_average(of_cell, known.get(cell[1], set())) for cell, of_cell in by_cell.items()),
    ]


def _average(of_cell: Sequence[RowWithSamples], classes: AbstractSet[str]) -> QualityRow:
    """Return the mean over the classes, each counting alike; none where one has no value."""
    rows = [sampled.row for sampled in of_cell]
    first = rows[0]
    valued = [sampled for sampled in of_cell if sampled.row.class_name in classes]
    missing = [s.row.class_name for s in valued if not math.isfinite(s.row.value)]
    left_out = [row.class_name for row in rows if row.class_name not in classes]
    value, debiased, as_blank = (
        float(np.mean([getattr(sampled.row, name) for sampled in valued])) if valued else NAN
        for name in ("value", "debiased", "failures_as_blank")
    )
    samples = [sampled.per_object for sampled in valued]
    mean = is_mean(first.metric)
    interval = interval_of_means(samples) if mean else jackknife_interval(value, samples)
    low, high = clipped(interval, value_range(first.metric))
    parts = {"no value in": missing, "without": left_out}
    note = "; ".join(f"{words} {', '.join(names)}" for words, names in parts.items() if names)
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
        failures_as_blank=as_blank,
        note=note if valued else first.note,
        debiased=debiased,
    )


def quality_row(run: Run, cell: CellKey, metric: str, value: CellValue) -> RowWithSamples:
    """Return the row of a value, with the counts of images and the reasons for failures."""
    drawn, planned = run.images(cell)
    reasons = run.reasons.get(cell, Counter[str]())
    message = [f"{count} x {reason}" for reason, count in reasons.most_common()]
    if value.undefined:
        message.append(f"{value.undefined} x {NO_VALUE}: {metric_facts(metric).undefined}")
    row = QualityRow(
        run.suite.id,
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


def _ratio(total: float, count: int) -> float:
    return total / count if count else NAN
