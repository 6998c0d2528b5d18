"""The table of the paper's orderings in Table 5: which a run reproduces, class by class."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from bench.analysis.comparison import NAN
from bench.analysis.intervals import FEWEST
from bench.analysis.orderings import VERDICTS, Ordering
from bench.analysis.paper import AVERAGE, NETWORK, SURFACE
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import (
    Annotation,
    Block,
    Cell,
    Grid,
    Tags,
    grid,
    measured,
    number,
    ordered,
    pivot,
)
from bench.tables.table import Table, columns, constant

MARKS = {
    "reproduced": Annotation("reproduced", "**{value}{interval}**"),
    "opposite": Annotation("opposite", "{value}{interval} *opposite*", against=True),
}


def orderings_table(spec: TableSpec, suite: str, rows: Sequence[Ordering]) -> Table[Ordering]:
    """Return the table of a run's orderings, of which there has to be one."""
    network = rows[0].method
    csv = (
        constant("suite", suite),
        *columns("condition", ("class", "class_name"), "metric", "method", "surface", "network"),
        *columns(("lead", "difference.value"), ("ci_low", "difference.low")),
        *columns(("ci_high", "difference.high"), ("paper_lead", "paper_difference")),
        *columns("verdict", "objects"),
    )
    remark = _REMARK.format(network=network, surface=SURFACE)
    layout = partial(_layout, network)
    return Table.of_rows(spec.name, spec.title, csv, tuple(rows), layout, remark)


def _layout(network: str, rows: Sequence[Ordering]) -> Iterator[Block]:
    """Yield for each condition how many orderings hold by each metric, then the differences."""
    yield (
        f"How much better {markdown.code(network)} is than `{SURFACE}`, over 0 if it is, "
        "[interval, paired over objects], failed images scored as blank ones. The paper orders "
        f"by FID: {NETWORK} is ahead in 11 of 13 classes and on average, SR in rifle and lamp. "
        "**Bold**: that ordering, and the interval does not hold 0; *opposite*: the other one, "
        f"the same; neither: undecided by so many objects, or no interval below {FEWEST}. "
        "Intervals of a metric hold in 95 % for all classes together."
    )
    for condition in ordered(row.condition for row in rows):
        of_condition = [row for row in rows if row.condition == condition]
        yield f"## {markdown.cell(condition)}"
        yield _counts(of_condition)
        yield _differences(of_condition)


def _counts(rows: Sequence[Ordering]) -> Grid:
    """Return in how many classes the paper's ordering holds: a line for each metric."""
    lines = []
    for metric in ordered(row.metric for row in rows):
        of_metric = [row for row in rows if row.metric == metric]
        classes = [row for row in of_metric if row.class_name != AVERAGE]
        counts = [sum(row.verdict == verdict for row in classes) for verdict in VERDICTS]
        same = sum(row.difference.value * row.paper_difference > 0 for row in classes)
        (average,) = (row.verdict for row in of_metric if row.class_name == AVERAGE)
        lines.append([metric, *map(str, (*counts, same, average))])
    condition = rows[0].condition
    return grid(
        ["classes", *VERDICTS, "same sign", "on average"],
        lines,
        caption=f"classes at {condition}",
        tags=Tags(condition=condition),
    )


def _differences(rows: Sequence[Ordering]) -> Grid:
    """Return the differences, classes down and metrics across."""
    condition = rows[0].condition
    by_class = pivot(
        rows,
        "class_name",
        "metric",
        _cell,
        before={
            "objects": lambda row: Cell(str(row.objects), row.objects),
            "paper (FID)": lambda row: number((row.paper_difference, NAN, NAN), "{:+.1f}".format),
        },
        corner="class",
        caption=f"lead at {condition}",
        tags=Tags(condition=condition),
    )
    # The average is of all classes: no choice of one hides it.
    lines = (replace(x, tags=Tags()) if x.name == AVERAGE else x for x in by_class.lines)
    return replace(by_class, lines=tuple(lines))


def _cell(row: Ordering) -> Cell:
    sides = row.method, SURFACE
    mark = MARKS.get(row.verdict)
    return measured(row.difference, row.metric, *sides, sign="+", special=mark)


_REMARK = (
    "How much better {network} is than {surface}: over 0 if it is, with its interval, paired over "
    "objects; failed images are scored as blank ones. The paper orders by FID, which is not "
    "on the scale of the others. “reproduced” is the paper's ordering, “opposite” the other one, "
    "both with an interval that leaves 0 out; the rest is undecided by so many objects."
)
