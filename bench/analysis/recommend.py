"""The method to take for a budget or a quality, and what that choice costs.

A method is affordable where its median cost is within the budget.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.comparison import (
    NAN,
    Comparison,
    Estimate,
    best_first,
    candidates,
    is_better,
    worse_than_blank,
)
from bench.analysis.intervals import mean_interval
from bench.analysis.paired import Verdicts
from bench.catalogue.metrics import higher_is_better
from data_prep.arrays import Floats
from data_prep.failures import BadInput

SSIM = "ssim"  # the metric of a required quality
ALTERNATIVES = 3


@dataclass(frozen=True)
class Requirements:
    """The limits of a choice; None for one that does not matter.

    views      number of images of a cloud
    budget_ms  most milliseconds for a cloud with all its images
    min_ssim   least mean over objects
    """

    views: int
    budget_ms: float | None = None
    min_ssim: float | None = None


def make_request(views: int, budget_ms: float | None, min_ssim: float | None) -> Requirements:
    """Return a request. Raises BadInput for one without a limit, and for values out of range."""
    if budget_ms is None and min_ssim is None:
        raise BadInput("nothing to go by; give --budget-ms, --min-ssim, or both")
    if views < 1:
        raise BadInput(f"--views {views}: must be at least 1")
    if budget_ms is not None and not 0 < budget_ms < math.inf:
        raise BadInput(f"--budget-ms {budget_ms:g}: must be a number over 0")
    if min_ssim is not None and not -1 <= min_ssim <= 1:
        raise BadInput(f"--min-ssim {min_ssim:g}: must be from -1 to 1")
    return Requirements(views, budget_ms, min_ssim)


@dataclass(frozen=True)
class MethodOption:
    """A method to choose, and its quality by one metric.

    gap        how much worse it is than the best affordable method, with the interval that decides
    qualities  by each metric of the comparison
    """

    method: str
    cost_ms: Estimate
    quality: Estimate
    n_ok: int
    n: int
    gap: Estimate
    qualities: Mapping[str, Estimate]


@dataclass(frozen=True)
class Advice:
    """The answer to a request by one metric under one condition.

    best, next    methods within the budget: the best by its mean, and those after it, the cheapest
                  of those that print equal; None and empty where nothing is affordable
    affordable    number of methods within the budget
    undecided     those of them that the best is not shown to be ahead of, the best first
    below_blank   methods within the budget that are no choice, because a white image is better
    regret        quality that an oracle, which takes the best affordable method for each object,
                  has more than the best: mean over objects
    regret_blind  the same where each object's method is chosen by the other objects, as that of a
                  new cloud has to be; NaN with a single object
    by_mean       the cheapest whose mean is as required, within the budget or not; by a metric
                  other than SSIM, of which nothing is required, the cheapest
    significant   the cheapest of which even the lower end of the interval is as required
    cheapest, best_of_all  the nearest methods where nothing is affordable or good enough
    """

    metric: str
    condition: str
    class_name: str
    objects: int
    best: MethodOption | None
    next: tuple[MethodOption, ...]
    affordable: int
    undecided: tuple[str, ...]
    below_blank: tuple[str, ...]
    regret: Estimate
    regret_blind: Estimate
    by_mean: MethodOption | None
    significant: MethodOption | None
    cheapest: MethodOption | None
    best_of_all: MethodOption | None


@dataclass(frozen=True)
class Recommendation:
    """The answer to a request under one condition.

    by_metric  advice by each metric: where they name different methods, which one is better depends
               on the metric, and no average would say so
    by_ssim    advice where a least SSIM is required; else None
    """

    by_metric: tuple[Advice, ...]
    by_ssim: Advice | None

    def meets(self, request: Requirements) -> bool:
        """Return whether each metric has a method within the budget, and one is good enough."""
        if request.min_ssim is None:
            return all(advice.best is not None for advice in self.by_metric)
        if request.budget_ms is not None and not all(advice.best for advice in self.by_metric):
            return False
        best = self.by_ssim.best if self.by_ssim else None
        return best is not None and best.quality.value >= request.min_ssim


def recommend(
    comparison: Comparison, request: Requirements, metrics: Sequence[str], verdicts: Verdicts
) -> Recommendation:
    """Return the advice of a comparison by each of these metrics of images, which it has to have.

    It has to have `ssim`, too, where a least SSIM is required.
    """
    return Recommendation(
        tuple(advise(comparison, request, metric, verdicts) for metric in metrics),
        None if request.min_ssim is None else advise(comparison, request, SSIM, verdicts),
    )


def advise(
    comparison: Comparison, request: Requirements, metric: str, verdicts: Verdicts
) -> Advice:
    """Return the advice of a comparison by a metric of images.

    Methods without a cost (they failed on all objects), those whose cost is claimed, and those
    worse than a white image are no choice. Of methods that print equal the cheaper one is
    preferred.
    """
    qualities = comparison.qualities[metric]
    measured = [m for m in candidates(qualities) if m not in comparison.claimed]
    costs = {m: comparison.cost_ms(m, request.views) for m in measured}
    below = worse_than_blank(qualities)
    before = best_first({m: qualities[m] for m in measured})
    valued = [m for m, cost in costs.items() if np.isfinite(cost.value) and m in before]
    usable = [m for m in valued if m not in below]
    by_quality = sorted(usable, key=lambda m: (before[m], costs[m].value))
    by_cost = sorted(usable, key=lambda m: (costs[m].value, before[m]))
    budget = np.inf if request.budget_ms is None else request.budget_ms
    affordable = [m for m in by_quality if costs[m].value <= budget]
    distinct: list[str] = []
    for method in affordable:  # of those that print equal the first
        if not distinct or is_better(qualities[distinct[-1]], qualities[method]):
            distinct.append(method)

    def choice(method: str) -> MethodOption:
        gap = Estimate(NAN, NAN, NAN)
        if affordable:
            cell = metric, comparison.condition, comparison.class_name
            gap = verdicts.difference(method, affordable[0], *cell).lead
        images = comparison.images[method]
        every = {name: by[method].estimate for name, by in comparison.qualities.items()}
        return MethodOption(method, costs[method], every[metric], *images, gap, every)

    required = -np.inf if request.min_ssim is None or metric != SSIM else request.min_ssim
    by_mean = [m for m in by_cost if qualities[m].estimate.value >= required]
    significant = [m for m in by_cost if qualities[m].estimate.low >= required]
    sign = 1.0 if higher_is_better(metric) else -1.0
    scores = np.array([sign * qualities[m].per_object for m in affordable])
    scores = scores[:, np.isfinite(scores).all(axis=0)] if affordable else scores
    return Advice(
        metric=metric,
        condition=comparison.condition,
        class_name=comparison.class_name,
        objects=len(comparison.objects),
        best=choice(affordable[0]) if affordable else None,
        next=tuple(map(choice, distinct[1 : 1 + ALTERNATIVES])),
        affordable=len(affordable),
        undecided=tuple(
            m for m in affordable[1:] if not verdicts.shows(affordable[0], m, metric, comparison)
        ),
        below_blank=tuple(m for m in valued if m in below and costs[m].value <= budget),
        regret=_regret(scores, chosen=np.zeros(scores.shape[-1], np.intp)),
        regret_blind=_regret(scores, chosen=_chosen_by_the_others(scores)),
        by_mean=choice(by_mean[0]) if by_mean else None,
        significant=choice(significant[0]) if significant else None,
        cheapest=choice(by_cost[0]) if by_cost else None,
        best_of_all=choice(by_quality[0]) if by_quality else None,
    )


def _regret(scores: Floats, chosen: NDArray[np.intp]) -> Estimate:
    """Return the regret of scores [M, G]: the best of each object less the chosen method's [G]."""
    if not len(scores) or not len(chosen):
        return Estimate(NAN, NAN, NAN)
    lost = scores.max(axis=0) - scores[chosen, np.arange(len(chosen))]
    low, high = mean_interval(lost)
    return Estimate(float(lost.mean()), max(low, 0.0), high)  # NaN stays


def _chosen_by_the_others(scores: Floats) -> NDArray[np.intp]:
    """Return for each object the method [G] with the best mean over the others, if any.

    Among equals it is the first: scores [M, G] come in the order of preference.
    """
    if not len(scores) or scores.shape[1] < 2:
        return np.zeros(0, np.intp)
    return (scores.sum(axis=1, keepdims=True) - scores).argmax(axis=0)


def at_condition(comparisons: Sequence[Comparison], condition: str | None) -> list[Comparison]:
    """Return the comparisons at a condition; None: all.

    Raises BadInput for an unknown one, and where no object has scores.
    """
    if not comparisons:
        raise BadInput(
            "no object of this run has scores (0), as all true images failed; 'bench report DIR' "
            "shows why"
        )
    chosen = [c for c in comparisons if condition in (None, c.condition)]
    if not chosen:
        known = ", ".join(dict.fromkeys(c.condition for c in comparisons))
        raise BadInput(f"--condition {condition}: not in this run; there are {known}")
    return chosen
