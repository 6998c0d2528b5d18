"""The report's table of the paper's orderings: who is ahead, class by class. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.report.page import Cell, Line, NumberTable, TableGroup, Tags, lead_cell
from bench.tables.classes import AVERAGE, SURFACE, decimals
from bench.tables.orderings import Ordering, OrderingsTable
from bench.tables.table import ordered

_REMARK = (
    "How much better {network} is than {surface}: over 0 if it is, with its 95 % interval, paired "
    "over objects; failed pictures are scored as blank ones. The paper orders by FID, which is not "
    "on the scale of the others. “reproduced” is the paper's ordering, “opposite” the other one, "
    "both with an interval that leaves 0 out; the rest is undecided by so many objects."
)


def orderings_group(made: OrderingsTable) -> TableGroup:
    """The leads with a line for each class and a column for each metric, for each condition."""
    conditions = ordered(row.condition for row in made.rows)
    tables = (
        _leads([row for row in made.rows if row.condition == condition]) for condition in conditions
    )
    remark = _REMARK.format(network=made.network, surface=SURFACE)
    return TableGroup("Which of the paper's orderings hold", remark, tuple(tables))


def _leads(rows: Sequence[Ordering]) -> NumberTable:
    metrics = ordered(row.metric for row in rows)
    at = {(row.class_name, row.metric): row for row in rows}
    lines = []
    for name in ordered(row.class_name for row in rows):
        of_class = [at[name, metric] for metric in metrics]
        paper = of_class[0].paper_lead
        published = Cell(f"{paper:+.1f}", paper) if math.isfinite(paper) else Cell("-")
        tags = Tags() if name == AVERAGE else Tags(class_name=name)
        lines.append(Line(name, "", tags, (published, *map(_cell, of_class))))
    return NumberTable(
        caption=f"lead at {rows[0].condition}",
        corner="class",
        columns=(("FID, as published", Tags()), *((metric, Tags()) for metric in metrics)),
        lines=tuple(lines),
        higher=True,
        tags=Tags(condition=rows[0].condition),
        notes=tuple(_count([row for row in rows if row.metric == metric]) for metric in metrics),
    )


def _cell(row: Ordering) -> Cell:
    return lead_cell(
        row.lead,
        decimals(row.metric),
        mark="reproduced" if row.verdict == "reproduced" else "",
        gap="opposite" if row.verdict == "opposite" else "",
    )


def _count(rows: Sequence[Ordering]) -> str:
    """In how many classes the paper's ordering holds by the metric of these rows."""
    verdicts = [row.verdict for row in rows if row.class_name != AVERAGE]
    return (
        f"{rows[0].metric}: {verdicts.count('reproduced')} of {len(verdicts)} classes reproduced, "
        f"{verdicts.count('opposite')} opposite"
    )
