"""Mean ranks of methods over conditions, metrics and runs, and which of them differ.

On each object two methods of a run are compared by a metric under a condition. The mean rank of a
method is 1 and the share of the comparisons that it loses to each other method, summed over these.
Where every run has the same methods this is the mean of their ranks; a method that has not met all
others is taken to lose as often to those as to the ones that it has met.

Two methods differ where one is ahead of the other more often: by sign flips of the objects' mean
outcomes, corrected by Holm for all pairs. An object that several runs share counts once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from bench.analysis.comparison import Comparison, Estimate, Quality, candidates
from bench.analysis.intervals import FEWEST, clipped, mean_interval
from bench.analysis.paired import SIGNIFICANCE, fewest_objects, holm, sign_flip_p
from bench.analysis.ranks import letters
from bench.analysis.significant_digits import half_of_mean
from bench.catalogue.metrics import higher_is_better, value_range
from data_prep.arrays import Floats

OVERALL = "all conditions"


def over_conditions(compared: Sequence[Comparison]) -> Comparison:
    """Return the comparison by each object's mean over conditions, on objects that all have.

    Costs are those of the first condition. Image metrics only.
    """
    shared = sorted(set.intersection(*(set(c.objects) for c in compared)))
    places = [[c.objects.index(name) for name in shared] for c in compared]
    first = compared[0]
    methods = [m for m in first.images if all(m in c.images for c in compared)]

    def quality(metric: str, method: str) -> Quality:
        stacked = np.array(
            [
                c.qualities[metric][method].per_object[at]
                for c, at in zip(compared, places, strict=True)
            ]
        )
        per_object = stacked.mean(axis=0)  # NaN where any condition has no value
        known = per_object[~np.isnan(per_object)]
        value = float(known.mean()) if len(known) else math.nan
        interval = clipped(mean_interval(known), value_range(metric))
        rounding = half_of_mean([c.qualities[metric][method].rounding for c in compared])
        return Quality(metric, Estimate(value, *interval), per_object, rounding)

    return replace(
        first,
        condition=OVERALL,
        objects=tuple(shared),
        prepare_s={m: first.prepare_s[m][places[0]] for m in methods},
        draw_s={m: first.draw_s[m][places[0]] for m in methods},
        images={
            m: (sum(c.images[m][0] for c in compared), sum(c.images[m][1] for c in compared))
            for m in methods
        },
        qualities={
            metric: {method: quality(metric, method) for method in methods}
            for metric in first.qualities
        },
    )


@dataclass(frozen=True, eq=False)
class ObjectScores:
    """The scores of methods on each object by one metric under one condition of one run.

    objects  names that other runs give to the same objects
    scores   float64 [G] by method, more is better; NaN where an object has no value
    """

    objects: tuple[str, ...]
    scores: Mapping[str, Floats]


def object_scores(comparison: Comparison, metric: str, dataset: str) -> ObjectScores | None:
    """Return the scores of the methods that compete; None for fewer than two."""
    qualities = comparison.qualities[metric]
    methods = [m for m in candidates(qualities) if math.isfinite(qualities[m].estimate.value)]
    if len(methods) < 2:
        return None
    sign = 1.0 if higher_is_better(metric) else -1.0
    names = tuple(f"{dataset}: {comparison.class_name}/{name}" for name in comparison.objects)
    return ObjectScores(names, {m: sign * qualities[m].per_object for m in methods})


@dataclass(frozen=True)
class MeanRank:
    """The mean rank of a method.

    rank     1 for a method that is the best everywhere, the number of methods for the last
    letters  shared by methods that are not shown to differ; empty where too few objects decide
    p_first  of no difference from the first method with letters, after Holm's correction; NaN for
             that method and for one that shares too few objects with it
    """

    method: str
    rank: float
    letters: str
    p_first: float


@dataclass(frozen=True)
class MeanRanks:
    """The mean ranks of all methods that compete, the best first.

    first           the best of those with enough objects; the best of all where there are none
    objects_needed  where there are too few objects for any letters, the fewest that can decide;
                    else None
    """

    ranks: tuple[MeanRank, ...]
    first: str
    objects_needed: int | None


def mean_ranks(cells: Sequence[ObjectScores]) -> MeanRanks:
    """Return the mean ranks over the scores of all runs, conditions and metrics."""
    methods = list(dict.fromkeys(method for cell in cells for method in cell.scores))
    lost: dict[str, list[float]] = {method: [] for method in methods}
    outcomes: dict[tuple[str, str], Floats] = {}  # a mean of an object: 1 where a is ahead, or -1
    for a, b in combinations(methods, 2):
        per_comparison, outcomes[a, b] = _outcomes(cells, a, b)
        if len(per_comparison):
            lost[a].append((1 - float(per_comparison.mean())) / 2)
            lost[b].append((1 + float(per_comparison.mean())) / 2)
    ranks = {m: 1 + (len(methods) - 1) * float(np.mean(s)) for m, s in lost.items() if s}
    best_first = sorted(ranks, key=lambda method: ranks[method])
    pairs = [pair for pair, of_pair in outcomes.items() if len(of_pair) >= FEWEST]
    p_values = dict(zip(pairs, _p_values([outcomes[pair] for pair in pairs]), strict=True))
    resolved = {frozenset(pair) for pair, p in p_values.items() if p < SIGNIFICANCE}
    enough = fewest_objects(max(len(pairs), 1))
    decidable = bool(resolved) or any(len(outcomes[pair]) >= enough for pair in pairs)
    tested = [m for m in best_first if any(m in pair for pair in pairs)]
    given = letters(tested, resolved) if decidable else {}
    first = next(iter([*tested, *best_first]), "")
    to_first = {frozenset(pair) - {first}: p for pair, p in p_values.items() if first in pair}
    return MeanRanks(
        tuple(
            MeanRank(m, ranks[m], given.get(m, ""), to_first.get(frozenset({m}), math.nan))
            for m in best_first
        ),
        first,
        None if decidable or len(best_first) < 2 else enough,
    )


def _outcomes(cells: Sequence[ObjectScores], a: str, b: str) -> tuple[Floats, Floats]:
    """Return the outcomes of all comparisons of two methods, and the mean of each object."""
    names: list[str] = []
    outcomes: list[Floats] = []
    for cell in cells:
        if a in cell.scores and b in cell.scores:
            change = cell.scores[a] - cell.scores[b]
            known = np.isfinite(change)
            outcomes.append(np.sign(change[known]))
            names += [name for name, is_known in zip(cell.objects, known, strict=True) if is_known]
    if not names:
        return np.empty(0), np.empty(0)
    every = np.concatenate(outcomes)
    _, of_object = np.unique(names, return_inverse=True)
    return every, np.bincount(of_object, every) / np.bincount(of_object)


def _p_values(outcomes: Sequence[Floats]) -> list[float]:
    """Return the corrected p value of each pair."""
    values = [math.nan] * len(outcomes)
    for length in {len(of_pair) for of_pair in outcomes}:
        at = [i for i, of_pair in enumerate(outcomes) if len(of_pair) == length]
        for i, p in zip(at, sign_flip_p(np.array([outcomes[i] for i in at])), strict=True):
            values[i] = float(p)
    return holm(values)
