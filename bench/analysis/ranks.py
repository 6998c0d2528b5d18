"""Ranks of methods: methods that share a letter do not differ significantly.

The letters are a compact letter display by insertion and absorption (Piepho, Journal of
Computational and Graphical Statistics 13, 2004). Whether two methods differ is decided object by
object (`bench.analysis.paired`), corrected by Holm for all pairs under one condition. Reference
methods have no rank; their pairs are a family of their own, so that they cost the others nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import combinations
from string import ascii_lowercase

from bench.analysis.comparison import Comparison, Estimate, candidates
from bench.analysis.paired import ComparedPair, PairedDifference, Side, paired_differences


@dataclass(frozen=True)
class Rank:
    """A method's value and its letters, "a" for the best; a method without a rank has none.

    Reference methods never have one, the others where there are enough objects.
    """

    method: str
    estimate: Estimate
    letters: str

    @property
    def first(self) -> bool:
        """Return whether it is ranked, and no other is shown to be better than it."""
        return "a" in self.letters


@dataclass(frozen=True)
class Ranking:
    """The ranks of methods by one metric under one condition, and all their pairs.

    ranks  the best first, then the reference methods
    objects_needed  where there are too few objects for letters, the fewest that can decide; else
                    None
    """

    metric: str
    condition: str
    ranks: tuple[Rank, ...]
    pairs: tuple[PairedDifference, ...]
    objects_needed: int | None


def ranking(comparison: Comparison, metric: str) -> Ranking:
    """Return the ranks of all methods that have a value."""
    qualities = comparison.qualities[metric]
    known = [method for method, q in qualities.items() if math.isfinite(q.estimate.value)]
    best_first = sorted(known, key=lambda method: -qualities[method].rank)
    ranked = candidates(best_first)
    references = [method for method in best_first if method not in ranked]

    def differences(pairs: Iterable[tuple[str, str]]) -> list[PairedDifference]:
        sides = [(Side("", a), Side("", b), qualities[a], qualities[b]) for a, b in pairs]
        cell = comparison.condition, comparison.class_name
        return paired_differences(
            [ComparedPair(*cell, *side, objects=len(comparison.objects)) for side in sides]
        )

    family = differences(combinations(ranked, 2))
    with_reference = [
        pair for pair in combinations(best_first, 2) if not set(pair).isdisjoint(references)
    ]
    resolved = {
        frozenset((p.pair.a.method, p.pair.b.method)) for p in family if p.ahead in ("a", "b")
    }
    needed = max((p.objects_needed for p in family if p.objects_needed), default=None)
    lettered = resolved or (needed is None and any(p.ahead == "tie" for p in family))
    given = letters(ranked, resolved) if lettered else {}
    return Ranking(
        metric,
        comparison.condition,
        tuple(Rank(m, qualities[m].estimate, given.get(m, "")) for m in [*ranked, *references]),
        (*family, *differences(with_reference)),
        None if lettered else needed,
    )


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
