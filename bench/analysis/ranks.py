"""Ranks of methods: methods that share a letter do not differ significantly.

The letters are a compact letter display by insertion and absorption (Piepho, Journal of
Computational and Graphical Statistics 13, 2004). Whether two methods differ is decided object by
object (`bench.analysis.paired`), corrected for all pairs. Reference methods have no rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import combinations
from string import ascii_lowercase

from bench.analysis.comparison import Comparison, Estimate, best_first, candidates
from bench.analysis.paired import Side, compared_pair, paired_differences


@dataclass(frozen=True)
class Rank:
    """A method's value and its letters, "a" for the best; a method without a rank has none.

    Reference methods never have one, the others where there are enough objects.
    """

    method: str
    estimate: Estimate
    letters: str


@dataclass(frozen=True)
class Ranking:
    """The ranks of methods by one metric.

    ranks  the best first, then the reference methods
    objects_needed  where there are too few objects for letters, the fewest that can decide; else
                    None
    """

    metric: str
    ranks: tuple[Rank, ...]
    objects_needed: int | None


def ranking(comparison: Comparison, metric: str) -> Ranking:
    """Return the ranks of all methods that have a value."""
    qualities = comparison.qualities[metric]
    ordered = list(best_first(qualities))
    ranked = candidates(ordered)
    references = [method for method in ordered if method not in ranked]
    pairs = paired_differences(
        [
            compared_pair(metric, comparison, comparison, Side("", a), Side("", b))
            for a, b in combinations(ranked, 2)
        ]
    )
    resolved = {
        frozenset((p.pair.a.method, p.pair.b.method)) for p in pairs if p.ahead in ("a", "b")
    }
    needed = max((p.objects_needed for p in pairs if p.objects_needed), default=None)
    given = letters(ranked, resolved) if pairs and not needed else {}
    return Ranking(
        metric,
        tuple(Rank(m, qualities[m].estimate, given.get(m, "")) for m in [*ranked, *references]),
        needed,
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
