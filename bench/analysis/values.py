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

from bench.analysis.compare import NAN, mean_estimate
from bench.analysis.intervals import clipped, jackknife_interval, mean_interval, median_interval
from bench.analysis.paper import AVERAGE
from bench.analysis.run import Run
from bench.analysis.sets import FeatureDistances, ImageSet, true_gallery
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
from bench.records.job import GROUND_TRUTH
from data_prep.arrays import Floats

NO_VALUE = "no value"
# The columns of a frame of values, as they stand in CSV. A number that does not exist is NaN.
# value              of the images whose outcome is ok
# ci_low, ci_high    95 % interval over objects
# n_ok, n            images that exist and have a value, images there should be
# paper              the published value, on the paper's data
# failures_as_blank  the value with a blank image in place of each failed one
# note               why there is no value, or why images failed and how many existing images have
#                    no value; in a row that chooses a method (`best-classical`) first its id
# debiased           a Fréchet distance without the bias of few objects (`Distance.debiased`)
# trained_on         the objects that a network was trained on; "nothing" for methods that are not
#                    trained, empty where it is unknown
# objective          the losses that a network was trained with; empty for other methods
VALUE_COLUMNS = (
    "suite",
    "method",
    "condition",
    "class",
    "metric",
    "value",
    "ci_low",
    "ci_high",
    "n_ok",
    "n",
    "paper",
    "failures_as_blank",
    "note",
    "debiased",
    "trained_on",
    "objective",
)
# Columns of the frame that are not written to a file.
# images_of   the method that drew the images: `method` itself, or the one that a row like
#             `best-classical` has chosen
# skipped     whether the metric was not measured
# undefined   number of existing images without a value
# failed      whether images are missing
# per_object  what the interval was made from, float64 [G]: by a metric of images the mean of each
#             object that has a value, by a distance of sets the distance without each block of
#             objects (`bench.metrics.frechet`)
# objects     number of objects, with images or without
HIDDEN = ("images_of", "skipped", "undefined", "failed", "per_object", "objects")
# The columns of a value that does not exist.
EMPTY_VALUES: Mapping[str, Any] = {
    "value": NAN,
    "ci_low": NAN,
    "ci_high": NAN,
    "paper": NAN,
    "failures_as_blank": NAN,
    "debiased": NAN,
    "note": "",
    "trained_on": "",
    "objective": "",
    "skipped": False,
    "undefined": 0,
    "per_object": np.empty(0),
}


def image_rows(run: Run, metrics: Sequence[str], blanks: bool = False) -> pd.DataFrame:
    """Return the means over objects by metrics of images, for all methods, conditions and classes.

    With `blanks` values and intervals are those with a blank image in place of each failed one.
    """

    def value_of(image_set: ImageSet, metric: str) -> dict[str, Any]:
        if metric in run.skipped:
            return _skipped(run.skipped[metric])
        return _mean_of_objects(run, image_set, metric, blanks)

    return _frame(run, metrics, value_of)


def _skipped(reason: str) -> dict[str, Any]:
    return {"note": reason, "skipped": True}


def _mean_of_objects(run: Run, image_set: ImageSet, metric: str, blanks: bool) -> dict[str, Any]:
    drawn, _ = run.images(image_set)
    missing = drawn - run.scored(image_set, metric)
    undefined = metric_facts(metric).undefined
    existing = run.per_object(image_set, metric)
    with_blanks = run.per_object(image_set, metric, blanks=True)
    per_object = with_blanks if blanks else existing
    estimate = mean_estimate(metric, per_object)
    as_blank = mean_estimate(metric, with_blanks).value
    if missing and not undefined:
        # A metric that is defined for every image has no value for some: a mean of the others
        # would hide that error.
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
    """Return the distances between each method's images and the true ones by a set metric."""
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
    """Return the distances between the features of each method's images and of the true ones.

    metric    name of the distance
    kernel    whether it is a kernel distance, else a Fréchet distance
    features  None where the run has none; `reason` then says why
    """

    def value_of(image_set: ImageSet, metric: str) -> dict[str, Any]:
        return _skipped(reason) if features is None else _distance(image_set, features, kernel)

    return _frame(run, [metric], value_of)


