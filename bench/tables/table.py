"""Rows of tables as CSV and as Markdown: in the paper's layout, by condition, by class."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from bench.tables import markdown

NAN = float("nan")
NO_VALUE = "no value"
PAPER_METHODS = {"surface-apss": "SR", "pc2pix": "PC2PIX", "pc2pix@acgan": "PC2PIX@acgan"}


@dataclass(frozen=True)
class Row:
    """One cell of a table. A number that does not exist is NaN.

    value              over the pictures whose outcome is ok
    ci_low, ci_high    95 % interval over objects
    n_ok, n            pictures that are there and have a value, pictures there should be
    paper              as published, on the paper's data
    failures_as_blank  the value with a blank picture in place of each failed one
    note               why there is no value, or the reasons of the failures and how many pictures
                       have no value though they are there
    objective          what the weights of a network were trained with; empty for other methods
    """

    suite: str
    method: str
    condition: str
    class_name: str
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n_ok: int
    n: int
    paper: float
    failures_as_blank: float
    note: str
    objective: str = ""


HEADER = [name if name != "class_name" else "class" for name in Row.__dataclass_fields__]


def shown(value: float, decimals: int) -> str:
    """A number for people; a dash where there is none."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def ordered(values: Iterable[str]) -> list[str]:
    """Each value once, in the order of the first times."""
    return list(dict.fromkeys(values))


_LEGEND = (
    "All methods: value [95 % interval over objects] n_ok/n pictures. Where pictures are missing, "
    "*b* is the value with a blank picture in place of each."
)


def paper_layout(rows: Sequence[Row], decimals: int) -> list[str]:
    """SR beside PC2PIX at each condition, the paper's values below ours; nothing without either."""
    rows = [row for row in rows if row.method in PAPER_METHODS]
    if not rows:
        return []
    lines = [
        "In the paper's layout: SR is `surface-apss`. Below a line of ours stands the paper's, as "
        "published: other data (ShapeNet), other weights.",
        "",
    ]
    conditions = ordered(row.condition for row in rows)
    there = {row.method for row in rows}
    shown_methods = [m for m in PAPER_METHODS if m in there or "@" not in m]
    columns = [(condition, method) for condition in conditions for method in shown_methods]
    for class_name in ordered(row.class_name for row in rows):
        lines += [
            markdown.row(
                [
                    markdown.cell(class_name),
                    *(f"{markdown.cell(c)} {PAPER_METHODS[m]}" for c, m in columns),
                ]
            ),
            _rule(len(columns) + 1),
        ]
        for metric in ordered(row.metric for row in rows):
            at = {
                (row.condition, row.method): row
                for row in rows
                if row.metric == metric and row.class_name == class_name
            }
            lines += values_and_papers(metric, [at.get(c) for c in columns], decimals)
        lines.append("")
    return lines


def values_and_papers(metric: str, cells: Sequence[Row | None], decimals: int) -> list[str]:
    """A line of ours, and below it the paper's where it has any."""
    ours = [shown(cell.value, decimals) if cell else "-" for cell in cells]
    if all(cell.note.startswith("skipped") for cell in cells if cell):
        ours = ["skipped"] * len(cells)
    lines = [markdown.row([markdown.cell(metric), *ours])]
    paper = [cell.paper if cell else NAN for cell in cells]
    if any(math.isfinite(value) for value in paper):
        told = [f"{v:g}" if math.isfinite(v) else "-" for v in paper]
        lines.append(markdown.row([f"{markdown.cell(metric)}, paper", *told]))
    return lines


def all_methods(rows: Sequence[Row], decimals: Callable[[str], int]) -> list[str]:
    """A section for each class and metric: methods down, conditions across."""
    lines = _head(rows)
    for class_name in ordered(row.class_name for row in rows):
        for metric in ordered(row.metric for row in rows):
            chosen = [r for r in rows if (r.class_name, r.metric) == (class_name, metric)]
            lines += [f"## {markdown.cell(metric)}, {markdown.cell(class_name)}", ""]
            lines += _section(
                chosen, "method", lambda row: (row.method, row.condition), decimals(metric)
            )
    return lines


