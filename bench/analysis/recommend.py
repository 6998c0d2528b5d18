"""Which method to take: by a budget, by a quality, and what that choice costs.

Pure functions of comparisons. "Affordable" is a method whose median cost is within the budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.comparison import (
    NAN,
    Comparison,
    Estimate,
    Floats,
    candidates,
    lead,
)
from bench.analysis.intervals import mean_interval
from data_prep.failures import BadInput

METRIC = "ssim"
ALTERNATIVES = 3


@dataclass(frozen=True)
class Request:
    """What is asked for; None where it does not matter.

    views      images of a cloud
    budget_ms  for a cloud with all its images
    min_ssim   mean over objects
    """

    views: int
    budget_ms: float | None = None
    min_ssim: float | None = None


@dataclass(frozen=True)
class Choice:
    """A method that one could take. behind: how much worse than the best affordable one, paired."""

    method: str
    cost_ms: Estimate
    ssim: Estimate
    n_ok: int
    n: int
    behind: Estimate


@dataclass(frozen=True)
class Advice:
    """The answer to a request under one condition.

    best, next    within the budget: the best by its mean, and those after it, the cheapest of those
                  that print equal; None and none where nothing is affordable
    affordable    number of methods
    regret        what an oracle, which takes the best affordable method for each object, has more
                  than the best: mean over objects
    regret_blind  the same where each object's method is chosen by the other objects, as that of a
                  new cloud has to be; NaN with a single object
    on_average    the cheapest whose mean ssim is what was required, within the budget or not
    surely        the cheapest of which even the lower end of the interval is
    cheapest, finest  of all: what comes nearest where nothing is affordable or good enough
    """

    condition: str
    class_name: str
    objects: int
    best: Choice | None
    next: tuple[Choice, ...]
    affordable: int
    regret: Estimate
    regret_blind: Estimate
    on_average: Choice | None
    surely: Choice | None
    cheapest: Choice | None
    finest: Choice | None

    def meets(self, request: Request) -> bool:
        """Whether one method is both affordable and, on average, good enough."""
        if self.best is None or request.min_ssim is None:
            return self.best is not None
        return self.best.ssim.value >= request.min_ssim


def advise(comparison: Comparison, request: Request) -> Advice:
    """Advice by one comparison, which has to have the metric `ssim`.

    Methods without a cost (they failed on all objects) are no choice. Of methods that print equal
    the cheaper one is preferred.
    """
    qualities = comparison.qualities[METRIC]
    costs = {m: comparison.cost_ms(m, request.views) for m in candidates(qualities)}
    usable = [m for m, cost in costs.items() if np.isfinite((cost.value, qualities[m].rank)).all()]
    by_quality = sorted(usable, key=lambda m: (-qualities[m].rank, costs[m].value))
    by_cost = sorted(usable, key=lambda m: (costs[m].value, -qualities[m].rank))
    budget = np.inf if request.budget_ms is None else request.budget_ms
    affordable = [m for m in by_quality if costs[m].value <= budget]
    distinct = list({qualities[m].rank: m for m in reversed(affordable)}.values())[::-1]

    def choice(method: str) -> Choice:
        behind = Estimate(NAN, NAN, NAN)
        if affordable:
            behind = lead(qualities[affordable[0]], qualities[method])
        images = comparison.images[method]
        return Choice(method, costs[method], qualities[method].estimate, *images, behind)

    wanted = -np.inf if request.min_ssim is None else request.min_ssim
    on_average = [m for m in by_cost if qualities[m].estimate.value >= wanted]
    surely = [m for m in by_cost if qualities[m].estimate.low >= wanted]
    scores = np.array([qualities[m].per_object for m in affordable])
    return Advice(
        condition=comparison.condition,
        class_name=comparison.class_name,
        objects=len(comparison.objects),
        best=choice(affordable[0]) if affordable else None,
        next=tuple(map(choice, distinct[1 : 1 + ALTERNATIVES])),
        affordable=len(affordable),
        regret=_regret(scores, chosen=np.zeros(len(comparison.objects), np.intp)),
        regret_blind=_regret(scores, chosen=_chosen_by_the_others(scores)),
        on_average=choice(on_average[0]) if on_average else None,
        surely=choice(surely[0]) if surely else None,
        cheapest=choice(by_cost[0]) if by_cost else None,
        finest=choice(by_quality[0]) if by_quality else None,
    )


def _regret(scores: Floats, chosen: NDArray[np.intp]) -> Estimate:
    """Of scores [M, G]: the best of each object less that of the method chosen [G] for it."""
    if not len(scores) or not len(chosen):
        return Estimate(NAN, NAN, NAN)
    lost = scores.max(axis=0) - scores[chosen, np.arange(len(chosen))]
    low, high = mean_interval(lost)
    return Estimate(float(lost.mean()), max(low, 0.0), high)  # NaN stays


def _chosen_by_the_others(scores: Floats) -> NDArray[np.intp]:
    """For each object the method [G] with the best mean over the others; none of a single one.

    Of equals the first: scores [M, G] come in the order of preference.
    """
    if not len(scores) or scores.shape[1] < 2:
        return np.zeros(0, np.intp)
    return (scores.sum(axis=1, keepdims=True) - scores).argmax(axis=0)


def at_condition(comparisons: Sequence[Comparison], condition: str | None) -> list[Comparison]:
    """Those at a condition; None: all. Raises BadInput for one that the run does not have."""
    chosen = [c for c in comparisons if condition in (None, c.condition)]
    if not chosen:
        there = ", ".join(dict.fromkeys(c.condition for c in comparisons))
        raise BadInput(f"--condition {condition}: not in this run; there are {there}")
    return chosen
