"""Grids of cells, as people read a table: in Markdown, on a page, on a terminal.

Texts of grids are plain: each renderer escapes them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from bench.analysis.digits import decimals, is_coarse

if TYPE_CHECKING:
    import pandas as pd

K = TypeVar("K")


class Annotation(NamedTuple):
    """A remark on a value.

    word      in the report
    markdown  how Markdown shows the value
    against   whether it speaks against the value
    """

    word: str
    markdown: str = "{value}{interval}"
    against: bool = False


BEST = Annotation("best")
BOLD = Annotation("", "**{value}**{interval}")
ITALIC = Annotation("", "*{value}*{interval}")


@dataclass(frozen=True)
class Cell:
    """A value of a grid.

    text      the value, or why it is missing
    value     number that a column is sorted by; None comes last
    interval  its ends
    rest      text that follows
    count     images that exist, and that should
    blank     the value with a blank image in place of each that failed, "-" without one; None
              where none failed
    paper     the published value; empty without one
    special   a remark on the value
    """

    text: str
    value: float | None = None
    interval: tuple[str, str] | None = None
    rest: str = ""
    count: tuple[int, int] | None = None
    blank: str | None = None
    paper: str = ""
    special: Annotation | None = None

    @property
    def beside(self) -> str:
        """Return what the report shows beside the value: its interval, or what it is made of."""
        return " to ".join(self.interval) if self.interval else self.rest

    @property
    def mark(self) -> str:
        """Return the report's remark on the value."""
        return self.special.word if self.special and not self.special.against else ""

    @property
    def gap(self) -> str:
        """Return what speaks against the value, or is missing from it, in the report."""
        parts = [self.special.word] if self.special and self.special.against else []
        if self.blank is not None and self.count is not None:
            parts.append("{} of {} images".format(*self.count))
            parts += [f"{self.blank} with blank ones for the others"] * (self.blank != "-")
        return "; ".join(parts)


NOTHING = Cell("-")


def scored_as_blank(n_ok: int, n: int) -> str:
    """Say how many images a value scores as blank ones because they failed; empty for none."""
    return f"{n_ok} of {n} images, the others scored as blank" if n_ok < n else ""


def number(
    estimate: tuple[float, float, float], show: Callable[[float], str], **beside: Any
) -> Cell:
    """Return the cell of a number (value, low, high) with its interval; `beside` are more fields.

    A number that is not finite is a dash; an interval that is not finite is left out.
    """
    value, low, high = estimate
    if not math.isfinite(value):
        return Cell("-", **beside)
    interval = (show(low), show(high)) if math.isfinite(low) else None
    return Cell(show(value), value, interval, **beside)


MOVED = "≈"  # before a value that has fewer digits
FEWER = f"{MOVED}: fewer digits, as rounding alone moves the others"
UNSURE = "†"  # after an interval that may well miss the true value
FEW_FAILED = (
    f"{UNSURE}: images failed, and objects are few; how often images fail is hardly known, and the "
    "interval may miss the true value"
)


def measured(
    estimate: tuple[float, float, float],
    metric: str,
    *methods: str,
    sign: str = "",
    **beside: Any,
) -> Cell:
    """Return the cell of a value of a metric with its interval, or of a difference of methods.

    `sign` is "+" for a number that has one always; `beside` are more fields.
    """
    digits = decimals(metric, *methods)
    show = f"{{:+.{digits}f}}".format if sign else partial(shown, digits=digits)
    return marked(number(estimate, show, **beside), metric, *methods)


def unsure(cell: Cell) -> Cell:
    """Return a cell, its interval marked as one that may well miss the true value."""
    if cell.interval is None:
        return cell
    low, high = cell.interval
    return replace(cell, interval=(low, high + UNSURE))


def meanings(cells: Iterable[Cell]) -> list[str]:
    """Return the meaning of each mark that these cells have."""
    every = list(cells)
    of_marks = {
        FEWER: any(MOVED in cell.text for cell in every),
        FEW_FAILED: any(cell.interval and UNSURE in cell.interval[1] for cell in every),
    }
    return [meaning for meaning, is_there in of_marks.items() if is_there]


def marked(cell: Cell, metric: str, *methods: str) -> Cell:
    """Return a cell, marked where it has a value with fewer digits than its metric."""
    coarse = cell.value is not None and is_coarse(metric, *methods)
    return replace(cell, text=MOVED + cell.text) if coarse else cell


