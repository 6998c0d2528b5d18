"""Which method to take: by a budget, by the quality wished for, and what choosing so gives away.

Pure functions of comparisons. "Affordable" is a method whose median cost is within the budget.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.comparison import (
    NAN,
    Comparison,
    Estimate,
    Floats,
    candidates,
    decimals,
    lead,
    milliseconds,
)
from bench.analysis.intervals import mean_interval
from bench.tables.markdown import visible
from data_prep.failures import BadInput

METRIC = "ssim"
ALTERNATIVES = 3


@dataclass(frozen=True)
class Wish:
    """What is asked for; None where it does not matter.

    views      pictures of a cloud
    budget_ms  for a cloud with all its pictures
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
    """What the wish comes to under one condition.

    best, next    within the budget: the best by its mean, and those after it, the cheapest of those
                  that print equal; None and none where nothing is affordable
    affordable    number of methods
    regret        what an oracle, which takes the best affordable method for each object, has more
                  than the best: mean over objects
    regret_blind  the same where each object's method is chosen by the other objects, as that of a
                  new cloud has to be; NaN with a single object
    on_average    the cheapest whose mean ssim is what was wished, within the budget or not
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

    def meets(self, wish: Wish) -> bool:
        """Whether one method is both affordable and, on average, good enough."""
        if self.best is None or wish.min_ssim is None:
            return self.best is not None
        return self.best.ssim.value >= wish.min_ssim


def advise(comparison: Comparison, wish: Wish) -> Advice:
    """Advice by one comparison, which has to have the metric `ssim`.

    Methods without a cost (they failed on all objects) are no choice. Of methods that print equal
    the cheaper one is preferred.
    """
    qualities = comparison.qualities[METRIC]
    costs = {m: comparison.cost_ms(m, wish.views) for m in candidates(qualities)}
    usable = [m for m, cost in costs.items() if np.isfinite((cost.value, qualities[m].rank)).all()]
    by_quality = sorted(usable, key=lambda m: (-qualities[m].rank, costs[m].value))
    by_cost = sorted(usable, key=lambda m: (costs[m].value, -qualities[m].rank))
    budget = np.inf if wish.budget_ms is None else wish.budget_ms
    affordable = [m for m in by_quality if costs[m].value <= budget]
    distinct = list({qualities[m].rank: m for m in reversed(affordable)}.values())[::-1]

    def choice(method: str) -> Choice:
        behind = Estimate(NAN, NAN, NAN)
        if affordable:
            behind = lead(qualities[affordable[0]], qualities[method])
        pictures = comparison.pictures[method]
        return Choice(method, costs[method], qualities[method].estimate, *pictures, behind)

    wanted = -np.inf if wish.min_ssim is None else wish.min_ssim
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
    return Estimate(float(lost.mean()), *mean_interval(lost))


def _chosen_by_the_others(scores: Floats) -> NDArray[np.intp]:
    """For each object the method [G] with the best mean over the others; none of a single one.

    Of equals the first: scores [M, G] come in the order of preference.
    """
    if not len(scores) or scores.shape[1] < 2:
        return np.zeros(0, np.intp)
    return (scores.sum(axis=1, keepdims=True) - scores).argmax(axis=0)


def told(given: Sequence[Advice], wish: Wish, views_drawn: int, in_full: bool) -> list[str]:
    """Lines of text: for each advice one for the budget and one for the quality wished for.

    views_drawn  in a call, when the costs were taken
    in_full      the alternatives and the regret too
    """
    lines = []
    if wish.views != views_drawn:
        lines.append(
            f"Costs of {wish.views} view{'s' * (wish.views > 1)} are reckoned from the share of "
            "one; drawn in a call of their own they may differ."
        )
    several = len({advice.class_name for advice in given}) > 1
    for advice in given:
        name = advice.condition + f", {advice.class_name}" * several
        lines += [f"{visible(name)}: {line}" for line in _in_short(advice, wish)]
        if in_full:
            lines += [f"  {line}" for line in _alternatives(advice, wish)]
    return lines


def _in_short(advice: Advice, wish: Wish) -> list[str]:
    lines = []
    if wish.budget_ms is not None:
        lines.append(_within_budget(advice, wish, wish.budget_ms))
    if wish.min_ssim is not None:
        lines.append(_good_enough(advice, wish, wish.min_ssim))
    return lines


def _alternatives(advice: Advice, wish: Wish) -> list[str]:
    lines = []
    if wish.min_ssim is not None:
        surely = _told(advice.surely, wish) if advice.surely else "none"
        lines.append(f"surely that good, by the lower end of the interval: {surely}")
    if advice.best is None:
        return lines
    if wish.budget_ms is None:
        lines.append(f"best at any cost: {_told(advice.best, wish)}")
    for choice in advice.next:
        lines.append(f"next: {_told(choice, wish)}; behind by {_estimated(choice.behind)}")
    lines.append(
        f"regret: {_estimated(advice.regret)} ssim against the best of {advice.affordable} such "
        f"methods for each of {advice.objects} objects; "
        f"{_estimated(advice.regret_blind)} where the method is chosen by the other objects"
    )
    return lines


def _within_budget(advice: Advice, wish: Wish, budget_ms: float) -> str:
    budget = f"{milliseconds(budget_ms)} ms"
    if advice.best is None:
        nearest = f"; the cheapest: {_told(advice.cheapest, wish)}" if advice.cheapest else ""
        return f"no method within {budget}{nearest}"
    told = f"best within {budget}: {_told(advice.best, wish)}"
    if advice.best.cost_ms.high > budget_ms:
        told += "; the interval of its cost reaches beyond the budget"
    return told


def _good_enough(advice: Advice, wish: Wish, min_ssim: float) -> str:
    least = f"ssim of at least {min_ssim:g}"
    if advice.on_average is None:
        nearest = f"; the nearest: {_told(advice.finest, wish)}" if advice.finest else ""
        return f"no method with an {least}{nearest}"
    sure = advice.surely is not None and advice.surely.method == advice.on_average.method
    told = (
        f"cheapest with an {least}, {'surely' if sure else 'on average'}: "
        f"{_told(advice.on_average, wish)}"
    )
    if wish.budget_ms is not None and advice.on_average.cost_ms.value > wish.budget_ms:
        told += "; over the budget"
    return told


def _told(choice: Choice, wish: Wish) -> str:
    """The method with its quality and its cost, for the cloud and for a picture."""
    ssim = _estimated(choice.ssim)
    cost = f"{milliseconds(choice.cost_ms.value)} ms{_interval(choice.cost_ms, milliseconds)}"
    failed = f", {choice.n - choice.n_ok} of {choice.n} pictures failed" * (choice.n_ok < choice.n)
    picture = milliseconds(choice.cost_ms.value / wish.views)
    return f"{visible(choice.method)}, ssim {ssim}, {cost} a cloud, {picture} ms a picture{failed}"


def _interval(estimate: Estimate, shown: Callable[[float], str]) -> str:
    if not math.isfinite(estimate.low):
        return ""
    return f" [{shown(estimate.low)}, {shown(estimate.high)}]"


def _estimated(estimate: Estimate) -> str:
    if not math.isfinite(estimate.value):
        return "unknown"
    return _digits(estimate.value) + _interval(estimate, _digits)


def _digits(value: float) -> str:
    return f"{value:z.{decimals(METRIC)}f}"


def make_wish(views: int, budget_ms: float | None, min_ssim: float | None) -> Wish:
    """A wish of the command line. Raises BadInput for one that is empty or makes no sense."""
    if budget_ms is None and min_ssim is None:
        raise BadInput("nothing to go by; give --budget-ms, --min-ssim, or both")
    if views < 1:
        raise BadInput(f"--views {views}: must be at least 1")
    if budget_ms is not None and not 0 < budget_ms < math.inf:
        raise BadInput(f"--budget-ms {budget_ms:g}: must be a number over 0")
    if min_ssim is not None and not -1 <= min_ssim <= 1:
        raise BadInput(f"--min-ssim {min_ssim:g}: must be from -1 to 1")
    return Wish(views, budget_ms, min_ssim)


def at_condition(comparisons: Sequence[Comparison], condition: str | None) -> list[Comparison]:
    """Those at a condition; None: all. Raises BadInput for one that the run does not have."""
    chosen = [c for c in comparisons if condition in (None, c.condition)]
    if not chosen:
        there = ", ".join(dict.fromkeys(c.condition for c in comparisons))
        raise BadInput(f"--condition {condition}: not in this run; there are {there}")
    return chosen