def _distance(image_set: ImageSet, features: FeatureDistances, kernel: bool) -> dict[str, Any]:
    _, condition, class_name = image_set
    drawn = features.images(*image_set)
    if len(drawn) < 2:
        return {"note": "fewer than two images"}
    distance = features.distance(image_set, drawn, kernel)
    with_blank = distance
    true = features.images(GROUND_TRUTH, "", class_name)
    if drawn != true:  # only then: sets of all images take memory
        missing = set(true) - set(drawn)
        missing &= set(features.images(FLOOR, condition, class_name))
        if missing:
            with_blank = features.distance(image_set, sorted([*drawn, *missing]), kernel)
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
    values: dict[ImageSet, Mapping[str, Mapping[str, Any]]] = {}
    galleries: dict[str, judge.Gallery] = {}
    for image_set in run.image_sets:
        if answers is None:
            skipped = _skipped(run.skipped.get(JUDGE, ""))
            values[image_set] = dict.fromkeys(metrics, skipped)
            continue
        method, condition, class_name = image_set
        if class_name not in galleries:
            # Of one class at a time, as classes follow each other and a gallery takes memory.
            galleries = {class_name: true_gallery(answers, class_name)}
        columns = ("object", "view", "azimuth_deg", "elevation_deg", "outcome")
        only = {"method": method, "condition": condition, "class": class_name}
        images = read_records(run.directory, columns, **only)
        values[image_set] = _recognised(metrics, image_set, images, answers, galleries[class_name])
    return _frame(run, metrics, lambda image_set, metric: values[image_set][metric])


def _recognised(
    metrics: Sequence[str],
    image_set: ImageSet,
    images: pd.DataFrame,
    answers: FeatureDistances,
    gallery: judge.Gallery,
) -> dict[str, dict[str, Any]]:
    """Return the values of a set of images by metric.

    images   the records of the set, one row an image
    answers  the judge's answers to all images of the run
    gallery  the true images among which an object is looked for
    """
    without_value: dict[str, str] = {}
    if reason := judge.why_no_retrieval(gallery):
        without_value["retrieval"] = reason
    drawn, failed = (images[images["outcome"] == outcome] for outcome in ("ok", "failed"))
    if drawn.empty:
        return {metric: {"note": without_value.get(metric, "no images")} for metric in metrics}
    # Blank images do not depend on the condition, but may be missing or failed under another one.
    of_blank = (FLOOR, *image_set[1:])
    known = set(answers.images(*of_blank)) if len(failed) else set()
    failed = failed[[image in known for image in _image_keys(failed)]]
    parts = [(drawn, answers.of(*image_set, _image_keys(drawn)))]
    if len(failed):
        parts.append((failed, answers.of(*of_blank, _image_keys(failed))))
    with_blank_objects = np.concatenate([rows["object"].to_numpy() for rows, _ in parts])
    objects = with_blank_objects[: len(drawn)]
    of_metrics: dict[str, dict[str, Any]] = {}
    for metric in metrics:
        if metric in without_value:
            of_metrics[metric] = {"note": without_value[metric]}
            continue
        with_blank = np.concatenate([_per_image(metric, gallery, *part) for part in parts])
        values = with_blank[: len(drawn)]
        if metric == "retrieval":
            value, low, high = mean_estimate(metric, _means_of_objects(values, objects))
            as_blank = float(_means_of_objects(with_blank, with_blank_objects).mean())
        else:
            low, high = median_interval(values, objects)
            value, as_blank = float(np.median(values)), float(np.median(with_blank))
        of_metrics[metric] = {
            "value": value,
            "ci_low": low,
            "ci_high": high,
            "failures_as_blank": as_blank,
        }
    return of_metrics


def _means_of_objects(values: Floats, objects: NDArray[Any]) -> Floats:
    """Return the mean [G] of each object's values; `objects` [n] names the object of each value."""
    return np.asarray(pd.Series(values).groupby(objects).mean(), np.float64)


def _image_keys(records: pd.DataFrame) -> list[ImageKey]:
    """Return the object and the view of each record."""
    return list(zip(records["object"].tolist(), records["view"].tolist(), strict=True))


