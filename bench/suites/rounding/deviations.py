"""Deviations of scores over repetitions in random rounding, and moves in other arithmetics."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bench.analysis.distances import set_distance
from bench.analysis.object_sums import KEY
from bench.analysis.scored import ScoredRun
from bench.catalogue.methods import find_method
from bench.catalogue.metrics import column, extractor_of
from bench.catalogue.suites import RoundingSuite
from bench.records.arithmetic import FORMATS, PLAIN, SEPARATOR, Arithmetic
from bench.records.artifacts import JobName
from bench.records.stored_artifacts import Artifact
from bench.suites.rounding.arithmetics import ALONE, arithmetics, stages_of
from data_prep.arrays import Floats
from data_prep.scene import UInt8Images

NAN = math.nan
GREY = "grey-levels"


@dataclass(frozen=True)
class Deviation:
    """The deviation of a metric over random roundings of one method at one condition.

    value             mean of the table value over the repetitions
    object_deviation  standard deviation of the value of one object, root mean square over objects;
                      of distances of sets that of the value times the root of the number of objects
    degrees           degrees of freedom of `object_deviation`
    image_deviation   as `object_deviation`, of the score of a single image; NaN for distances
    """

    method: str
    condition: str
    metric: str
    value: float
    object_deviation: float
    degrees: int
    objects: int
    views: int
    repetitions: int
    image_deviation: float


@dataclass(frozen=True)
class StageDeviation:
    """The deviation of an object's value where one stage alone is rounded at random.

    stage  "all" for all stages together
    """

    method: str
    condition: str
    stage: str
    metric: str
    object_deviation: float


@dataclass(frozen=True)
class Move:
    """The move from the plain arithmetic to another one, over all images of a cell.

    metric              GREY for the images themselves: mean absolute difference, 0..255
    move                mean over objects, of grey levels over all pixels
    largest             largest absolute move of an object; of grey levels that of any pixel
    failed              images that exist in one of the two only
    """

    method: str
    condition: str
    arithmetic: str
    metric: str
    move: float
    largest: float
    failed: int


def values_of(run: ScoredRun, method: str, conditions: Sequence[str], metric: str) -> Floats:
    """Return the value of each object under each of some conditions, [conditions, G].

    Blank images count in place of failed ones. NaN where no image has a score.
    """
    rows = []
    for condition in conditions:
        of_classes = (
            run.sums.per_object((method, condition, name), metric, blanks=True)
            for name in run.sums.objects_of
        )
        rows.append(np.concatenate([*of_classes]))
    return np.array(rows)


def deviation(values: Floats) -> tuple[float, int]:
    """Return the standard deviation of one column of [n, G], root mean square, and its degrees.

    Columns with a NaN are left out; without any, the deviation is NaN.
    """
    known = values[:, ~np.isnan(values).any(axis=0)]
    if not known.size:
        return NAN, 0
    # About the first row: a mean of equal values may be a rounding error away from them.
    spread = (known - known[0]).var(axis=0, ddof=1)
    return float(np.sqrt(spread.mean())), known.shape[1] * (len(known) - 1)


def deviations(run: ScoredRun, suite: RoundingSuite, conditions: Iterable[str]) -> list[Deviation]:
    """Return the deviations of all metrics of a run in random rounding of all stages.

    A metric without a value, as that of thin parts where none is drawn, has no row, and neither has
    a method that draws the true mesh: its truth is not rounded with it, as it is in other runs.
    """
    metrics = run.measured((*suite.base.image_metrics, *suite.base.detail_metrics))
    of_sets = [name for name in suite.base.set_metrics if extractor_of(name) in run.features]
    rows = []
    for method, condition, repeated in _repeated(run, suite, conditions):
        if find_method(method).role == "ceiling":
            continue
        images = run.read_images([*KEY, "view", *map(column, metrics)], method=method)
        images = images[images["condition"].isin(repeated)]
        for metric in metrics:
            values = values_of(run, method, repeated, metric)
            spread, degrees = deviation(values)
            table = np.nanmean(values) if np.isfinite(values).any() else NAN
            rows.append(
                Deviation(
                    *(method, condition, metric, float(table), spread, degrees),
                    values.shape[1],
                    suite.base.views,
                    len(repeated),
                    image_deviation(images, column(metric)),
                )
            )
        for metric in of_sets:
            distances = np.array([set_values(run, method, each, metric) for each in repeated])
            count = distances.shape[1]
            objects = sum(run.sums.objects_of.values())
            spread, degrees = deviation(distances)
            rows.append(
                Deviation(
                    *(method, condition, metric, float(distances.mean())),
                    *(spread * math.sqrt(objects / count), degrees),
                    objects,
                    suite.base.views,
                    len(repeated),
                    NAN,
                )
            )
    return [row for row in rows if math.isfinite(row.object_deviation)]


def image_deviation(images: pd.DataFrame, name: str) -> float:
    """Return the standard deviation of the score of one image, root mean square over images."""
    spread = images.groupby(["class", "object", "view"], observed=True)[name].var(ddof=1)
    return float(np.sqrt(spread.mean())) if spread.notna().any() else NAN


def set_values(run: ScoredRun, method: str, condition: str, metric: str) -> Floats:
    """Return the distance of a method's images to the true ones in each class, [classes]."""
    distance, features = set_distance(metric), run.features[extractor_of(metric)]
    values = []
    for name in run.sums.objects_of:
        cell = method, condition, name
        images = features.images(*cell)
        enough = len(images) >= 2
        values.append(distance.between(features, cell, images).value if enough else NAN)
    return np.array(values)


