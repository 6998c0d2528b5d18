"""The frontier of quality and cost: the methods that are worth their cost.

A method is on the frontier where it is not worse than a white image, and no other is at least as
good for at most its cost. That is decided by the values in the digits that both are printed with;
whether a method off the frontier is really worse, or only happened to come out so, is decided by
pairing it with the cheaper ones, object by object (`bench.analysis.paired.Verdicts`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench.analysis.comparison import (
    Comparison,
    Estimate,
    Quality,
    best_first,
    better_by,
    candidates,
    is_better,
    worse_than_blank,
)
from bench.analysis.paired import Verdicts
from bench.catalogue.methods import FLOOR
from data_prep.clouds.conditions import CONDITIONS, Stride, Unchanged
from data_prep.scene import CLOUD_SIZE

Verdict = Literal[
    "frontier", "tied", "dominated", "below a white image", "reference", "claimed", "no value"
]


@dataclass(frozen=True)
class FrontierPoint:
    """One method by one metric, for clouds with so many views.

    cost_ms  milliseconds for a cloud with its views
    n_ok, n  images that exist, images that should
    verdict  frontier   no other candidate is at least as good for at most this cost
             dominated  one that costs no more is shown to be better
             tied       one that costs no more is at least as good, but not shown to be better
             below a white image  it is worse than `blank`, which costs nothing
             reference  no candidate: it sees the mesh, or no cloud
             claimed    no candidate: its author states the cost, on another machine
             no value   it failed on all objects
    baseline  the method that costs no more and decides the verdict: for a dominated method the best
             that shows it, for a tied one the best, below a white image `blank`; else empty
    """

    condition: str
    class_name: str
    views: int
    metric: str
    method: str
    cost_ms: Estimate
    quality: Estimate
    n_ok: int
    n: int
    verdict: Verdict
    baseline: str


def places(
    comparison: Comparison, metrics: Sequence[str], views: int, verdicts: Verdicts
) -> list[FrontierPoint]:
    """Return the places of all methods by these metrics, in their order and the comparison's."""
    costs = {method: comparison.cost_ms(method, views) for method in comparison.images}
    could = [method for method in candidates(costs) if method not in comparison.claimed]
    points = []
    for metric in metrics:
        qualities = comparison.qualities[metric]
        for method, quality in qualities.items():
            if method in comparison.claimed:
                verdict, baseline = "claimed", ""
            elif method not in could:
                verdict, baseline = "reference", ""
            else:
                rivals = {m: qualities[m] for m in could}
                verdict, baseline = _verdict(comparison, metric, method, rivals, costs, verdicts)
            points.append(
                FrontierPoint(
                    comparison.condition,
                    comparison.class_name,
                    views,
                    metric,
                    method,
                    costs[method],
                    quality.estimate,
                    *comparison.images[method],
                    verdict,
                    baseline,
                )
            )
    return points


def _verdict(
    comparison: Comparison,
    metric: str,
    method: str,
    rivals: Mapping[str, Quality],
    costs: Mapping[str, Estimate],
    verdicts: Verdicts,
) -> tuple[Verdict, str]:
    quality, cost = rivals[method], costs[method].value
    if not np.isfinite((cost, quality.estimate.value)).all():
        return "no value", ""
    if method in worse_than_blank(comparison.qualities[metric]):
        return "below a white image", FLOOR
    baselines = [
        other
        for other in best_first(rivals)
        if other != method and costs[other].value <= cost and not is_better(quality, rivals[other])
    ]
    if not any(costs[m].value < cost or is_better(rivals[m], quality) for m in baselines):
        return "frontier", ""
    shown_by = (m for m in baselines if verdicts.shows(m, method, metric, comparison))
    worse = next(shown_by, None)
    return ("tied", baselines[0]) if worse is None else ("dominated", worse)


@dataclass(frozen=True)
class SubsampledFrontier:
    """A method on clouds of fewer points.

    points   number in each cloud
    lost     quality that the full cloud has more, paired; over 0 where points help
    claimed  whether the cost is as its author states it
    """

    class_name: str
    metric: str
    method: str
    condition: str
    points: int
    cost_ms: Estimate
    quality: Estimate
    lost: Estimate
    claimed: bool = False


def thinned(
    comparisons: Sequence[Comparison], metrics: Sequence[str], views: int
) -> list[SubsampledFrontier]:
    """Return the candidates at the conditions that only take points away, beside the full cloud.

    The number of points is a parameter of every method. None for a class without the full cloud.
    """
    counted = [(c, points) for c in comparisons if (points := point_count(c.condition))]
    full = {c.class_name: c for c, points in counted if points == CLOUD_SIZE}
    frontiers = []
    for c, points in counted:
        whole = full.get(c.class_name)
        if whole is None or whole.objects != c.objects:
            continue
        for method in candidates(c.images):
            cost_ms = c.cost_ms(method, views)
            for metric in metrics:
                quality = c.qualities[metric][method]
                of_whole = whole.qualities[metric][method]
                lost = better_by(of_whole, quality)
                frontiers.append(
                    SubsampledFrontier(
                        c.class_name,
                        metric,
                        method,
                        c.condition,
                        points,
                        cost_ms,
                        quality.estimate,
                        lost,
                        method in c.claimed,
                    )
                )
    return frontiers


def point_count(condition_id: str) -> int | None:
    """Return the points of a cloud where a condition takes each n-th; None for other conditions."""
    for condition in CONDITIONS:
        if condition.id == condition_id and isinstance(condition.perturbation, Unchanged | Stride):
            step = getattr(condition.perturbation, "step", 1)
            return -(-CLOUD_SIZE // step)
    return None
