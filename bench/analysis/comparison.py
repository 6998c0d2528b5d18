"""Cost and quality of methods on the same objects, object by object.

A failed image is scored as a blank one, as in the column `failures_as_blank` of the tables: whoever
chooses a method gets its failures too.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench.analysis.digits import prints_better
from bench.analysis.intervals import (
    NONE,
    SIGNIFICANCE,
    StandardError,
    clipped,
    distance_interval,
    jackknife_error,
    mean_error,
    mean_interval,
    median_interval,
)
from bench.catalogue.images import ENTERED
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import (
    higher_is_better,
    is_mean,
    value_range,
)
from bench.records.record import TIMES
from data_prep.arrays import Floats

if TYPE_CHECKING:
    from bench.analysis.distances import FeatureDistances
    from bench.analysis.frame import Run

NAN = float("nan")
ALL = "all"  # classes


class Estimate(NamedTuple):
    """A value with its 95 % interval over objects; NaN for what does not exist."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Quality:
    """The quality of a method's images by one metric.

    per_object  float64 [G]: the object's mean score, NaN where no image of it has one (an object
                without thin parts has no thin-recall). A Fréchet distance, which no single object
                has: the distance of all images without those of the object, or of each block of
                objects where there are many (`bench.metrics.frechet.object_blocks`)
    method      whose images they are; it may have fewer digits than the metric
    """

    metric: str
    estimate: Estimate
    per_object: Floats
    method: str = ""


def is_better(a: Quality, b: Quality) -> bool:
    """Return whether a value is better than another in the digits that both are printed with."""
    return prints_better(a.metric, a.estimate.value, b.estimate.value, a.method, b.method)


def best_first(qualities: Mapping[str, Quality]) -> dict[str, int]:
    """Return the methods that have a value, each with how many others print better than it."""
    known = [m for m, quality in qualities.items() if math.isfinite(quality.estimate.value)]
    before = {m: sum(is_better(qualities[n], qualities[m]) for n in known) for m in known}
    return {m: before[m] for m in sorted(known, key=before.__getitem__)}


@dataclass(frozen=True, eq=False)
class Comparison:
    """All methods of a run on the same objects of a class under one condition.

    objects            the G objects that have true images, sorted
    prepare_s, draw_s  float64 [G] by method, in the run's order: seconds for the cloud and for a
                       view; where the method failed those until then and 0, NaN where unknown
    images             numbers of images that exist and that should, by method
    qualities          by metric and method
    claimed            methods whose times their authors state; nothing here has measured them
    """

    condition: str
    class_name: str
    objects: tuple[str, ...]
    prepare_s: Mapping[str, Floats]
    draw_s: Mapping[str, Floats]
    images: Mapping[str, tuple[int, int]]
    qualities: Mapping[str, Mapping[str, Quality]]
    claimed: frozenset[str] = frozenset()

    def cost_ms(self, method: str, views: int) -> Estimate:
        """Return the milliseconds for a cloud with its views: the median over objects.

        A cloud that failed counts with the time that it took. NaN for a method without an image.
        """
        cost = 1000.0 * (self.prepare_s[method] + views * self.draw_s[method])
        known = np.isfinite(cost)
        if not known.any() or not self.images[method][0]:
            return Estimate(NAN, NAN, NAN)
        interval = median_interval(cost[known], np.flatnonzero(known))
        return Estimate(float(np.median(cost[known])), *interval)


def compare(
    run: Run,
    metrics: Sequence[str],
    methods: Container[str] | None = None,
    among: Mapping[tuple[str, str], Container[str]] | None = None,
) -> list[Comparison]:
    """Return a comparison for each condition and class, in the order of the cells.

    Objects without true images are left out, and so is a class that has no others.

    metrics  metrics of images that the jobs have, and set metrics that features exist for
    methods  methods that are compared, by default all; `blank` is needed, but may be left out
    among    objects that take part, by condition and class; by default all
    """
    by_cell: dict[tuple[str, str], list[str]] = {}
    for method, *cell in run.cells:
        by_cell.setdefault((cell[0], cell[1]), []).append(method)
    comparisons = []
    for cell, every in by_cell.items():
        if FLOOR not in every:
            continue
        drawn, _ = run.numbers((FLOOR, *cell))
        every_object = run.objects((FLOOR, *cell))
        known = drawn > 0
        if among is not None:
            known &= np.array([name in among.get(cell, ()) for name in every_object], bool)
        objects = tuple(every_object[known].tolist())
        if not objects:
            continue
        names = [method for method in every if methods is None or method in methods]
        prepare_s, draw_s = (
            {m: run.per_object((m, *cell), name)[known] for m in names} for name in TIMES
        )
        qualities = {
            metric: {
                m: _mean_quality(metric, run.per_object((m, *cell), metric, True)[known], m)
                for m in names
            }
            if is_mean(metric)
            else _set_qualities(metric, cell, names, run.features[metric], objects)
            for metric in metrics
        }
        images = {m: run.images((m, *cell)) for m in names}
        comparisons.append(
            Comparison(
                *cell,
                objects,
                prepare_s,
                draw_s,
                images,
                qualities,
                claimed=frozenset(run.manifest.get(ENTERED, ())) & {*names},
            )
        )
    return comparisons


def _mean_quality(metric: str, per_object: Floats, method: str) -> Quality:
    values = per_object[~np.isnan(per_object)]
    return Quality(metric, _mean_of_objects(values, value_range(metric)), per_object, method)


