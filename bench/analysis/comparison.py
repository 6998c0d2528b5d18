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

from bench.analysis.digits import prints_better
from bench.analysis.intervals import clipped, mean_interval, median_interval
from bench.catalogue.images import ENTERED
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import is_mean, value_range
from bench.records.record import TIMES
from data_prep.arrays import Floats

if TYPE_CHECKING:
    from bench.analysis.scored_run import Run

NAN = float("nan")
Row = dict[Hashable, Any]  # of a comparison
ALL = "all"  # classes
OVERALL = "all conditions"
CLOUD = ["condition", "class", "method"]
VALUE = ["value", "ci_low", "ci_high"]
COST = ["cost_ms", "cost_ci_low", "cost_ci_high"]
COLUMNS = [
    *("condition", "class", "metric", "method", "images_of", *VALUE, "samples"),
    *("objects", *TIMES, "n_ok", "n", "claimed"),
]


class Estimate(NamedTuple):
    """A value with its 95 % interval over objects; NaN for what does not exist."""

    value: float
    low: float
    high: float


def compare(
    run: Run,
    metrics: Sequence[str],
    methods: Container[str] | None = None,
    among: Mapping[tuple[str, str], Container[str]] | None = None,
) -> pd.DataFrame:
    """Return methods of a run on the same objects of each class under each condition.

    Objects without true images are left out, and so is a class that has no others.

    Parameters
    ----------
    metrics : sequence of str
        Metrics of images that the jobs have, and set metrics that features exist for.
    methods : container of str, optional
        Methods that are compared, by default all; `blank` is needed, but may be left out.
    among : mapping, optional
        Objects that take part, by condition and class; by default all.

    Returns
    -------
    DataFrame
        A row for each condition, class, metric and method, in this order, each in that of the run:

        * `condition`, `class`, `metric`, `method`, and `images_of`, the method whose images they
          are, which may have fewer digits than the metric: another one of a chosen row
        * `value` with `ci_low` and `ci_high`: the mean over objects, or the distance
        * `samples`: float64 [G], each object's mean score, NaN where no image of it has one (an
          object without thin parts has no thin-recall). Of a Fréchet distance, which no single
          object has, the distance of all images without those of the object, or of each block of
          objects where there are many (`bench.metrics.frechet.object_blocks`)
        * `objects`: names of the G objects that have true images, sorted
        * `prepare_s`, `draw_s`: float64 [G], seconds for the cloud and for a view; where the method
          failed those until then and 0, NaN where unknown
        * `n_ok`, `n`: numbers of images that exist and that should
        * `claimed`: whether its author states the times; nothing here has measured them
    """
    claimed = run.manifest.get(ENTERED, ())
    rows = []
    for cell, (every, known) in _known_objects(run, among).items():
        objects = tuple(run.objects((FLOOR, *cell))[known].tolist())
        names = [method for method in every if methods is None or method in methods]
        about = {
            m: (
                *(objects, *(run.per_object((m, *cell), name)[known] for name in TIMES)),
                *(*run.images((m, *cell)), m in claimed),
            )
            for m in names
        }
        for metric in metrics:
            if is_mean(metric):
                of_objects = (run.per_object((m, *cell), metric, True)[known] for m in names)
                values = [(*mean_estimate(metric, samples), samples) for samples in of_objects]
            else:
                values = _distances(run, metric, cell, names, objects)
            rows += [
                (*cell, metric, m, m, *value, *about[m])
                for m, value in zip(names, values, strict=True)
            ]
    return pd.DataFrame(rows, columns=COLUMNS)


def known_objects(run: Run) -> dict[tuple[str, str], set[str]]:
    """Return the names of the objects with true images by condition and class."""
    known = _known_objects(run, None)
    return {cell: {*run.objects((FLOOR, *cell))[mask]} for cell, (_, mask) in known.items()}


def _known_objects(
    run: Run, among: Mapping[tuple[str, str], Container[str]] | None
) -> dict[tuple[str, str], tuple[list[str], Any]]:
    """Return by condition and class the methods, and a mask of the objects that take part."""
    by_cell: dict[tuple[str, str], list[str]] = {}
    for method, condition, class_name in run.cells:
        by_cell.setdefault((condition, class_name), []).append(method)
    known = {}
    for cell, every in by_cell.items():
        if FLOOR in every:
            mask = run.numbers((FLOOR, *cell))[0] > 0
            if among is not None:
                names = run.objects((FLOOR, *cell))
                mask &= np.array([name in among.get(cell, ()) for name in names], bool)
            if mask.any():
                known[cell] = every, mask
    return known


def mean_estimate(metric: str, samples: Floats) -> Estimate:
    """Return the mean of the objects that have a value [G], with its interval."""
    known = samples[~np.isnan(samples)]
    value = float(known.mean()) if len(known) else NAN
    return Estimate(value, *clipped(mean_interval(known), value_range(metric)))


def _distances(
    run: Run,
    metric: str,
    cell: tuple[str, str],
    methods: Sequence[str],
    objects: Sequence[str],
) -> list[tuple[float, float, float, Floats]]:
    """Return the Fréchet distances to the true images, with those without each block."""
    features, known = run.features[metric], set(objects)
    images = [image for image in features.images(FLOOR, *cell) if image[0] in known]
    if len(images) < 2:
        return [(NAN, NAN, NAN, np.full(len(objects), NAN))] * len(methods)
    distances = (features.distance((method, *cell), images) for method in methods)
    return [(d.value, *d.interval, d.leave_one_out) for d in distances]


