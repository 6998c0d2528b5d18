"""Mean ranks of methods over conditions, metrics and runs, and which of them differ.

Each object ranks the methods of a run by a metric under a condition. A mean rank is the mean over
objects, conditions, metrics and runs. Runs may have different methods: a place among m methods is
stretched to a place among all that compete. Two methods are compared on the objects of the runs
that have both, by sign flips of the objects' mean differences, corrected by Holm for all pairs; an
object that several runs share counts once.
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
        return Quality(metric, Estimate(value, *interval), per_object)

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
class ObjectPlaces:
    """The places of methods on each object by one metric under one condition of one run.

    objects  names that other runs give to the same objects
    places   float64 [G] by method: 0 for the best of the methods, 1 for the last, NaN where an
             object has no value of some method
    """

    objects: tuple[str, ...]
    places: Mapping[str, Floats]


def object_places(comparison: Comparison, metric: str, dataset: str) -> ObjectPlaces | None:
    """Return the places of the methods that compete; None for fewer than two."""
    from scipy.stats import rankdata

    qualities = comparison.qualities[metric]
    methods = [m for m in candidates(qualities) if math.isfinite(qualities[m].estimate.value)]
    if len(methods) < 2:
        return None
    sign = -1.0 if higher_is_better(metric) else 1.0
    values = sign * np.array([qualities[m].per_object for m in methods])
    places = (rankdata(values, axis=0, nan_policy="omit") - 1) / (len(methods) - 1)
    places[:, np.isnan(values).any(axis=0)] = math.nan
    names = tuple(f"{dataset}: {comparison.class_name}/{name}" for name in comparison.objects)
    return ObjectPlaces(names, dict(zip(methods, places, strict=True)))


@dataclass(frozen=True)
class MeanRank:
    """The mean rank of a method.

    rank     1 for a method that is the best everywhere, the number of methods for the last
    letters  shared by methods that are not shown to differ; empty where too few objects decide
    p_first  of no difference from the first method, after Holm's correction; NaN for the first and
             for a method that shares no objects with it
    """

    method: str
    rank: float
    letters: str
    p_first: float


@dataclass(frozen=True)
class MeanRanks:
    """The mean ranks of all methods that compete, the best first.

    objects_needed  where there are too few objects for letters, the fewest that can decide; else
                    None
    """

    ranks: tuple[MeanRank, ...]
    objects_needed: int | None


def mean_ranks(cells: Sequence[ObjectPlaces]) -> MeanRanks:
    """Return the mean ranks over the places of all runs, conditions and metrics."""
    of_method: dict[str, list[float]] = {}
    for cell in cells:
        for method, places in cell.places.items():
            if np.isfinite(places).any():
                of_method.setdefault(method, []).append(float(np.nanmean(places)))
    ranks = {m: 1 + (len(of_method) - 1) * float(np.mean(p)) for m, p in of_method.items()}
    best_first = sorted(ranks, key=lambda method: ranks[method])
    pairs = list(combinations(best_first, 2))
    differences = _differences(cells, pairs)
    p_values = dict(zip(pairs, _p_values(differences), strict=True))
    resolved = {frozenset(pair) for pair, p in p_values.items() if p < SIGNIFICANCE}
    enough = fewest_objects(len(pairs))
    decidable = bool(resolved) or any(len(of_pair) >= enough for of_pair in differences)
    given = letters(best_first, resolved) if decidable else {}
    to_first = {b: p for (a, b), p in p_values.items() if a == best_first[0]}
    return MeanRanks(
        tuple(
            MeanRank(m, ranks[m], given.get(m, ""), to_first.get(m, math.nan)) for m in best_first
        ),
        None if decidable or not pairs else enough,
    )


def _differences(cells: Sequence[ObjectPlaces], pairs: Sequence[tuple[str, str]]) -> list[Floats]:
    """Return each pair's differences of places, a mean for each object that both have."""
    names = sorted({name for cell in cells for name in cell.objects})
    number = {name: i for i, name in enumerate(names)}
    rows = [np.array([number[name] for name in cell.objects]) for cell in cells]
    differences = []
    for a, b in pairs:
        sums, counts = np.zeros(len(names)), np.zeros(len(names))
        for cell, at in zip(cells, rows, strict=True):
            if a in cell.places and b in cell.places:
                change = cell.places[a] - cell.places[b]
                known = np.isfinite(change)
                sums[at[known]] += change[known]
                counts[at[known]] += 1
        differences.append(sums[counts > 0] / counts[counts > 0])
    return differences


def _p_values(differences: Sequence[Floats]) -> list[float]:
    """Return the corrected p value of each pair; NaN for one with too few objects."""
    values = [math.nan] * len(differences)
    for length in {len(of_pair) for of_pair in differences if len(of_pair) >= FEWEST}:
        at = [i for i, of_pair in enumerate(differences) if len(of_pair) == length]
        for i, p in zip(at, sign_flip_p(np.array([differences[i] for i in at])), strict=True):
            values[i] = float(p)
    return holm(values)
