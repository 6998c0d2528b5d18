"""The report's tables: rows of `bench.tables` laid out for people, failures, orderings. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from bench.report.page import (
    Cell,
    Failure,
    FailureGroup,
    Line,
    NumberTable,
    TableGroup,
    Tags,
    lead_cell,
)
from bench.report.styles import higher_is_better, role
from bench.tables.classes import AVERAGE, SURFACE, ClassTable, decimals
from bench.tables.orderings import Ordering, OrderingsTable
from bench.tables.quality import Table
from bench.tables.table import NO_VALUE, Row, ordered

MOST_LISTED = 200  # failures listed for one reason
_MARKUP = re.compile(r"`|\*\*|\\(.)")  # what remarks have, and escapes


def table_groups(tables: Sequence[Table]) -> tuple[TableGroup, ...]:
    """Each table as a group: one with lines for methods and columns for conditions per metric.

    With several classes: lines for classes and columns for methods, per metric and condition, as
    the paper's Table 5.
    """
    by_class = len({row.class_name for table in tables for row in table.rows}) > 1
    groups = []
    for table in tables:
        made = []
        for metric in dict.fromkeys(row.metric for row in table.rows):
            rows = [row for row in table.rows if row.metric == metric]
            digits = decimals(metric) if isinstance(table, ClassTable) else table.decimals
            if not by_class:
                made.append(_by_method(rows, digits))
                continue
            for condition in dict.fromkeys(row.condition for row in rows):
                of_condition = [row for row in rows if row.condition == condition]
                made.append(_by_class(of_condition, digits))
        groups.append(TableGroup(table.title, _plain(table.remark), _folded(made)))
    return tuple(groups)


def _plain(remark: str) -> str:
    """The Markdown of a remark as text."""
    return _MARKUP.sub(r"\1", remark)


def _folded(tables: Sequence[NumberTable]) -> tuple[NumberTable, ...]:
    """All but the first that has values."""
    valued = [
        any(cell.value is not None for line in t.lines for cell in line.cells) for t in tables
    ]
    first = valued.index(True) if any(valued) else 0
    return tuple(replace(table, unfolded=i == first) for i, table in enumerate(tables))


def _by_method(rows: Sequence[Row], digits: int) -> NumberTable:
    """Of one class: methods down, conditions across."""
    conditions, grid = _grid([(row.method, row.condition, row) for row in rows], digits)
    return NumberTable(
        caption=_caption(rows, rows[0].class_name),
        corner="method",
        columns=tuple((condition, Tags(condition=condition)) for condition in conditions),
        lines=tuple(
            Line(method, _about(there[0]), Tags(method=method, outcomes=_outcomes(there)), cells)
            for method, there, cells in grid
        ),
        higher=higher_is_better(rows[0].metric),
        tags=Tags(class_name=rows[0].class_name),
        notes=_notes(rows),
    )


def _by_class(rows: Sequence[Row], digits: int) -> NumberTable:
    """At one condition: classes down, methods across."""
    methods, grid = _grid([(row.class_name, row.method, row) for row in rows], digits)
    return NumberTable(
        caption=_caption(rows, f"at {rows[0].condition}"),
        corner="class",
        columns=tuple((method, Tags(method=method)) for method in methods),
        lines=tuple(
            Line(class_name, "", Tags(class_name=class_name, outcomes=_outcomes(there)), cells)
            for class_name, there, cells in grid
        ),
        higher=higher_is_better(rows[0].metric),
        tags=Tags(condition=rows[0].condition),
        notes=_notes(rows),
    )


def _grid(
    placed: Sequence[tuple[str, str, Row]], digits: int
) -> tuple[list[str], list[tuple[str, list[Row], tuple[Cell, ...]]]]:
    """Rows with their line and column -> the columns; of each line its name, rows and cells.

    The best are told among the methods of one class and condition.
    """
    at = {(line, column): row for line, column, row in placed}
    rivals: dict[tuple[str, str], list[Row]] = {}
    for *_, row in placed:
        rivals.setdefault((row.class_name, row.condition), []).append(row)
    best = {among: _best(rows, digits) for among, rows in rivals.items()}
    columns = list(dict.fromkeys(column for _, column, _ in placed))
    made = []
    for name in dict.fromkeys(line for line, *_ in placed):
        of_line = [at.get((name, column)) for column in columns]
        cells = tuple(_cell(row, digits, best) for row in of_line)
        made.append((name, [row for row in of_line if row is not None], cells))
    return columns, made


def _caption(rows: Sequence[Row], where: str) -> str:
    better = "higher" if higher_is_better(rows[0].metric) else "lower"
    return f"{rows[0].metric}, {where} ({better} is better)"


def _about(row: Row) -> str:
    told = [role(row.method), row.objective and f"trained with {row.objective}"]
    return ", ".join(part for part in told if part)


def _outcomes(rows: Sequence[Row]) -> tuple[str, ...]:
    """What became of the pictures of these rows, in the words of the records."""
    found = set()
    for row in rows:
        if row.note.startswith("skipped"):
            found.add("skipped")
            continue
        if row.n_ok > 0:
            found.add("ok")
        if _failed(row):
            found.add("failed")
    return tuple(sorted(found))


def _failed(row: Row) -> bool:
    """Whether pictures are missing, and not only values of pictures that are there."""
    return row.n_ok < row.n and not _only_no_value(row)


def _only_no_value(row: Row) -> bool:
    return f" x {NO_VALUE}: " in row.note and "; " not in row.note


def _best(rows: Sequence[Row], decimals: int) -> float:
    """The best value as printed, of those that compete; NaN where there are not two."""
    values = [
        round(r.value, decimals) for r in rows if math.isfinite(r.value) and not role(r.method)
    ]
    if len(values) < 2:
        return math.nan
    return max(values) if higher_is_better(rows[0].metric) else min(values)


def _cell(row: Row | None, decimals: int, best: Mapping[tuple[str, str], float]) -> Cell:
    if row is None:
        return Cell("-")
    paper = f"{row.paper:g}" if math.isfinite(row.paper) else ""
    gap = ""
    if _failed(row) and not row.note.startswith("skipped"):
        gap = f"{row.n_ok} of {row.n} pictures"
        if math.isfinite(row.failures_as_blank):
            gap += f"; {row.failures_as_blank:.{decimals}f} with blank ones for the others"
    if not math.isfinite(row.value):
        text = "skipped" if row.note.startswith("skipped") else "-"
        return Cell(text, paper=paper, gap=gap)
    interval = (
        f"{row.ci_low:.{decimals}f} to {row.ci_high:.{decimals}f}"
        if math.isfinite(row.ci_low)
        else ""
    )
    of_rivals = best[row.class_name, row.condition]
    leads = not role(row.method) and round(row.value, decimals) == of_rivals
    return Cell(
        f"{row.value:.{decimals}f}", row.value, interval, paper, gap, "best" if leads else ""
    )


def _notes(rows: Sequence[Row]) -> tuple[str, ...]:
    """Each reason why something is missing once, with the methods and conditions it is true of."""
    every = set(_places(rows, rows[0].method))
    made = []
    for note in dict.fromkeys(row.note for row in rows if row.note):
        of_note = [row for row in rows if row.note == note]
        where = []
        for method in dict.fromkeys(row.method for row in of_note):
            places = _places(of_note, method)
            where.append(method if set(places) == every else f"{method} at {', '.join(places)}")
        made.append(note if note.startswith("skipped") else f"{'; '.join(where)}: {note}")
    return tuple(made)


def _places(rows: Sequence[Row], method: str) -> list[str]:
    """The conditions, or the classes, at which a method is among the rows."""
    by_class = len({row.condition for row in rows}) == 1
    names = (r.class_name if by_class else r.condition for r in rows if r.method == method)
    return list(dict.fromkeys(names))


def failure_groups(records: pd.DataFrame) -> tuple[FailureGroup, ...]:
    """Pictures that are not there, by reason, the most frequent first.

    Each listed is one method on one cloud, with the views that it lacks.
    """
    failed = records[records["outcome"] != "ok"]
    groups = []
    for (outcome, reason), of_reason in failed.groupby(["outcome", "reason"], sort=True):  # type: ignore[misc]
        items = of_reason.groupby(["method", "condition", "class", "object"], sort=False)
        listed = [
            Failure(
                f"{method}/{condition}/{class_name}/{obj}",
                _views(group["view"].tolist()),
                Tags(str(method), str(condition), str(class_name), (str(outcome),)),
            )
            for (method, condition, class_name, obj), group in items  # type: ignore[misc]
        ]
        count = f"{len(of_reason)} pictures of {len(listed)} clouds"
        kept = tuple(listed[:MOST_LISTED])
        group = FailureGroup(str(reason), count, kept, len(listed) - len(kept))
        groups.append((-len(of_reason), group))
    return tuple(group for _, group in sorted(groups, key=lambda pair: pair[0]))


def _views(views: Sequence[int]) -> str:
    if len(views) > 1 and list(views) == list(range(views[0], views[0] + len(views))):
        return f"views {views[0]} to {views[-1]}"
    return f"view{'s' * (len(views) > 1)} {', '.join(map(str, views))}"


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
        lines.append(Line(name, "", tags, (published, *map(_ordering_cell, of_class))))
    return NumberTable(
        caption=f"lead at {rows[0].condition}",
        corner="class",
        columns=(("FID, as published", Tags()), *((metric, Tags()) for metric in metrics)),
        lines=tuple(lines),
        higher=True,
        tags=Tags(condition=rows[0].condition),
        notes=tuple(_count([row for row in rows if row.metric == metric]) for metric in metrics),
    )


def _ordering_cell(row: Ordering) -> Cell:
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