def by_class(rows: Sequence[Row], decimals: Callable[[str], int]) -> list[str]:
    """A section for each metric, of rows of one condition: classes down, methods across."""
    lines = _head(rows)
    for metric in ordered(row.metric for row in rows):
        chosen = [row for row in rows if row.metric == metric]
        lines += [f"## {markdown.cell(metric)}", ""]
        lines += _section(
            chosen, "class", lambda row: (row.class_name, row.method), decimals(metric)
        )
    return lines


def _head(rows: Sequence[Row]) -> list[str]:
    trained = {row.method: row.objective for row in rows if row.objective}
    lines = [
        f"{markdown.code(m)}: weights trained with {markdown.code(told)}.  "
        for m, told in trained.items()
    ]
    return [_LEGEND, "", *lines, *([""] * bool(trained))]


def _section(
    rows: Sequence[Row], corner: str, place: Callable[[Row], tuple[str, str]], decimals: int
) -> list[str]:
    """A table of full cells, `place` says in which line and column, and what is missing in it."""
    skipped = ordered(markdown.cell(r.note) for r in rows if r.note.startswith("skipped"))
    if skipped:
        return [*skipped, ""]
    columns = ordered(place(row)[1] for row in rows)
    lines = [markdown.row([corner, *map(markdown.cell, columns)]), _rule(len(columns) + 1)]
    for line in ordered(place(row)[0] for row in rows):
        at = {place(row)[1]: row for row in rows if place(row)[0] == line}
        cells = [_full_cell(at[c], decimals) if c in at else "-" for c in columns]
        lines.append(markdown.row([markdown.cell(line), *cells]))
    lines.append("")
    told = _gaps(rows, corner)
    return [*lines, *told, *([""] * bool(told))]


def _gaps(rows: Sequence[Row], corner: str) -> list[str]:
    """A line for each cell with failures; of cells that only have no value, those alike share."""
    lines: list[str] = []
    alike: dict[str, list[Row]] = {}
    for row in rows:
        if _nothing_failed(row):
            alike.setdefault(row.note, []).append(row)
        elif row.n_ok < row.n:
            where = row.class_name if corner == "class" else row.condition
            told = map(markdown.cell, (row.method, where, row.note))
            lines.append("* {} at {}: {}".format(*told))
    for note, of_note in alike.items():
        methods = ", ".join(map(markdown.cell, ordered(row.method for row in of_note)))
        lines.append(f"* {methods}: {markdown.cell(note)}")
    return lines


def _nothing_failed(row: Row) -> bool:
    """Whether the note is about missing values alone."""
    if row.n_ok == row.n:
        return bool(row.note)
    return f" x {NO_VALUE}: " in row.note and "; " not in row.note


def _full_cell(row: Row, decimals: int) -> str:
    count = f"{row.n_ok}/{row.n}"
    if not math.isfinite(row.value):
        return f"- {count}"
    low, high = shown(row.ci_low, decimals), shown(row.ci_high, decimals)
    interval = f" [{low}, {high}]" if math.isfinite(row.ci_low) else ""
    missing = row.n_ok < row.n and not _nothing_failed(row)
    blank = f" *b* {shown(row.failures_as_blank, decimals)}" if missing else ""
    return f"{shown(row.value, decimals)}{interval} {count}{blank}"


def _rule(columns: int) -> str:
    return "|---" * columns + "|"


def csv_text(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Rows that end with a line feed; what holds a line break of any kind is quoted."""
    return "".join(map(_row, (header, *rows)))


def _row(values: Iterable[object]) -> str:
    # The module quotes only the characters of its own line end, and readers stop at either.
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\r\n").writerow(values)
    return buffer.getvalue().removesuffix("\r\n") + "\n"
