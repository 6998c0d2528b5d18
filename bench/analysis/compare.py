"""Cost and quality of methods on the same objects, object by object: a frame.

A failed image is scored as a blank one, as in the column `failures_as_blank` of the tables: whoever
chooses a method gets its failures too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.digits import prints_better
from bench.analysis.intervals import clipped, mean_interval, median_interval
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import is_mean, value_range
from bench.entered.claims import ENTERED
from bench.records.job import TIMES
from data_prep.arrays import Floats

if TYPE_CHECKING:
    from bench.analysis.run import Run
    from bench.analysis.sets import ImageSet

NAN = float("nan")
Row = dict[Hashable, Any]  # a row of a comparison: its values by the names of the columns
CloudSet = tuple[str, str]  # condition and class: the clouds that all methods are compared on
ALL = "all"  # in the column `class`: the objects of all classes together
OVERALL = "all conditions"  # in the column `condition`: each object's mean over conditions
IMAGE_SET = ["condition", "class", "method"]  # columns that tell the images of a method apart
VALUE = ["value", "ci_low", "ci_high"]  # columns of a value and of its 95 % interval
COST = ["cost_ms", "cost_ci_low", "cost_ci_high"]  # milliseconds, with their 95 % interval
COLUMNS = [
    "condition",
    "class",
    "metric",
    "method",
    "images_of",
    *VALUE,
    "samples",
    "objects",
    *TIMES,
    "n_ok",
    "n",
    "claimed",
]


class Estimate(NamedTuple):
    """A value with its 95 % interval over objects; NaN where there is no value or no interval."""

    value: float
    low: float
    high: float


def compare(
    run: Run,
    metrics: Sequence[str],
    methods: Container[str] | None = None,
    among: Mapping[CloudSet, Container[str]] | None = None,
) -> pd.DataFrame:
    """Compare methods of a run on the same objects of each class under each condition.

    Objects without true images are left out, and so is a class in which no object has any.

    Parameters
    ----------
    metrics : sequence of str
        Metrics of images that the jobs were scored by, and distances between sets of images whose
        features the run has kept.
    methods : container of str, optional
        Methods that are compared, by default all. The run must have `blank`, which need not be
        among them.
    among : mapping, optional
        Objects that take part, by condition and class; by default all.

    Returns
    -------
    DataFrame
        A row for each condition, class, metric and method, sorted by these four columns, whose
        values are in the order of the run:

        * `condition`, `class`, `metric` and `method`
        * `images_of`: the method that drew the images. It differs from `method` only in a row that
          chooses a method, such as `best-classical`, and decides how many digits are printed
        * `value` with `ci_low` and `ci_high`: the mean over objects, or the distance between sets
        * `samples`: float64 [G], what the interval is made from. By a metric of images it is the
          mean score of each object, NaN where none of its images has a score (an object without
          thin parts has no thin-recall). A Fréchet distance has no value for a single object: it
          is the distance of all images but those of one object, or of one block of objects where
          there are many (`bench.metrics.frechet.object_blocks`)
        * `objects`: names of the G objects that have true images, sorted
        * `prepare_s`, `draw_s`: float64 [G], seconds to prepare the cloud and to draw a view. Where
          the method failed, `prepare_s` is the time until then and `draw_s` is 0; NaN where the
          time is unknown
        * `n_ok`, `n`: numbers of images that exist, and that should exist
        * `claimed`: whether the times are those that the method's author states, not measured here
    """
    claimed = run.manifest.get(ENTERED, ())
    rows = []
    for cloud_set, (every, known) in _known_objects(run, among).items():
        names = [method for method in every if methods is None or method in methods]
        about = {method: _about_images(run, method, cloud_set, known, claimed) for method in names}
        for metric in metrics:
            if is_mean(metric):
                values = [
                    _mean_of_objects(run, metric, (method, *cloud_set), known) for method in names
                ]
            else:
                objects = run.objects((FLOOR, *cloud_set))[known].tolist()
                values = _distances(run, metric, cloud_set, names, objects)
            for method, value in zip(names, values, strict=True):
                key = {"metric": metric, "method": method, "images_of": method}
                rows.append(key | value | about[method])
    return pd.DataFrame(rows, columns=COLUMNS)


def compared(
    run: Run,
    metrics: Sequence[str],
    methods: Iterable[str] | None = None,
    among: Mapping[CloudSet, Container[str]] | None = None,
) -> pd.DataFrame:
    """Return `compare` of a run, by default of all its methods; the run keeps it for further calls.

    A comparison of some objects alone (`among`) is not kept.
    """
    names = frozenset(run.manifest["methods"] if methods is None else methods)
    if among is not None:
        return compare(run, metrics, names, among)
    key = tuple(metrics), names
    if key not in run.comparisons:
        run.comparisons[key] = compare(run, metrics, names)
    return run.comparisons[key]


def _about_images(
    run: Run, method: str, cloud_set: CloudSet, known: NDArray[np.bool_], claimed: Container[str]
) -> dict[str, Any]:
    """Return the columns that a method has alike by every metric: objects, times, numbers."""
    condition, class_name = cloud_set
    image_set = (method, condition, class_name)
    drawn, planned = run.images(image_set)
    times = {name: run.per_object(image_set, name)[known] for name in TIMES}
    return {
        "condition": condition,
        "class": class_name,
        "objects": tuple(run.objects((FLOOR, *cloud_set))[known].tolist()),
        **times,
        "n_ok": drawn,
        "n": planned,
        "claimed": method in claimed,
    }


def known_objects(run: Run) -> dict[CloudSet, set[str]]:
    """Return the names of the objects with true images by condition and class."""
    known = _known_objects(run, None)
    return {
        cloud_set: {*run.objects((FLOOR, *cloud_set))[mask]}
        for cloud_set, (_, mask) in known.items()
    }


def _known_objects(
    run: Run, among: Mapping[CloudSet, Container[str]] | None
) -> dict[CloudSet, tuple[list[str], NDArray[np.bool_]]]:
    """Return by condition and class the methods, and a mask of the objects that take part.

    `blank` fails only where true images have failed: it has images of the objects that have them.
    """
    methods_of: dict[CloudSet, list[str]] = {}
    for method, condition, class_name in run.image_sets:
        methods_of.setdefault((condition, class_name), []).append(method)
    known = {}
    for cloud_set, methods in methods_of.items():
        if FLOOR not in methods:
            continue
        of_blank = (FLOOR, *cloud_set)
        drawn, _ = run.numbers(of_blank)
        mask = drawn > 0
        if among is not None:
            chosen = among.get(cloud_set, ())
            mask &= np.array([name in chosen for name in run.objects(of_blank)], bool)
        if mask.any():
            known[cloud_set] = methods, mask
    return known


def _mean_of_objects(
    run: Run, metric: str, image_set: ImageSet, known: NDArray[np.bool_]
) -> dict[str, Any]:
    """Return the mean over objects by a metric of images, a failed image scored as a blank one."""
    samples = run.per_object(image_set, metric, blanks=True)[known]
    return _value_columns(mean_estimate(metric, samples), samples)


def _value_columns(estimate: Estimate, samples: Floats) -> dict[str, Any]:
    """Return a value with its interval, and what the interval is made from, by column."""
    return dict(zip(VALUE, estimate, strict=True)) | {"samples": samples}


def mean_estimate(metric: str, samples: Floats) -> Estimate:
    """Return the mean of the objects that have a value [G], with its interval."""
    known = samples[~np.isnan(samples)]
    value = float(known.mean()) if len(known) else NAN
    return Estimate(value, *clipped(mean_interval(known), value_range(metric)))


def _distances(
    run: Run,
    metric: str,
    cloud_set: CloudSet,
    methods: Sequence[str],
    objects: Sequence[str],
) -> list[dict[str, Any]]:
    """Return each method's Fréchet distance to the true images, with its leave-one-out values."""
    features, known = run.features[metric], set(objects)
    images = [image for image in features.images(FLOOR, *cloud_set) if image[0] in known]
    if len(images) < 2:
        nothing = _value_columns(Estimate(NAN, NAN, NAN), np.full(len(objects), NAN))
        return [nothing for _ in methods]
    values = []
    for method in methods:
        distance = features.distance((method, *cloud_set), images)
        low, high = distance.interval
        estimate = Estimate(distance.value, low, high)
        values.append(_value_columns(estimate, distance.leave_one_out))
    return values


