"""The table of methods along families of conditions: which is ahead, and where that changes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.analysis.comparison import Estimate
from bench.analysis.condition_sweep import Crossover, PairedComparison
from bench.catalogue.conditions import Family
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import (
    Annotation,
    Block,
    Cell,
    Grid,
    Tags,
    measured,
    ordered,
    pivot,
)
from bench.tables.table import Table, columns, constant

AHEAD = Annotation("ahead", "**{value}{interval}**")
BEHIND = Annotation("behind", "*{value}{interval}*", against=True)
NOWHERE = Crossover(-1, math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class ConditionStep:
    """One step of a paired comparison.

    at         the condition's place on the axis of the family
    unseen_by  the networks that were not shown such clouds in training
    crossover  where the curves cross after this step, before the next or at it
    """

    paired: PairedComparison
    condition: str
    at: str
    unseen_by: str
    value: float
    baseline_value: float
    difference: Estimate
    ahead: str
    crossover: Crossover


def condition_sweep_table(
    spec: TableSpec, suite: str, paired_comparisons: Sequence[PairedComparison]
) -> Table[ConditionStep]:
    """Return the table of all paired comparisons of a run."""
    csv = (
        constant("suite", suite),
        *columns(("class", "paired.class_name"), ("family", "paired.family.id")),
        *columns(*((name, f"paired.{name}") for name in ("metric", "method"))),
        *columns(("rival", "paired.baseline")),
        *columns("condition", "at", "unseen_by", "value", ("rival_value", "baseline_value")),
        *columns(
            ("lead", "difference.value"),
            ("ci_low", "difference.low"),
            ("ci_high", "difference.high"),
            "ahead",
        ),
        *columns(("crossing", "crossover.at")),
        *columns(("crossing_low", "crossover.low"), ("crossing_high", "crossover.high")),
    )
    rows = tuple(step for paired in paired_comparisons for step in _steps(paired))
    return Table.of_rows(spec.name, spec.title, csv, rows, _layout, _REMARK)


def _steps(c: PairedComparison) -> Iterator[ConditionStep]:
    crossovers = {crossover.after: crossover for crossover in c.crossovers}
    for i, (at, condition) in enumerate(c.family.steps):
        yield ConditionStep(
            paired=c,
            condition=condition,
            at=f"{at:g}",
            unseen_by=" ".join(c.family.unseen_by(at)),
            value=c.values[i],
            baseline_value=c.baseline_values[i],
            difference=c.differences[i],
            ahead=c.ahead[i],
            crossover=crossovers.get(i, NOWHERE),
        )


def _layout(rows: Sequence[ConditionStep]) -> Iterator[Block]:
    """Yield who is ahead at both ends and where that changes; then the difference at each step."""
    yield _LEGEND
    classes = ordered(row.paired.class_name for row in rows)
    for class_name in classes:
        of_class = [row for row in rows if row.paired.class_name == class_name]
        where = f", {class_name}" if len(classes) > 1 else ""
        yield f"## {markdown.cell(f'From end to end{where}')}"
        yield _summary(ordered(row.paired for row in of_class))
        for family in ordered(row.paired.family for row in of_class):
            yield f"## {markdown.cell(family.axis + where)}"
            yield _leads([row for row in of_class if row.paired.family == family])


_LEGEND = (
    "How much better the first method is than the second, over 0 if it is, [interval, paired over "
    "objects], failed images scored as blank ones. **Bold**: the first is ahead, *italic*: the "
    "second, by an interval without 0; intervals of a metric hold in 95 % for all its cells "
    "together. Curves cross where the lead passes through 0, on straight lines between what was "
    "measured (on the logarithm of the number of points and of the ratio of densities); in "
    "brackets as far as its interval holds 0."
)


_REMARK = (
    "How much better the first of two methods is than the second: over 0 if it is, with its "
    "interval, paired over objects; failed images are scored as blank ones. “ahead” and “behind” "
    "are said where the interval leaves 0 out; intervals of a metric hold in 95 % for all its "
    "cells together. Curves cross where the lead passes through 0, on straight lines between what "
    "was measured; in brackets as far as its interval holds 0."
)


def shown_in_training(family: Family) -> str:
    """Return the range that networks were trained on: "splat-net@chair 512 to 2048"."""
    return ", ".join(
        f"{name} {least:g}" + (f" to {most:g}" if most > least else " only")
        for name, least, most in family.trained
    )


def end_to_end_text(paired: PairedComparison) -> str:
    """Return who is ahead at the first and at the last step, and where the curves cross."""
    first, last = paired.ahead[0], paired.ahead[-1]
    ends = first if first == last else f"{first}, then {last}"
    crossovers = " and ".join(map(crossover_text, paired.crossovers))
    return f"{ends}; {f'crosses at {crossovers}' if crossovers else 'none within'}"


def crossover_text(crossover: Crossover) -> str:
    """Return the place of a crossover with three digits: "0.137 [0.12, 0.15]"."""
    if not math.isfinite(crossover.low):
        return _place(crossover.at)
    return f"{_place(crossover.at)} [{_place(crossover.low)}, {_place(crossover.high)}]"


def _place(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _summary(paired_comparisons: Sequence[PairedComparison]) -> Grid:
    """Return the pairs of methods along families down, metrics across."""
    class_name = paired_comparisons[0].class_name
    return pivot(
        paired_comparisons,
        "sides",
        "metric",
        lambda row: Cell(end_to_end_text(row)),
        line_name=lambda row: row.family.id,
        before={
            "from": lambda row: Cell(row.family.conditions[0]),
            "to": lambda row: Cell(row.family.conditions[-1]),
            "first": lambda row: Cell(row.method),
            "second": lambda row: Cell(row.baseline),
        },
        corner="family",
        caption=f"from end to end, {class_name}",
        tags=Tags(class_name=class_name),
    )


def _leads(rows: Sequence[ConditionStep]) -> Grid:
    """Return the differences along one family, metrics down and steps across."""
    class_name, family = rows[0].paired.class_name, rows[0].paired.family
    at = {row.condition: row.at for row in rows}
    return pivot(
        rows,
        "paired",
        "condition",
        _lead,
        line_name=lambda row: row.paired.metric,
        column_name=lambda condition: at[condition],
        before={
            "first": lambda row: Cell(row.paired.method),
            "second": lambda row: Cell(row.paired.baseline),
        },
        corner="metric",
        caption=f"lead along {family.axis}, {class_name}",
        remark=f"In training: {shown_in_training(family)}." if family.trained else "",
        tags=Tags(class_name=class_name),
    )


def _lead(row: ConditionStep) -> Cell:
    metric, sides = row.paired.metric, (row.paired.method, row.paired.baseline)
    marks = dict(zip(sides, (AHEAD, BEHIND), strict=True))
    return measured(row.difference, metric, *sides, sign="+", special=marks.get(row.ahead))
