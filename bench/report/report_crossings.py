"""The report of what lies beyond training: a plot for each family, and who is ahead. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from bench.analysis.comparison import decimals
from bench.analysis.crossings import Contest, Course
from bench.catalogue.families import Family
from bench.report.page import (
    Cell,
    Line,
    NumberTable,
    Plot,
    Style,
    TableGroup,
    Tags,
    lead_cell,
)
from bench.report.report_curves import curves
from bench.tables.crossings import CrossingsTable, shown_in_training, told_crossing
from bench.tables.quality import Table

_REMARK = (
    "How much better the first of two methods is than the second: over 0 if it is, with its 95 % "
    "interval, paired over objects; failed pictures are scored as blank ones. “ahead” and “behind” "
    "are said where the interval leaves 0 out. Curves cross where the lead passes through 0, on "
    "straight lines between what was measured; in brackets as far as its interval holds 0."
)


def family_curves(
    tables: Sequence[Table], styles: Mapping[str, Style], courses: Sequence[Course]
) -> tuple[Plot, ...]:
    """`bench.report.report_curves.curves` for each family and metric of `courses` apart."""
    plots = []
    for family, metric in dict.fromkeys((c.family, c.metric) for c in courses):
        plots += [
            replace(
                plot,
                title=f"{metric} against {family.id}, class {plot.tags.class_name}",
                x_title=family.axis,
            )
            for plot in curves([_part(table, family, metric) for table in tables], styles)
        ]
    return tuple(plots)


def _part(table: Table, family: Family, metric: str) -> Table:
    """The rows of a metric at the conditions of a family, in its order."""
    rows = (
        row
        for condition in family.conditions
        for row in table.rows
        if (row.condition, row.metric) == (condition, metric)
    )
    return replace(table, rows=tuple(rows))


def crossings_group(made: CrossingsTable) -> TableGroup:
    """The leads: a table for each family, a line for each pair and metric, a column for a step."""
    cells = dict.fromkeys((c.class_name, c.family) for c in made.contests)
    tables = (
        _leads([c for c in made.contests if (c.class_name, c.family) == cell], unfolded=number == 0)
        for number, cell in enumerate(cells)
    )
    return TableGroup("Who is ahead beyond training, and where that ends", _REMARK, tuple(tables))


def _leads(contests: Sequence[Contest], unfolded: bool) -> NumberTable:
    class_name, family = contests[0].class_name, contests[0].family
    lines = tuple(
        Line(
            f"{c.method} against {c.rival}",
            c.metric,
            Tags(),
            (*(_lead(c, step) for step in range(len(family.steps))), _crossing(c)),
        )
        for c in contests
    )
    return NumberTable(
        caption=f"lead along {family.id}, {class_name}",
        corner="pair",
        columns=(
            *((condition, Tags(condition=condition)) for condition in family.conditions),
            ("curves cross at", Tags()),
        ),
        lines=lines,
        higher=True,
        unfolded=unfolded,
        tags=Tags(class_name=class_name),
        notes=(f"{family.axis}; in training: {shown_in_training(family)}",),
    )


def _lead(c: Contest, step: int) -> Cell:
    ahead = c.ahead[step]
    return lead_cell(
        c.leads[step],
        decimals(c.metric),
        mark="ahead" if ahead == c.method else "",
        gap="behind" if ahead == c.rival else "",
    )


def _crossing(c: Contest) -> Cell:
    """The first; its number orders the column."""
    if not c.crossings:
        return Cell("none within")
    return Cell(" and ".join(map(told_crossing, c.crossings)), c.crossings[0].at)
