"""The ranks of a run as a table for scripts: the values of its page on a site."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.analysis.comparison import Comparison
from bench.analysis.ranks import Rank, Ranking
from bench.tables.table import Table, columns

RANKS = "ranks"


@dataclass(frozen=True)
class RankedValue:
    """A method by one metric under one condition.

    n_ok, n  images that exist, images that should
    """

    condition: str
    class_name: str
    metric: str
    rank: Rank
    n_ok: int
    n: int


def ranks_table(compared: Sequence[Comparison], rankings: Sequence[Ranking]) -> Table[RankedValue]:
    """Return the ranks of all methods; a failed image is scored as a blank one.

    The column of the values has the name that it has in the tables of the run.
    """
    at = {comparison.condition: comparison for comparison in compared}
    rows = (
        RankedValue(
            *(ranking.condition, at[ranking.condition].class_name, ranking.metric, rank),
            *at[ranking.condition].images[rank.method],
        )
        for ranking in rankings
        for rank in ranking.ranks
    )
    csv = (
        *columns("metric", "condition", ("class", "class_name"), ("method", "rank.method")),
        *columns(("failures_as_blank", "rank.estimate.value"), ("ci_low", "rank.estimate.low")),
        *columns(("ci_high", "rank.estimate.high"), "n_ok", "n", ("letters", "rank.letters")),
    )
    return Table(RANKS, "Ranks", csv, tuple(rows))