def pooled(compared: pd.DataFrame) -> pd.DataFrame:
    """Return for each condition of several classes one comparison of all their objects, `ALL`.

    By metrics of images: every object counts alike, whatever its class. Without rows for one class.
    """
    if compared["class"].nunique() < 2:
        return compared[:0]

    def join(classes: pd.DataFrame) -> dict[str, Any]:
        names = zip(classes["class"], classes["objects"], strict=True)
        objects = tuple(
            f"{class_name}/{name}" for class_name, in_class in names for name in in_class
        )
        arrays = {name: np.concatenate([*classes[name]]) for name in ("samples", *TIMES)}
        return {"class": ALL, "objects": objects, **arrays}

    return _joined(compared, ["condition", "metric", "method"], join)


def over_conditions(compared: pd.DataFrame) -> pd.DataFrame:
    """Return the comparison by each object's mean over conditions, on objects that all have.

    Costs are those of the first condition. Image metrics only, and of one class.
    """
    shared = sorted(set.intersection(*map(set, compared["objects"])))
    conditions = compared["condition"].nunique()

    def join(rows: pd.DataFrame) -> dict[str, Any]:
        at = [pd.Index(names).get_indexer(pd.Index(shared)) for names in rows["objects"]]
        stacked = [values[i] for values, i in zip(rows["samples"], at, strict=True)]
        times = {name: rows[name].iloc[0][at[0]] for name in TIMES}
        # NaN where any condition has no value.
        samples = np.array(stacked).mean(axis=0)
        return {"condition": OVERALL, "objects": tuple(shared), "samples": samples, **times}

    everywhere = compared.groupby(["metric", "method"])["condition"].transform("nunique")
    return _joined(compared[everywhere == conditions], ["metric", "method"], join)


def _joined(
    compared: pd.DataFrame, by: list[str], join: Callable[[pd.DataFrame], dict[str, Any]]
) -> pd.DataFrame:
    """Return a row of each group of rows of image metrics, with the mean of its joined samples."""
    rows = []
    for _, group in compared[compared["metric"].map(is_mean)].groupby(by, sort=False):
        row = group.iloc[0].to_dict() | join(group)
        row |= zip(VALUE, mean_estimate(row["metric"], row["samples"]), strict=True)
        rows.append(row | {"n_ok": group["n_ok"].sum(), "n": group["n"].sum()})
    return pd.DataFrame(rows, columns=COLUMNS)


def with_costs(compared: pd.DataFrame, views: int) -> pd.DataFrame:
    """Return the rows with `views` and the milliseconds for a cloud with these views.

    `cost_ms` with `cost_ci_low` and `cost_ci_high` is the median over objects. A cloud that failed
    counts with the time that it took. NaN for a method without an image.
    """
    clouds = compared.drop_duplicates(CLOUD).reset_index(drop=True)
    costs = [
        _cost(1000.0 * (prepare_s + views * draw_s) if n_ok else np.array([NAN]))
        for prepare_s, draw_s, n_ok in zip(*(clouds[c] for c in (*TIMES, "n_ok")), strict=True)
    ]
    costed = clouds[CLOUD].join(pd.DataFrame(costs, columns=COST))
    return compared.merge(costed, how="left", on=CLOUD).assign(views=views)


def _cost(cost_ms: Floats) -> Estimate:
    known = np.isfinite(cost_ms)
    if not known.any():
        return Estimate(NAN, NAN, NAN)
    interval = median_interval(cost_ms[known], np.flatnonzero(known))
    return Estimate(float(np.median(cost_ms[known])), *interval)


def is_better(a: Mapping[Any, Any], b: Mapping[Any, Any]) -> bool:
    """Return whether a row is better than another in the digits that both are printed with."""
    return prints_better(a["metric"], a["value"], b["value"], a["images_of"], b["images_of"])


def best_first(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a metric that have a value, with `before`: how many print better."""
    known = rows[np.isfinite(rows["value"])]
    every = known.to_dict("records")
    before = [sum(is_better(other, row) for other in every) for row in every]
    return known.assign(before=before).sort_values("before", kind="stable")


def candidates(methods: Iterable[str]) -> list[str]:
    """Return the methods to choose from: they see no mesh, and do not draw without a cloud."""
    return [method for method in methods if role(method) not in ("ceiling", "floor")]


def worse_than_blank(rows: pd.DataFrame) -> set[str]:
    """Return the methods whose value, as printed, is worse than that of a white image.

    The rows are those of a metric in one class under one condition.
    """
    every = {row["method"]: row for row in rows.to_dict("records")}
    blank = every.get(FLOOR)
    return set() if blank is None else {m for m, row in every.items() if is_better(blank, row)}


def milliseconds(value: float) -> str:
    """Return milliseconds with about three digits: 0.42, 7.3, 61.4, 1240."""
    if not math.isfinite(value):
        return "-"
    digits = 2 if value < 1 else 1 if value < 100 else 0
    return f"{value:.{digits}f}"