def pooled(compared: pd.DataFrame) -> pd.DataFrame:
    """Return the comparison of all objects together, whatever their class, at each condition.

    It has the metrics of images alone, and `ALL` in the column `class`: every object counts alike.
    A comparison of a single class gives no rows.
    """
    if compared["class"].nunique() < 2:
        return compared[:0]

    def join(classes: pd.DataFrame) -> dict[str, Any]:
        objects: list[str] = []
        for class_name, names in zip(classes["class"], classes["objects"], strict=True):
            objects += [f"{class_name}/{name}" for name in names]
        arrays = {name: np.concatenate([*classes[name]]) for name in ("samples", *TIMES)}
        return {"class": ALL, "objects": tuple(objects), **arrays}

    return _joined(compared, ["condition", "metric", "method"], join)


def over_conditions(compared: pd.DataFrame) -> pd.DataFrame:
    """Return the comparison by each object's mean over conditions, of the objects that all have.

    compared  a comparison of one class; only its metrics of images are taken

    Times are those at the first condition.
    """
    shared = sorted(set.intersection(*map(set, compared["objects"])))
    conditions = compared["condition"].nunique()

    def join(rows: pd.DataFrame) -> dict[str, Any]:
        at = [pd.Index(names).get_indexer(pd.Index(shared)) for names in rows["objects"]]
        stacked = [values[i] for values, i in zip(rows["samples"], at, strict=True)]
        times = {name: rows[name].iloc[0][at[0]] for name in TIMES}
        samples = np.array(stacked).mean(axis=0)  # NaN where any condition has no value
        return {"condition": OVERALL, "objects": tuple(shared), "samples": samples, **times}

    everywhere = compared.groupby(["metric", "method"])["condition"].transform("nunique")
    return _joined(compared[everywhere == conditions], ["metric", "method"], join)