def shown(value: float, digits: int) -> str:
    """Return a number for people, 0 without a sign; a dash for one that is not finite."""
    if not math.isfinite(value):
        return "-"
    text = f"{value:.{digits}f}"
    return text if float(text) else text.removeprefix("-")


@dataclass(frozen=True)
class TableRow:
    """A row of a grid: its name, `about` it in small letters, and a cell for each column."""

    name: str
    cells: tuple[Cell, ...]
    about: str = ""


OVER_OBJECTS = "95 % interval over objects"


@dataclass(frozen=True)
class Grid:
    """Cells in lines and columns.

    corner    what the names of the lines are
    metric    whose values these are; empty for other grids
    caption   in the report; a grid without one is not shown there
    remark    what one has to know to read it
    notes     what is missing, and why
    void      whether nothing was measured: in place of the cells Markdown has the notes alone
    higher    whether a higher value is better: the order that a first sorting gives
    interval  what stands in brackets beside a value
    """

    corner: str
    columns: tuple[str, ...]
    lines: tuple[TableRow, ...]
    metric: str = ""
    caption: str = ""
    remark: str = ""
    notes: tuple[str, ...] = ()
    void: bool = False
    higher: bool = True
    interval: str = OVER_OBJECTS

    @property
    def valued(self) -> bool:
        """Return whether any cell has a number."""
        return any(cell.value is not None for line in self.lines for cell in line.cells)

    @property
    def all_notes(self) -> tuple[str, ...]:
        """Return the notes, and last the meaning of each mark."""
        return (*self.notes, *meanings(cell for line in self.lines for cell in line.cells))


Block = str | Grid  # a paragraph, a heading or a list in Markdown; or a grid


def grid(heads: Sequence[str], lines: Iterable[Sequence[Any]], **more: Any) -> Grid:
    """Return a grid from texts and cells, the first of each line its name; `more` are its fields.

    The first head is the corner.
    """
    rows = (
        TableRow(name, tuple(Cell(text) if isinstance(text, str) else text for text in cells))
        for name, *cells in lines
    )
    return Grid(heads[0], tuple(heads[1:]), tuple(rows), **more)


def pivot(
    frame: pd.DataFrame,
    line: str,
    column: str,
    cell: Callable[[Any], Cell],
    *,
    corner: str = "",
    lines: Iterable[Any] | None = None,
    columns: Iterable[Any] | None = None,
    line_name: Callable[[Any], str] | None = None,
    column_name: Callable[[Any], str] = str,
    before: Mapping[str, Callable[[Any], Cell]] | None = None,
    after: Mapping[str, Callable[[Any], Cell]] | None = None,
    about: Callable[[Sequence[Any]], str] = lambda rows: "",
    missing: Cell = NOTHING,
    **more: Any,
) -> Grid:
    """Return a frame as a grid by two of its columns; functions get its rows as mappings.

    lines, columns          values of the two columns, in order; by default all, in the order of the
                            rows
    line_name, column_name  return the name of a line from its first row, and of a column from the
                            value
    before, after           further columns at both sides, from the first row of a line
    about                   returns what stands in small letters beside a line's name, from its rows
    missing                 stands where there is no row
    more                    fields of `Grid`
    """
    rows = records(frame)
    across = ordered(row[column] for row in rows) if columns is None else list(columns)
    before, after = before or {}, after or {}
    down = []
    for key in ordered(row[line] for row in rows) if lines is None else lines:
        of_line = [row for row in rows if row[line] == key]
        at_column = {row[column]: row for row in of_line}
        first = of_line[:1]
        cells = (
            *(further(row) for further in before.values() for row in first),
            *(cell(at_column[name]) if name in at_column else missing for name in across),
            *(further(row) for further in after.values() for row in first),
        )
        name = line_name(first[0]) if line_name else str(key)
        down.append(TableRow(name, cells, about(of_line)))
    heads = (*before, *map(column_name, across), *after)
    return Grid(corner, heads, tuple(down), **more)


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a frame as mappings, numbers as those of Python."""
    return frame.to_dict("records")  # type: ignore[return-value]


def ordered(values: Iterable[K]) -> list[K]:
    """Return each value once, in the order of first appearance."""
    return list(dict.fromkeys(values))