def stage_deviations(
    run: ScoredRun, suite: RoundingSuite, conditions: Iterable[str]
) -> list[StageDeviation]:
    """Return the deviations of image metrics where one stage at a time is rounded at random."""
    metrics = run.measured((*suite.base.image_metrics, *suite.base.detail_metrics))
    rows = []
    told_apart = [condition for condition in conditions if condition in suite.told_apart]
    for method, condition, _ in _repeated(run, suite, told_apart):
        for stage in ("", *stages_of(find_method(method))):
            stages = (stage,) if stage else ()
            count = suite.stage_repetitions if stage else suite.repetitions
            repeated = [_cell(condition, Arithmetic("random", stages, n)) for n in range(count)]
            for metric in metrics:
                spread, _ = deviation(values_of(run, method, repeated, metric))
                rows.append(StageDeviation(method, condition, stage or "all", metric, spread))
    return rows


def moves(
    run: ScoredRun,
    suite: RoundingSuite,
    conditions: Iterable[str],
    artifacts: Mapping[JobName, Artifact],
) -> list[Move]:
    """Return how far other arithmetics than random rounding move images and image metrics."""
    metrics = run.measured((*suite.base.image_metrics, *suite.base.detail_metrics))
    told_apart = [condition for condition in conditions if condition in suite.told_apart]
    rows = []
    for method, condition, _ in _repeated(run, suite, told_apart):
        plain = _cell(condition, PLAIN)
        before = _images(run, artifacts, method, plain)
        for kind in (*ALONE, *(FORMATS if find_method(method).kind == "network" else ())):
            other = _cell(condition, Arithmetic(kind))
            after = _images(run, artifacts, method, other)
            failed = suite.base.views * len(before.keys() ^ after.keys())
            shared = before.keys() & after.keys()
            grey = [np.abs(before[name].astype(np.int16) - after[name]) for name in shared]
            mean = float(np.mean([d.mean() for d in grey])) if grey else NAN
            largest = float(max((d.max() for d in grey), default=NAN))
            rows.append(Move(method, condition, kind, GREY, mean, largest, failed))
            for metric in metrics:
                first, second = values_of(run, method, [plain, other], metric)
                apart = (second - first)[~np.isnan(second - first)]
                mean = float(apart.mean()) if len(apart) else NAN
                largest = float(np.abs(apart).max()) if len(apart) else NAN
                rows.append(Move(method, condition, kind, metric, mean, largest, failed))
    return rows


def _images(
    run: ScoredRun, artifacts: Mapping[JobName, Artifact], method: str, condition: str
) -> dict[str, UInt8Images]:
    """Return the images of a cell by the names of their objects, as far as they exist."""
    images = {}
    for name in run.manifest["objects"]:
        class_name, _, object_id = name.partition("/")
        job = JobName(method, condition, class_name, object_id)
        if job in artifacts:
            images[name] = artifacts[job].read()
    return images


def _repeated(
    run: ScoredRun, suite: RoundingSuite, conditions: Iterable[str]
) -> Iterator[tuple[str, str, list[str]]]:
    """Yield method, condition and its repetitions with all stages rounded at random."""
    for condition in conditions:
        for method in run.manifest["methods"]:
            repeated = [
                _cell(condition, arithmetic)
                for arithmetic in arithmetics(find_method(method), condition, suite)
                if arithmetic.kind == "random" and not arithmetic.stages
            ]
            if repeated:
                yield method, condition, repeated


def _cell(condition: str, arithmetic: Arithmetic) -> str:
    return f"{condition}{SEPARATOR}{arithmetic.id}"
