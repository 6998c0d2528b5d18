"""Headline pairs that are decided at any moment: each network against the best reconstruction.

A run may be watched, and ended when it has decided: the intervals are confidence sequences
(`bench.analysis.sequences`), for all pairs, conditions and metrics together (Bonferroni). A pair is
decided once its interval leaves out 0, or lies within EQUAL of it; it stays decided.

Objects have to come in an order that no result influences (`bench.running.turns`). A value of the
sequence is the difference of two methods on an object, failed images scored as blank ones. With
several classes it is that of a turn, the mean of an object of each, so that classes count alike.

Sequences need bounds. Those of the metrics themselves are wide (ssim-object: -2 to 2, lpips: none),
and a sequence cannot be narrower than its bound allows, whatever the spread. So differences beyond
BOUNDS count as these, and the mean of such differences is what is decided. For a sign this is the
cautious side: an object can weigh no more than its bound.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from bench.analysis.paired import SIGNIFICANCE
from bench.analysis.scored import ScoredRun
from bench.analysis.sequences import ConfidenceSequence
from bench.catalogue.chosen import BEST_RECONSTRUCTION, CHOSEN
from bench.catalogue.methods import known_method
from bench.catalogue.metrics import higher_is_better
from bench.catalogue.suites import Suite
from bench.running.turns import seeded_turns

BOUNDS = {"ssim-object": 0.5, "lpips": 0.25}  # of the differences
EQUAL = 0.01  # differences that do not matter
STEP = 0.0025  # of the ends of intervals
Verdict = Literal["ahead", "behind", "equal", "open"]
ObjectMeans = Mapping[tuple[str, str, str], float]  # by method, condition and metric


class HeadlinePair(NamedTuple):
    """A network and the best reconstruction at a condition, by a metric of the headline."""

    method: str
    opponent: str
    condition: str
    metric: str


@dataclass
class PairState:
    """A headline pair after some objects.

    Attributes
    ----------
    sequence : ConfidenceSequence
        Of the differences within bounds, above 0 where the method is ahead.
    total : float
        Sum of the differences as they are.
    beyond : int
        Number of differences beyond the bound.
    verdict : str
        "ahead", "behind", "equal" within EQUAL, or "open".
    decided_after : int or None
        Values until then.
    """

    pair: HeadlinePair
    sequence: ConfidenceSequence
    total: float = 0.0
    beyond: int = 0
    verdict: Verdict = "open"
    decided_after: int | None = None
    _waiting: dict[str, deque[float]] = field(default_factory=dict)

    def add(self, difference: float) -> None:
        """Take the difference of an object, or of a turn."""
        bound = BOUNDS[self.pair.metric]
        self.total += difference
        self.beyond += abs(difference) > bound
        self.sequence.add(min(max(difference, -bound), bound))
        if self.verdict == "open":
            self.verdict = _verdict(self.sequence)
            if self.verdict != "open":
                self.decided_after = self.sequence.count

    def add_of_class(self, class_name: str, difference: float) -> None:
        """Take the difference of an object of one of the classes."""
        self._waiting[class_name].append(difference)
        if all(self._waiting.values()):
            self.add(float(np.mean([queue.popleft() for queue in self._waiting.values()])))

    @property
    def mean(self) -> float:
        """Return the mean of the differences as they are; NaN without any."""
        return self.total / self.sequence.count if self.sequence.count else math.nan


class DecidedPairs:
    """The headline pairs of a run after each of its objects."""

    def __init__(
        self, pairs: Sequence[HeadlinePair], classes: Sequence[str], alpha: float = SIGNIFICANCE
    ) -> None:
        """Take the pairs, the classes of the objects, and the rate of error of all together."""
        self.states = tuple(
            PairState(
                pair,
                ConfidenceSequence(alpha / len(pairs), BOUNDS[pair.metric], STEP),
                _waiting={name: deque() for name in classes},
            )
            for pair in pairs
        )

    def add(self, class_name: str, means: ObjectMeans) -> None:
        """Take the next object. A pair that has no value there does not count it."""
        for state in self.states:
            method, opponent, condition, metric = state.pair
            difference = means.get((method, condition, metric), math.nan) - means.get(
                (opponent, condition, metric), math.nan
            )
            if not math.isnan(difference):
                sign = 1.0 if higher_is_better(metric) else -1.0
                state.add_of_class(class_name, sign * difference)

    @property
    def all_decided(self) -> bool:
        """Return whether every pair has a verdict."""
        return all(state.verdict != "open" for state in self.states)


def headline_pairs(
    suite: Suite, methods: Iterable[str], conditions: Iterable[str], metrics: Iterable[str]
) -> list[HeadlinePair]:
    """Return the pairs of a run with these methods, conditions and measured metrics.

    The opponent is the run's best reconstruction at the condition, as `bench.catalogue.chosen` has
    it; here a single one will do.
    """
    methods = list(methods)
    networks = [m for m in methods if (known := known_method(m)) and known.kind == "network"]
    wanted = [m for m in suite.headline if m in set(metrics) and m in BOUNDS]
    pairs = []
    for condition in conditions:
        ranked = CHOSEN[BEST_RECONSTRUCTION].ranking.get(condition, ())
        opponent = next((method for method in ranked if method in methods), None)
        if opponent is not None:
            pairs += [HeadlinePair(n, opponent, condition, m) for n in networks for m in wanted]
    return pairs


def decided_pairs(run: ScoredRun) -> DecidedPairs | None:
    """Return the headline pairs of a run after its objects, in their seeded order.

    None where the run has no pair to decide, as a run of reconstructions alone.
    """
    metrics = run.measured(run.suite.headline)
    pairs = headline_pairs(run.suite, run.manifest["methods"], run.manifest["conditions"], metrics)
    if not pairs:
        return None
    order = seeded_turns(run.manifest["objects"], int(run.manifest["seed"]))
    decided = DecidedPairs(pairs, classes_of(order))
    of_pairs = {pair.metric for pair in pairs}
    for name in order:
        decided.add(name.partition("/")[0], run.sums.means_of(name, of_pairs))
    return decided


def classes_of(objects: Iterable[str]) -> list[str]:
    """Return the classes of objects "class/name", each once."""
    return list(dict.fromkeys(name.partition("/")[0] for name in objects))


def _verdict(sequence: ConfidenceSequence) -> Verdict:
    if sequence.low >= -EQUAL and sequence.high <= EQUAL:
        return "equal"
    if sequence.low >= 0:
        return "ahead"
    return "behind" if sequence.high <= 0 else "open"
