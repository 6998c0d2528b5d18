"""Ranks that say what is resolved: methods that share a letter are not shown to differ.

The letters are a compact letter display by insertion and absorption (Piepho, Journal of
Computational and Graphical Statistics 13, 2004). Whether two methods differ is decided object by
object (`bench.analysis.paired`), corrected by Holm for all pairs under one condition. Pure
functions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import combinations
from string import ascii_lowercase

from bench.analysis.comparison import Comparison, Estimate
from bench.analysis.paired import Pair, PairedDifference, Side, paired_differences
from bench.catalogue.methods import role


@dataclass(frozen=True)
class Rank:
    """A method's value and its letters, "a" for the best; empty where there are too few objects."""

    method: str
    estimate: Estimate
    letters: str

    @property
    def first(self) -> bool:
        """Whether no other is shown to be better than it."""
        return "a" in self.letters


@dataclass(frozen=True)
class Ranking:
    """The methods by one metric under one condition, the best first, and all their pairs."""

    metric: str
    condition: str
    ranks: tuple[Rank, ...]
    pairs: tuple[PairedDifference, ...]

    def of(self, method: str) -> Rank | None:
        """The rank of a method; None where it is not ranked."""
        return next((rank for rank in self.ranks if rank.method == method), None)


def ranking(of: Comparison, metric: str) -> Ranking:
    """All methods but those that see the mesh; without a value they are left out."""
    known = {
        method: quality
        for method, quality in of.qualities[metric].items()
        if role(method) != "ceiling" and math.isfinite(quality.estimate.value)
    }
    best_first = sorted(known, key=lambda method: -known[method].rank)
    pairs = paired_differences(
        [
            Pair(
                *(of.condition, of.class_name, Side("", a), Side("", b), known[a], known[b]),
                objects=len(of.objects),
            )
            for a, b in combinations(best_first, 2)
        ]
    )
    resolved = {
        frozenset((p.pair.a.method, p.pair.b.method)) for p in pairs if p.ahead in ("a", "b")
    }
    tested = any(pair.ahead != "unknown" for pair in pairs)
    given = letters(best_first, resolved) if tested else dict.fromkeys(best_first, "")
    ranks = tuple(Rank(method, known[method].estimate, given[method]) for method in best_first)
    return Ranking(metric, of.condition, ranks, tuple(pairs))


def letters(best_first: Sequence[str], differ: AbstractSet[frozenset[str]]) -> dict[str, str]:
    """Letters by method: two share one exactly where they are no pair of `differ`.

    Groups are named in the order of their best members; after "z" come "z1", "z2".
    """
    groups = {frozenset(best_first)}
    for pair in map(frozenset, combinations(best_first, 2)):
        if pair in differ:
            split = {group for group in groups if pair <= group}
            groups = (groups - split) | {group - {one} for group in split for one in pair}
            groups = {group for group in groups if not any(group < other for other in groups)}
    place = {method: i for i, method in enumerate(best_first)}
    ordered = sorted(groups, key=lambda group: sorted(place[method] for method in group))
    names = [ascii_lowercase[i] if i < 26 else f"z{i - 25}" for i in range(len(ordered))]
    return {
        method: "".join(name for name, group in zip(names, ordered, strict=True) if method in group)
        for method in best_first
    }
