"""The headline pairs that are decided, with intervals that hold at any moment."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.analysis.comparison import decimals
from bench.analysis.decided import BOUNDS, DecidedPairs
from bench.tables import markdown
from bench.tables.grid import Block, Cell, grid, ordered, shown
from bench.tables.table import Table, columns_of

DECIDED = "decided"
VERDICTS = ("ahead", "behind", "equal", "open")


@dataclass(frozen=True)
class DecidedRow:
    """A network and the best reconstruction at a condition, by a metric.

    ahead_by        mean difference, above 0 where the method is ahead
    ci_low, ci_high the time-uniform interval of the mean of the differences within bounds
    objects         differences so far: objects, or turns of one object of each class
    beyond          differences beyond the bound
    decided_after   differences until the verdict; None while it is open
    """

    suite: str
    method: str
    opponent: str
    condition: str
    metric: str
    ahead_by: float
    ci_low: float
    ci_high: float
    objects: int
    beyond: int
    decided_after: int | None
    verdict: str


def decided_table(
    suite: str, decided: DecidedPairs, objects: int, planned: int
) -> Table[DecidedRow]:
    """Return the table of pairs after so many of the planned objects."""
    rows = tuple(
        DecidedRow(
            suite,
            *state.pair,
            state.mean,
            state.sequence.low,
            state.sequence.high,
            state.sequence.count,
            state.beyond,
            state.decided_after,
            state.verdict,
        )
        for state in decided.states
    )
    open_ = sum(row.verdict == "open" for row in rows)
    title = (
        f"{len(rows) - open_} of {len(rows)} headline pairs decided: {objects} of {planned} objects"
    )
    return Table(DECIDED, title, columns_of(DecidedRow), rows, _layout, _remark(rows))


def _remark(rows: Sequence[DecidedRow]) -> str:
    bounds = ", ".join(f"±{BOUNDS[m]:g} ({m})" for m in ordered(row.metric for row in rows))
    return (
        "Mean difference to the best reconstruction, above 0 where the method is ahead, "
        "verdict (differences until it) and [time-uniform interval]. The intervals are confidence "
        "sequences: they hold together, at 95 %, however often one looks and whenever the run "
        "ends. Those of the other tables hold for a number of objects that was fixed beforehand. "
        f"Intervals are of differences clipped at {bounds}; * marks a pair that has any beyond. "
        "equal is within ±0.01; open pairs need more objects."
    )


def _layout(rows: Sequence[DecidedRow]) -> Iterator[Block]:
    yield _remark(rows)
    opponents = {row.condition: row.opponent for row in rows}
    parts = (f"{markdown.code(method)} at {at}" for at, method in opponents.items())
    yield f"The best reconstruction is {', '.join(parts)}."
    at = {(row.method, row.metric, row.condition): row for row in rows}
    for metric in ordered(row.metric for row in rows):
        counts = Counter(row.verdict for row in rows if row.metric == metric)
        yield f"## {markdown.cell(metric)}"
        yield ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS) + "."
        yield grid(
            ["method", *opponents],
            [
                [method, *(_cell(at[method, metric, condition]) for condition in opponents)]
                for method in ordered(row.method for row in rows)
            ],
            caption=f"{metric} ahead of the best reconstruction",
            interval="intervals that hold together at any moment, at 95 %",
        )


def _cell(row: DecidedRow) -> Cell:
    digits = decimals(row.metric)
    after = "" if row.decided_after is None else f" ({row.decided_after})"
    text = f"{shown(row.ahead_by, digits)}{'*' * bool(row.beyond)} {row.verdict}{after}"
    return Cell(text, row.ahead_by, (shown(row.ci_low, digits), shown(row.ci_high, digits)))
