"""Ranks of methods: letters by one metric, and mean places over several columns of values.

Methods that share a letter do not differ significantly. The letters are a compact letter display by
insertion and absorption (Piepho, Journal of Computational and Graphical Statistics 13, 2004).
Whether two methods differ is decided object by object (`bench.analysis.differences`), corrected for
all pairs. Reference methods have no rank.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import combinations
from string import ascii_lowercase

import numpy as np
import pandas as pd

from bench.analysis.compare import best_first, candidates
from bench.analysis.differences import paired_differences
from bench.analysis.digits import prints_better


def ranking(rows: pd.DataFrame) -> tuple[pd.DataFrame, int | None]:
    """Return the methods that have a value with their letters, and whether objects are too few.

    Parameters
    ----------
    rows : DataFrame
        A comparison by one metric, of one class under one condition.

    Returns
    -------
    DataFrame
        The rows, the best first, then the reference methods, with `letters`: "a" for the best.
        Reference methods never have one, the others where there are enough objects.
    int or None
        Where there are too few objects for letters, how many are needed at least.
    """
    ordered = best_first(rows)
    competes = ordered["method"].isin(candidates(ordered["method"]))
    pairs = paired_differences(list(combinations(ordered[competes].to_dict("records"), 2)))
    differ = pairs[pairs["ahead"].isin(("a", "b"))]
    needed = max(pairs["objects_needed"].dropna(), default=None)
    given = {}
    if len(pairs) and not needed:
        resolved = map(frozenset, zip(differ["method_a"], differ["method_b"], strict=True))
        given = letters(ordered.loc[competes, "method"].tolist(), set(resolved))
    every = pd.concat([ordered[competes], ordered[~competes]])
    return every.assign(letters=[given.get(m, "") for m in every["method"]]), needed


def letters(best_first: Sequence[str], differ: AbstractSet[frozenset[str]]) -> dict[str, str]:
    """Return the letters of each method; two share one exactly if they are no pair of `differ`.

    best_first  the methods, the best first
    differ      the pairs of methods that differ significantly

    Letters are given in the order of the best member that shares them; after "z" come "z1", "z2".
    """
    groups = {frozenset(best_first)}  # of methods: all of a group share a letter
    for pair in map(frozenset, combinations(best_first, 2)):
        if pair in differ:
            groups = _without_subsets(_separated(groups, pair))
    rank = {method: i for i, method in enumerate(best_first)}
    ordered = sorted(groups, key=lambda group: sorted(rank[method] for method in group))
    of_methods = dict.fromkeys(best_first, "")
    for number, group in enumerate(ordered):
        letter = ascii_lowercase[number] if number < 26 else f"z{number - 25}"
        for method in group:
            of_methods[method] += letter
    return of_methods


def _separated(groups: set[frozenset[str]], pair: frozenset[str]) -> set[frozenset[str]]:
    """Split each group that has both methods of a pair into two, which lack one of them each."""
    result = set[frozenset[str]]()
    for group in groups:
        if pair <= group:
            result |= {group - {method} for method in pair}
        else:
            result.add(group)
    return result


def _without_subsets(groups: set[frozenset[str]]) -> set[frozenset[str]]:
    """Return the groups that are no part of another one."""
    return {group for group in groups if not any(group < other for other in groups)}


def mean_places(
    columns: Sequence[tuple[str, Mapping[str, float]]], methods: Sequence[str]
) -> dict[str, float]:
    """Return the mean place of each method that has one, 1 for one that is always the best.

    columns  (metric, values by method); values are compared in the digits that both are printed
             with, and equal ones share the mean of their places
    methods  those that compete

    A column may lack some methods: its places are stretched to the number of all that have places.
    """
    shares: dict[str, list[float]] = {}  # of the way from the first to the last place, 0..1
    for metric, of_column in columns:
        known = {method: of_column[method] for method in methods if method in of_column}
        others = len(known) - 1
        for method, value in known.items():
            better, worse = 0, 0  # numbers of rivals
            for rival, other in known.items():
                better += prints_better(metric, other, value, method, rival)
                worse += prints_better(metric, value, other, method, rival)
            share = (others + better - worse) / 2 / max(others, 1)
            shares.setdefault(method, []).append(share)
    last = len(shares)
    return {name: 1 + (last - 1) * float(np.mean(of_name)) for name, of_name in shares.items()}