def _joined(
    compared: pd.DataFrame, by: list[str], join: Callable[[pd.DataFrame], dict[str, Any]]
) -> pd.DataFrame:
    """Return one row for each group of rows, with the value of its joined samples.

    compared  its metrics of images are taken, its distances left out
    by        columns whose values make a group
    join      returns the columns that are not as in the group's first row, with `samples`
    """
    rows = []
    for _, group in compared[compared["metric"].map(is_mean)].groupby(by, sort=False):
        row = group.iloc[0].to_dict() | join(group)
        estimate = mean_estimate(row["metric"], row["samples"])
        row |= _value_columns(estimate, row["samples"])
        rows.append(row | {"n_ok": group["n_ok"].sum(), "n": group["n"].sum()})
    return pd.DataFrame(rows, columns=COLUMNS)


def with_costs(compared: pd.DataFrame, views: int) -> pd.DataFrame:
    """Return the rows with `views`, and the cost of a cloud of which so many views are drawn.

    `cost_ms` with `cost_ci_low` and `cost_ci_high` is the median over objects, in milliseconds. A
    cloud that failed counts with the time that it took. NaN for a method without an image.
    """
    image_sets = compared.drop_duplicates(IMAGE_SET).reset_index(drop=True)
    costs = []
    for row in image_sets.to_dict("records"):
        prepare_s, draw_s = (row[name] for name in TIMES)
        if row["n_ok"]:
            costs.append(_median_cost(1000.0 * (prepare_s + views * draw_s)))
        else:
            costs.append(Estimate(NAN, NAN, NAN))
    costed = image_sets[IMAGE_SET].join(pd.DataFrame(costs, columns=COST))
    return compared.merge(costed, how="left", on=IMAGE_SET).assign(views=views)


def _median_cost(cost_ms: Floats) -> Estimate:
    """Return the median of the costs of objects [G], of those that are known, with its interval."""
    known = np.isfinite(cost_ms)
    if not known.any():
        return Estimate(NAN, NAN, NAN)
    interval = median_interval(cost_ms[known], np.flatnonzero(known))
    return Estimate(float(np.median(cost_ms[known])), *interval)


def is_better(a: Mapping[Any, Any], b: Mapping[Any, Any]) -> bool:
    """Return whether row `a` is better than row `b` in the digits that both are printed with."""
    return prints_better(a["metric"], a["value"], b["value"], a["images_of"], b["images_of"])


def best_first(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of one metric that have a value, the best first.

    Their column `before` is the number of rows that are better in the digits that are printed.
    """
    known = rows[np.isfinite(rows["value"])]
    every = known.to_dict("records")

    def better_ones(row: Row) -> int:
        return sum(is_better(other, row) for other in every)

    before = [better_ones(row) for row in every]
    return known.assign(before=before).sort_values("before", kind="stable")


def candidates(methods: Iterable[str]) -> list[str]:
    """Return the methods that a user can choose: all but those that see the mesh or no cloud."""
    return [method for method in methods if role(method) not in ("ceiling", "floor")]


def worse_than_blank(rows: pd.DataFrame) -> set[str]:
    """Return the methods whose value, as printed, is worse than that of a white image.

    The rows are those of one metric, of one class under one condition. None is worse where they
    have no `blank`.
    """
    by_method = {row["method"]: row for row in rows.to_dict("records")}
    blank = by_method.get(FLOOR)
    if blank is None:
        return set()
    return {method for method, row in by_method.items() if is_better(blank, row)}


def milliseconds(value: float) -> str:
    """Return milliseconds with about three digits: 0.42, 7.3, 61.4, 1240."""
    if not math.isfinite(value):
        return "-"
    if value < 1:
        return f"{value:.2f}"
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