def _set_qualities(
    metric: str,
    cell: tuple[str, str],
    methods: Sequence[str],
    features: FeatureDistances,
    objects: Sequence[str],
) -> dict[str, Quality]:
    """Return the Fréchet distances to the true images."""
    known = set(objects)
    images = [image for image in features.images(FLOOR, *cell) if image[0] in known]
    if len(images) < 2:
        nothing = Estimate(NAN, NAN, NAN)
        return dict.fromkeys(methods, Quality(metric, nothing, np.full(len(objects), NAN)))
    qualities = {}
    for method in methods:
        value, leave_one_out = features.distance((method, *cell), images)
        estimate = Estimate(value, *distance_interval(value, leave_one_out))
        qualities[method] = Quality(metric, estimate, leave_one_out, method)
    return qualities


def pooled(compared: Sequence[Comparison]) -> list[Comparison]:
    """Return for each condition of several classes one comparison of all their objects, `ALL`.

    By metrics of images: every object counts alike, whatever its class.
    """
    by_condition: dict[str, list[Comparison]] = {}
    for comparison in compared:
        by_condition.setdefault(comparison.condition, []).append(comparison)
    several = len({comparison.class_name for comparison in compared}) > 1
    return [_pooled(classes) for classes in by_condition.values()] if several else []


def _pooled(classes: Sequence[Comparison]) -> Comparison:
    first = classes[0]

    def quality(metric: str, method: str) -> Quality:
        of_classes = [c.qualities[metric][method] for c in classes]
        per_object = np.concatenate([q.per_object for q in of_classes])
        return _mean_quality(metric, per_object, method)

    return Comparison(
        first.condition,
        ALL,
        objects=tuple(f"{c.class_name}/{name}" for c in classes for name in c.objects),
        prepare_s={m: np.concatenate([c.prepare_s[m] for c in classes]) for m in first.images},
        draw_s={m: np.concatenate([c.draw_s[m] for c in classes]) for m in first.images},
        images={
            m: (sum(c.images[m][0] for c in classes), sum(c.images[m][1] for c in classes))
            for m in first.images
        },
        qualities={
            metric: {method: quality(metric, method) for method in by_method}
            for metric, by_method in first.qualities.items()
            if is_mean(metric)
        },
        claimed=first.claimed,
    )


def candidates(methods: Iterable[str]) -> list[str]:
    """Return the methods to choose from: they see no mesh, and do not draw without a cloud."""
    return [method for method in methods if role(method) not in ("ceiling", "floor")]


def worse_than_blank(qualities: Mapping[str, Quality]) -> set[str]:
    """Return the methods whose value, as printed, is worse than that of a white image."""
    blank = qualities.get(FLOOR)
    return set() if blank is None else {m for m, q in qualities.items() if is_better(blank, q)}


class QualityChange(NamedTuple):
    """A difference of two qualities, its standard error, and the least and largest it can be.

    error  None where there are too few objects
    """

    value: float
    error: StandardError | None
    possible: tuple[float, float]

    def estimate(self, alpha: float = SIGNIFICANCE) -> Estimate:
        """Return the difference with the interval that misses the true one in `alpha`."""
        interval = self.error.interval(self.value, alpha) if self.error else NONE
        return Estimate(self.value, *clipped(interval, self.possible))

    @property
    def p(self) -> float:
        """Return the two-sided p value of no difference; NaN without an error."""
        return self.error.p_value(self.value) if self.error else NAN


def change(a: Sequence[Quality], b: Sequence[Quality]) -> QualityChange:
    """Return a - b in the mean over classes, by pairing the two object by object.

    Both have a quality of each class by one metric, in the same order. A class in which no object
    has a value on both sides does not count.
    """
    metric, pairs = a[0].metric, list(zip(a, b, strict=True))
    least, largest = value_range(metric)
    possible = (least - largest, largest - least)
    if is_mean(metric):
        samples = [values for x, y in pairs if len(values := paired(x, y))]
        value = float(np.mean([values.mean() for values in samples])) if samples else NAN
        return QualityChange(value, mean_error(samples), possible)
    value = float(np.mean([x.estimate.value - y.estimate.value for x, y in pairs]))
    return QualityChange(
        value, jackknife_error([x.per_object - y.per_object for x, y in pairs]), possible
    )


def difference(a: Quality, b: Quality) -> Estimate:
    """Return a - b in units of the metric with its 95 % interval, paired object by object."""
    return change([a], [b]).estimate()


def better_by(a: Quality, b: Quality) -> Estimate:
    """Return the difference of a and b, above 0 where a is better."""
    return difference(a, b) if higher_is_better(a.metric) else difference(b, a)


def class_mean_difference(
    a: Sequence[Quality], b: Sequence[Quality], alpha: float = SIGNIFICANCE
) -> tuple[Estimate, StandardError | None]:
    """Return by how much `a` is better than `b` in the mean over classes, with its error.

    Both have a quality of each class by one metric, in the same order.
    """
    better = change(a, b) if higher_is_better(a[0].metric) else change(b, a)
    return better.estimate(alpha), better.error


def paired(a: Quality, b: Quality) -> Floats:
    """Return a - b by an image metric for each object that both have a value of, [G' <= G]."""
    per_object = a.per_object - b.per_object
    return per_object[~np.isnan(per_object)]


def milliseconds(value: float) -> str:
    """Return milliseconds with about three digits: 0.42, 7.3, 61.4, 1240."""
    if not math.isfinite(value):
        return "-"
    digits = 2 if value < 1 else 1 if value < 100 else 0
    return f"{value:.{digits}f}"


def _mean_of_objects(values: Floats, possible: tuple[float, float]) -> Estimate:
    value = float(values.mean()) if len(values) else NAN
    return Estimate(value, *clipped(mean_interval(values), possible))
