"""The values of quality tables: each method under each condition on each class, by each metric.

Pure functions of a scored run. A row of a frame has its value of the images that exist, its 95 %
interval over objects, and the value with a blank image in place of each failed one. By a metric of
images a value is the mean over objects of each object's mean over its images, so that every object
counts alike, however many of its images have a value.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.comparison import NAN, mean_estimate
from bench.analysis.distances import CellKey, FeatureDistances
from bench.analysis.intervals import clipped, jackknife_interval, mean_interval, median_interval
from bench.analysis.paper import AVERAGE
from bench.analysis.recognition import true_gallery
from bench.analysis.scored_run import Run
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import (
    JUDGE,
    KERNEL_METRICS,
    extractor_of,
    is_mean,
    metric_facts,
    value_range,
)
from bench.judges import answers as judge
from bench.records.frames import ImageKey, read_records
from bench.records.record import GROUND_TRUTH, JOB
from data_prep.arrays import Floats

NO_VALUE = "no value"
# The columns of a frame of values, as they stand in CSV. A number that does not exist is NaN.
# value              of the images whose outcome is ok
# ci_low, ci_high    95 % interval over objects
# n_ok, n            images that exist and have a value, images there should be
# paper              the published value, on the paper's data
# failures_as_blank  the value with a blank image in place of each failed one
# note               why there is no value, or the reasons of the failures and how many existing
#                    images have no value; for a chosen method first which method it is
# debiased           a Frechet distance without the bias of few objects (`Distance.debiased`)
# trained_on         the objects that a network was trained on; "nothing" for methods that are not
#                    trained, empty where it is unknown
# objective          what the weights of a network were trained with; empty for other methods
VALUE_COLUMNS = (
    *("suite", "method", "condition", "class", "metric", "value", "ci_low", "ci_high", "n_ok", "n"),
    *("paper", "failures_as_blank", "note", "debiased", "trained_on", "objective"),
)
# Columns that no file has.
# images_of   the method whose images they are: of a chosen one that which it is
# skipped     whether the metric was not measured
# undefined   number of existing images without a value
# failed      whether images are missing
# per_object  what the interval was made from, float64 [G]: by a metric of images the mean of each
#             object that has a value, by a distance of sets the distance without each block of
#             objects (`bench.metrics.frechet`)
# objects     number of objects of the cell, with images or without
HIDDEN = ("images_of", "skipped", "undefined", "failed", "per_object", "objects")
NOTHING: Mapping[str, Any] = {
    **dict.fromkeys(("value", "ci_low", "ci_high", "paper", "failures_as_blank", "debiased"), NAN),
    **{"note": "", "trained_on": "", "objective": ""},
    **{"skipped": False, "undefined": 0, "per_object": np.empty(0)},
}


def image_rows(run: Run, metrics: Sequence[str], blanks: bool = False) -> pd.DataFrame:
    """Return the means over objects by metrics of images, for all cells.

    With `blanks` values and intervals are those with a blank image in place of each failed one.
    """

    def value_of(cell: CellKey, metric: str) -> dict[str, Any]:
        if metric in run.skipped:
            return _skipped(run.skipped[metric])
        return _mean_of_objects(run, cell, metric, blanks)

    return _frame(run, metrics, value_of)


def _skipped(reason: str) -> dict[str, Any]:
    return {"note": reason, "skipped": True}


def _mean_of_objects(run: Run, cell: CellKey, metric: str, blanks: bool) -> dict[str, Any]:
    drawn, _ = run.images(cell)
    missing = drawn - run.scored(cell, metric)
    undefined = metric_facts(metric).undefined
    existing = run.per_object(cell, metric)
    with_blanks = run.per_object(cell, metric, blanks=True)
    per_object = with_blanks if blanks else existing
    estimate = mean_estimate(metric, per_object)
    as_blank = mean_estimate(metric, with_blanks).value
    if missing and not undefined:  # an error, and shows as such
        estimate, as_blank = estimate._replace(value=NAN), NAN
    return {
        "value": estimate.value,
        "ci_low": estimate.low,
        "ci_high": estimate.high,
        "failures_as_blank": as_blank,
        "per_object": per_object[~np.isnan(per_object)],
        "undefined": missing if undefined else 0,
    }


def set_rows(run: Run, metric: str) -> pd.DataFrame:
    """Return the distances to the true images of the same views by a set metric, for all cells."""
    extractor = extractor_of(metric)
    features, reason = run.features.get(extractor), run.skipped.get(extractor, "")
    return distance_rows(run, metric, metric in KERNEL_METRICS, features, reason)


def distance_rows(
    run: Run,
    metric: str,
    kernel: bool,
    features: FeatureDistances | None,
    reason: str = "",
) -> pd.DataFrame:
    """Return the distances by features, for all cells; `reason` says why there are no features."""

    def value_of(cell: CellKey, metric: str) -> dict[str, Any]:
        return _skipped(reason) if features is None else _distance(cell, features, kernel)

    return _frame(run, [metric], value_of)


def _distance(cell: CellKey, features: FeatureDistances, kernel: bool) -> dict[str, Any]:
    _, condition, class_name = cell
    drawn = features.images(*cell)
    if len(drawn) < 2:
        return {"note": "fewer than two images"}
    distance = features.distance(cell, drawn, kernel)
    true = features.images(GROUND_TRUTH, "", class_name)
    wanted = set() if drawn == true else set(true) - set(drawn)  # sets of all images take memory
    missing = wanted & set(features.images(FLOOR, condition, class_name)) if wanted else wanted
    with_blank = distance
    if missing:
        with_blank = features.distance(cell, sorted([*drawn, *missing]), kernel)
    low, high = distance.interval
    return {
        "value": distance.value,
        "ci_low": low,
        "ci_high": high,
        "failures_as_blank": with_blank.value,
        "per_object": distance.leave_one_out,
        "debiased": distance.debiased,
    }


def recognition_rows(run: Run) -> pd.DataFrame:
    """Return what the judge recognises in each method's images: the view, and which object it is.

    Angles are medians over images of the error in degrees, with intervals by a bootstrap over
    objects; retrieval is the share of an object's images, in the mean over objects.
    """
    answers, metrics = run.features.get(JUDGE), run.suite.control_metrics
    values: dict[tuple[CellKey, str], Mapping[str, Any]] = {}
    galleries: dict[str, judge.Gallery] = {}
    for cell in run.cells:
        if answers is None:
            of_metrics = [_skipped(run.skipped.get(JUDGE, ""))] * len(metrics)
        else:
            if cell[2] not in galleries:
                galleries = {cell[2]: true_gallery(answers, cell[2])}  # of one class at a time
            columns = ("object", "view", "azimuth_deg", "elevation_deg", "outcome")
            images = read_records(run.directory, columns, **dict(zip(JOB[:3], cell, strict=True)))
            of_metrics = _recognised(metrics, cell, images, answers, galleries[cell[2]])
        values |= {(cell, metric): value for metric, value in zip(metrics, of_metrics, strict=True)}
    return _frame(run, metrics, lambda cell, metric: values[cell, metric])


def _recognised(
    metrics: Sequence[str],
    cell: CellKey,
    images: pd.DataFrame,
    answers: FeatureDistances,
    gallery: judge.Gallery,
) -> list[dict[str, Any]]:
    """Return what is recognised in a cell, by metric. `images` are its records."""
    nothing = {"retrieval": why} if (why := judge.why_no_retrieval(gallery)) else {}
    drawn, failed = (images[images["outcome"] == outcome] for outcome in ("ok", "failed"))
    if drawn.empty:
        return [{"note": nothing.get(metric, "no images")} for metric in metrics]
    # Under the same condition, though a blank image does not depend on it: it may be missing or
    # failed under another.
    of_blank = (FLOOR, *cell[1:])
    known = set(answers.images(*of_blank)) if len(failed) else set()
    failed = failed[[image in known for image in _image_keys(failed)]]
    parts = [
        (rows, answers.of(*place, _image_keys(rows)))
        for place, rows in ((cell, drawn), (of_blank, failed))
        if len(rows)
    ]
    with_blank_objects = np.concatenate([rows["object"].to_numpy() for rows, _ in parts])
    objects, of_metrics = with_blank_objects[: len(drawn)], []
    for metric in metrics:
        if metric in nothing:
            of_metrics.append({"note": nothing[metric]})
            continue
        with_blank = np.concatenate([_per_image(metric, gallery, *part) for part in parts])
        values = with_blank[: len(drawn)]
        if metric == "retrieval":
            value, low, high = mean_estimate(metric, _means_of_objects(values, objects))
            as_blank = float(_means_of_objects(with_blank, with_blank_objects).mean())
        else:
            low, high = median_interval(values, objects)
            value, as_blank = float(np.median(values)), float(np.median(with_blank))
        of_metrics.append(
            {"value": value, "ci_low": low, "ci_high": high, "failures_as_blank": as_blank}
        )
    return of_metrics


def _means_of_objects(values: Floats, objects: NDArray[Any]) -> Floats:
    """Return the mean [G] of the values [n] of each object, by the objects [n] of the values."""
    return np.asarray(pd.Series(values).groupby(objects).mean(), np.float64)


def _image_keys(records: pd.DataFrame) -> list[ImageKey]:
    """Return object and view of each record."""
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))


def _per_image(
    metric: str, gallery: judge.Gallery, records: pd.DataFrame, answered: NDArray[Any]
) -> Floats:
    """Return the error or the hit of each record's image, in their order."""
    if metric == "azimuth-error-deg":
        return judge.azimuth_error_deg(answered, records["azimuth_deg"].to_numpy())
    if metric == "elevation-error-deg":
        return judge.elevation_error_deg(answered, records["elevation_deg"].to_numpy())
    return judge.found(gallery, answered, _image_keys(records))


