"""Ranks of methods: letters by one metric, and mean places over several columns of values.

Methods that share a letter do not differ significantly. The letters are a compact letter display by
insertion and absorption (Piepho, Journal of Computational and Graphical Statistics 13, 2004).
Whether two methods differ is decided object by object (`bench.analysis.paired`), corrected for all
pairs. Reference methods have no rank.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import combinations
from string import ascii_lowercase

import numpy as np
import pandas as pd

from bench.analysis.comparison import best_first, candidates
from bench.analysis.digits import prints_better
from bench.analysis.paired import paired_differences


def ranking(rows: pd.DataFrame) -> tuple[pd.DataFrame, int | None]:
    """Return the methods that have a value with their letters, and how many objects are missing.

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
        Where there are too few objects for letters, the fewest that can decide.
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

    Groups are named in the order of their best members; after "z" come "z1", "z2".
    """
    groups = {frozenset(best_first)}
    for pair in map(frozenset, combinations(best_first, 2)):
        if pair in differ:
            split = {group for group in groups if pair <= group}
            groups = (groups - split) | {group - {method} for group in split for method in pair}
            groups = {group for group in groups if not any(group < other for other in groups)}
    place = {method: i for i, method in enumerate(best_first)}
    ordered = sorted(groups, key=lambda group: sorted(place[method] for method in group))
    names = [ascii_lowercase[i] if i < 26 else f"z{i - 25}" for i in range(len(ordered))]
    return {
        method: "".join(name for name, group in zip(names, ordered, strict=True) if method in group)
        for method in best_first
    }


def mean_places(
    columns: Sequence[tuple[str, Mapping[str, float]]], ids: Mapping[str, str]
) -> dict[str, float]:
    """Return the mean place of each method that has one, 1 for one that is always the best.

    A column is a metric with its values by name, which are compared in the digits that both are
    printed with; `ids` has the methods of the names that compete. A place among fewer methods is
    stretched to all that have one.
    """
    places: dict[str, list[float]] = {}
    for metric, of_column in columns:
        known = {name: of_column[name] for name in ids if name in of_column}
        for name, value in known.items():
            balance = [
                prints_better(metric, other, value, ids[name], ids[rival])
                - prints_better(metric, value, other, ids[name], ids[rival])
                for rival, other in known.items()
            ]
            # Those that print equal share their places.
            others = len(known) - 1
            places.setdefault(name, []).append((others + sum(balance)) / 2 / max(others, 1))
    return {m: 1 + (len(places) - 1) * float(np.mean(p)) for m, p in places.items()}
