"""Scores of meshes: means over objects, and whether they order methods and objects as images do.

A frame of meshes has a row for each method, condition and object: the names in JOB, a column for
each of SURFACE_METRICS, and `note`, why there is no mesh.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import rankdata

from bench.analysis.compare import ALL, NAN
from bench.analysis.intervals import FEWEST, NO_INTERVAL, RESAMPLES, SEED, mean_interval
from bench.analysis.paper import AVERAGE
from bench.catalogue.metrics import column, higher_is_better
from bench.metrics.surface_distance import SURFACE_METRICS
from bench.records.job import JOB
from data_prep.arrays import Floats

_SPREAD = ["ci_low", "ci_high", "n_ok", "n"]
_OVER = ("methods", "objects")  # what is ranked
_FEWEST_METHODS = 3  # of two, one is the better, whatever the metric


def surface_rows(meshes: pd.DataFrame) -> pd.DataFrame:
    """Return the mean over classes of the means over objects, by condition, method and metric.

    `n_ok` meshes of `n` have scores.
    """
    rows = []
    class_name = AVERAGE if meshes["class"].nunique() > 1 else meshes["class"].iloc[0]
    for (condition, method), every in meshes.groupby(["condition", "method"], sort=False):
        scored = every[every["note"] == ""]
        counts = every.loc[every["note"] != "", "note"].value_counts()
        note = "; ".join(f"{count} x {reason}" for reason, count in counts.items())
        for metric in SURFACE_METRICS:
            samples = [values.to_numpy() for _, values in scored.groupby("class")[metric]]
            value = float(np.mean([of_class.mean() for of_class in samples])) if samples else NAN
            estimate = value, *mean_interval(*samples), len(scored), len(every)
            rows.append((method, condition, class_name, metric, *estimate, note))
    columns = ["method", "condition", "class", "metric", "value", "ci_low", "ci_high"]
    return pd.DataFrame(rows, columns=[*columns, "n_ok", "n", "note"])


def rank_rows(
    meshes: pd.DataFrame, jobs: pd.DataFrame, image_metrics: Sequence[str]
) -> pd.DataFrame:
    """Return Spearman's correlation of each surface metric with each metric of images.

    jobs  of the run, as `bench.analysis.run.Run` has them

    It is positive where better surfaces have better images. Over "methods" their means are ranked,
    classes counting alike. Over "objects" these are ranked within each method, and the
    correlations are averaged over the methods. Of `n` objects `n_ok` are used: those with all
    scores by all methods. Fewer than 3 methods give no rows, fewer than 8 objects no intervals;
    these are of a bootstrap of the objects of each class.
    """
    for metric in image_metrics:
        name = column(metric)
        jobs = jobs.assign(**{metric: jobs[f"{name}_sum"] / jobs[f"{name}_count"]})
    scored = meshes.merge(jobs[[*JOB, *image_metrics]], on=JOB)
    every, rows = (*SURFACE_METRICS, *image_metrics), []
    for condition, at_condition in scored.groupby("condition", sort=False):
        wide = at_condition.pivot(index=JOB[2:], columns="method", values=list(every))
        known = wide.dropna()
        classes = known.index.get_level_values("class").to_numpy()
        signs = [1 if higher_is_better(metric) else -1 for metric in every]
        scores = np.stack(
            [sign * known[m].to_numpy().T for sign, m in zip(signs, every, strict=True)]
        )
        methods, objects = scores.shape[1:]
        if methods < _FEWEST_METHODS or not objects:
            continue
        correlations = _correlations(scores, classes)
        drawn = [_correlations(scores[..., s], classes[s]) for s in _resamples(classes)]
        low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
        for over, surface, image in product(_OVER, SURFACE_METRICS, image_metrics):
            place = _OVER.index(over), every.index(surface), every.index(image)
            interval = (low[place], high[place]) if objects >= FEWEST else NO_INTERVAL
            about = (over, image, surface, condition, ALL, "spearman", correlations[place])
            rows.append((*about, *interval, objects, len(wide), methods, ""))
    columns = ["over", "image_metric", "surface_metric", "condition", "class", "metric", "value"]
    return pd.DataFrame(rows, columns=[*columns, *_SPREAD, "methods", "note"])


def _resamples(classes: NDArray[Any]) -> Iterator[NDArray[np.intp]]:
    """Yield the places of objects that are drawn within each class."""
    rng = np.random.default_rng(SEED)
    places = [np.flatnonzero(classes == name) for name in np.unique(classes)]
    for _ in range(RESAMPLES):
        yield np.concatenate([rng.choice(members, len(members)) for members in places])


def _correlations(scores: Floats, classes: NDArray[Any]) -> Floats:
    """Return the rank correlations [2, K, K] of K metrics, over methods and over objects.

    scores  [K, M methods, G objects]; where all are equal, correlations are NaN
    """
    means = np.mean([scores[..., classes == n].mean(-1) for n in np.unique(classes)], axis=0)
    ranks = rankdata(scores, axis=2)
    ranks -= ranks.mean(axis=2, keepdims=True)
    with np.errstate(invalid="ignore"):  # where all are equal there is no order
        unit = ranks / np.linalg.norm(ranks, axis=2, keepdims=True)
        of_methods = np.corrcoef(rankdata(means, axis=1))
    return np.stack([of_methods, np.einsum("kmg,lmg->kl", unit, unit) / scores.shape[1]])