def class_rows(run: Run, metrics: Sequence[str]) -> pd.DataFrame:
    """Return metric by metric the rows of each class, and last the means over classes."""
    of_metrics = (
        image_rows(run, [metric]) if is_mean(metric) else set_rows(run, metric)
        for metric in metrics
    )
    return pd.concat(map(with_averages, of_metrics), ignore_index=True)


def with_averages(of_metric: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a metric class by class, and last the means over classes.

    These are of the same classes for all methods: of those in which any of them has a value.
    """
    valued = of_metric[np.isfinite(of_metric["value"])]
    known = valued.groupby("condition")["class"].agg(set).to_dict()
    averages = [
        _average(of_cell, known.get(of_cell["condition"].iloc[0], set()))
        for _, of_cell in of_metric.groupby(["method", "condition"], sort=False)
    ]
    by_class = [of_class for _, of_class in of_metric.groupby("class", sort=False)]
    return pd.concat([*by_class, pd.DataFrame(averages)], ignore_index=True)


def _average(rows: pd.DataFrame, classes: AbstractSet[str]) -> dict[str, Any]:
    """Return the mean over the classes, each counting alike; none where one has no value."""
    first, metric = rows.iloc[0], rows["metric"].iloc[0]
    valued = rows[rows["class"].isin(classes)]
    missing = valued.loc[~np.isfinite(valued["value"]), "class"]
    left_out = rows.loc[~rows["class"].isin(classes), "class"]
    means = {
        name: float(np.mean(valued[name].to_list())) if len(valued) else NAN
        for name in ("value", "debiased", "failures_as_blank")
    }
    samples, mean = valued["per_object"].tolist(), is_mean(metric)
    interval = mean_interval(*samples) if mean else jackknife_interval(means["value"], samples)
    low, high = clipped(interval, value_range(metric))
    parts = {"no value in": missing, "without": left_out}
    note = "; ".join(f"{words} {', '.join(names)}" for words, names in parts.items() if len(names))
    return {
        **first,
        **{name: int(rows[name].sum()) for name in ("n_ok", "n", "undefined", "objects")},
        **means,
        "class": AVERAGE,
        "ci_low": low,
        "ci_high": high,
        "note": note if len(valued) else first["note"],
        "skipped": bool(first["skipped"]) and not len(valued),
        "failed": bool(rows["failed"].any()),
    }


def _frame(
    run: Run, metrics: Sequence[str], value_of: Callable[[CellKey, str], Mapping[str, Any]]
) -> pd.DataFrame:
    """Return a row for each cell and metric, with the counts of images and why some failed."""
    rows = []
    for cell, metric in product(run.cells, metrics):
        row = {**NOTHING, **value_of(cell, metric)}
        drawn, planned = run.images(cell)
        reasons = run.reasons.get(cell, Counter()).most_common()
        message = [f"{n} x {reason}" for reason, n in reasons]
        if row["undefined"]:
            message.append(f"{row['undefined']} x {NO_VALUE}: {metric_facts(metric).undefined}")
        row |= dict(zip(JOB, cell, strict=False)) | {
            "suite": run.suite.id,
            "metric": metric,
            "n_ok": drawn - row["undefined"],
            "n": planned,
            "note": row["note"] or "; ".join(message),
            "images_of": cell[0],
            "failed": drawn < planned,
            "objects": len(run.objects(cell)),
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=[*VALUE_COLUMNS, *HIDDEN])