def _per_image(
    metric: str, gallery: judge.Gallery, records: pd.DataFrame, answered: NDArray[Any]
) -> Floats:
    """Return for each image the error of its angle in degrees, or whether its object was found."""
    if metric == "azimuth-error-deg":
        return judge.azimuth_error_deg(answered, records["azimuth_deg"].to_numpy())
    if metric == "elevation-error-deg":
        return judge.elevation_error_deg(answered, records["elevation_deg"].to_numpy())
    return judge.found(gallery, answered, _image_keys(records))


def class_rows(run: Run, metrics: Sequence[str]) -> pd.DataFrame:
    """Return for each metric the rows class by class, and then the means over classes."""
    of_metrics = (
        image_rows(run, [metric]) if is_mean(metric) else set_rows(run, metric)
        for metric in metrics
    )
    return pd.concat(map(with_averages, of_metrics), ignore_index=True)


def with_averages(of_metric: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a metric class by class, and then the means over classes.

    The mean of every method is over the same classes: those in which any method has a value.
    """
    valued = of_metric[np.isfinite(of_metric["value"])]
    known = valued.groupby("condition")["class"].agg(set).to_dict()
    averages = []
    for _, of_method in of_metric.groupby(["method", "condition"], sort=False):
        condition = of_method["condition"].iloc[0]
        averages.append(_average(of_method, known.get(condition, set())))
    by_class = [of_class for _, of_class in of_metric.groupby("class", sort=False)]
    return pd.concat([*by_class, pd.DataFrame(averages)], ignore_index=True)


def _average(rows: pd.DataFrame, classes: AbstractSet[str]) -> dict[str, Any]:
    """Return the row of the mean over the classes, each counting alike.

    rows     of one method at one condition, one for each class
    classes  the classes of the mean; it has no value where one of them has none
    """
    first, metric = rows.iloc[0], rows["metric"].iloc[0]
    valued = rows[rows["class"].isin(classes)]
    missing = valued.loc[~np.isfinite(valued["value"]), "class"]
    left_out = rows.loc[~rows["class"].isin(classes), "class"]
    means = {
        name: float(np.mean(valued[name].to_list())) if len(valued) else NAN
        for name in ("value", "debiased", "failures_as_blank")
    }
    samples = valued["per_object"].tolist()
    if is_mean(metric):
        interval = mean_interval(*samples)
    else:
        interval = jackknife_interval(means["value"], samples)
    low, high = clipped(interval, value_range(metric))
    remarks = []
    if len(missing):
        remarks.append(f"no value in {', '.join(missing)}")
    if len(left_out):
        remarks.append(f"without {', '.join(left_out)}")
    why = rows[rows["failed"] & (rows["note"] != "") & np.isfinite(rows["value"])]
    remarks += [f"{name}: {note}" for name, note in zip(why["class"], why["note"], strict=True)]
    note = "; ".join(remarks)
    sums = {name: int(rows[name].sum()) for name in ("n_ok", "n", "undefined", "objects")}
    return {
        **first,
        **sums,
        **means,
        "class": AVERAGE,
        "ci_low": low,
        "ci_high": high,
        "note": note if len(valued) else first["note"],
        "skipped": bool(first["skipped"]) and not len(valued),
        "failed": bool(rows["failed"].any()),
    }


def _frame(
    run: Run, metrics: Sequence[str], value_of: Callable[[ImageSet, str], Mapping[str, Any]]
) -> pd.DataFrame:
    """Return a row for each set of images and metric, with how many images exist and why some fail.

    value_of  returns the columns of a value that differ from EMPTY_VALUES
    """
    rows = []
    for image_set, metric in product(run.image_sets, metrics):
        method, condition, class_name = image_set
        row = {**EMPTY_VALUES, **value_of(image_set, metric)}
        drawn, planned = run.images(image_set)
        reasons = run.reasons.get(image_set, Counter()).most_common()
        message = [f"{count} x {reason}" for reason, count in reasons]
        if row["undefined"]:
            message.append(f"{row['undefined']} x {NO_VALUE}: {metric_facts(metric).undefined}")
        row |= {
            "suite": run.suite.id,
            "method": method,
            "condition": condition,
            "class": class_name,
            "metric": metric,
            "n_ok": drawn - row["undefined"],
            "n": planned,
            "note": row["note"] or "; ".join(message),
            "images_of": method,
            "failed": drawn < planned,
            "objects": len(run.objects(image_set)),
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=[*VALUE_COLUMNS, *HIDDEN])
