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
from bench.catalogue.methods import role

if TYPE_CHECKING:
    import pandas as pd

K = TypeVar("K")  # of values that are ordered


class Annotation(NamedTuple):
    """A remark on a value.

    word      the remark in the report
    markdown  the value as Markdown shows it, with the places {value} and {interval}
    against   whether the remark speaks against the value
    """

    word: str
    markdown: str = "{value}{interval}"
    against: bool = False


BEST = Annotation("best")
BOLD = Annotation("", "**{value}**{interval}")
ITALIC = Annotation("", "*{value}*{interval}")


@dataclass(frozen=True)
class Cell:
    """A cell of a grid: a value with what stands beside it.

    text      the value as people read it, or why it is missing
    value     the number by which a column is sorted; None comes last
    interval  both ends of the value's interval, as people read them
    rest      text that follows the value and its interval
    count     how many images exist, and how many should exist
    blank     the value with a blank image in place of each that failed, "-" where it has none; None
              where no image failed
    paper     the published value; empty where the paper has none
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
            existing, planned = self.count
            parts.append(f"{existing} of {planned} images")
            if self.blank != "-":
                parts.append(f"{self.blank} with blank ones for the others")
        return "; ".join(parts)


DASH = Cell("-")  # where there is no value


def scored_as_blank(n_ok: int, n: int) -> str:
    """Say how many images exist, and that the others are scored as blank; empty if none failed."""
    return f"{n_ok} of {n} images, the others scored as blank" if n_ok < n else ""


def number_cell(
    estimate: tuple[float, float, float], show: Callable[[float], str], **beside: Any
) -> Cell:
    """Return the cell of a number with its interval.

    estimate  (value, low, high); a value that is not finite becomes a dash, an interval that is
              not finite is left out
    show      returns a number as text
    beside    further fields of the cell
    """
    value, low, high = estimate
    if not math.isfinite(value):
        return Cell("-", **beside)
    interval = (show(low), show(high)) if math.isfinite(low) else None
    return Cell(show(value), value, interval, **beside)


MOVED = "≈"  # before a value that is printed with fewer digits than its metric has
FEWER = f"{MOVED} rounded: the last digits are noise"
UNSURE = "†"  # after an interval that may well miss the true value
FEW_FAILED = (
    f"{UNSURE}: images failed, and objects are few; how often images fail is hardly known, and the "
    "interval may miss the true value"
)


def metric_cell(
    estimate: tuple[float, float, float],
    metric: str,
    *methods: str,
    sign: str = "",
    **beside: Any,
) -> Cell:
    """Return the cell of a metric's value with its interval, or of a difference of such values.

    estimate  (value, low, high)
    methods   the methods that drew the images; they decide how many digits are printed
    sign      "+" for a difference: a number over 0 has a sign, too
    beside    further fields of the cell
    """
    digits = decimals(metric, *methods)
    show = f"{{:+.{digits}f}}".format if sign else partial(number_text, digits=digits)
    return marked(number_cell(estimate, show, **beside), metric, *methods)


def unsure(cell: Cell) -> Cell:
    """Return the cell with its interval marked as one that may well miss the true value."""
    if cell.interval is None:
        return cell
    low, high = cell.interval
    return replace(cell, interval=(low, high + UNSURE))


def meanings(cells: Iterable[Cell]) -> list[str]:
    """Return the meaning of each mark that these cells have."""
    every = list(cells)
    texts = []
    if any(MOVED in cell.text for cell in every):
        texts.append(FEWER)
    if any(cell.interval and UNSURE in cell.interval[1] for cell in every):
        texts.append(FEW_FAILED)
    return texts


def marked(cell: Cell, metric: str, *methods: str) -> Cell:
    """Return the cell, marked where its value has fewer digits than the metric has."""
    coarse = cell.value is not None and is_coarse(metric, *methods)
    return replace(cell, text=MOVED + cell.text) if coarse else cell


def number_text(value: float, digits: int) -> str:
    """Return a number as people read it, 0 without a sign; a dash for one that is not finite."""
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


OVER_OBJECTS = "95 % interval over objects"  # what stands in brackets in most grids


@dataclass(frozen=True)
class Grid:
    """Cells in lines and columns.

    corner    what the names of the lines are, which stands above them
    columns   names of the columns
    metric    the metric of the values; empty for other grids
    caption   above the grid in the report, which does not show a grid without one
    remark    what a reader has to know to read it
    notes     what is missing, and why
    void      whether nothing was measured: Markdown then has the notes in place of the cells
    higher    whether a higher value is better: the report sorts the best first
    interval  what stands in brackets beside a value
    keys      how many of the first columns tell a line from others of the same name
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
    keys: int = 0

    @property
    def valued(self) -> bool:
        """Return whether any cell has a number."""
        return any(cell.value is not None for line in self.lines for cell in line.cells)

    @property
    def all_notes(self) -> tuple[str, ...]:
        """Return the notes, and last the meaning of each mark."""
        return (*self.notes, *self.meanings)

    @property
    def meanings(self) -> list[str]:
        """Return the meaning of each mark."""
        return meanings(cell for line in self.lines for cell in line.cells)


def role_in_words(method_id: str) -> str:
    """Return what tables call the role of a row, "upper bound" for "ceiling"; "" without a role."""
    words = {"ceiling": "upper bound", "floor": "lower bound"}
    return words.get(role(method_id), role(method_id))


Block = str | Grid  # a paragraph, a heading or a list in Markdown; or a grid


def grid(heads: Sequence[str], lines: Iterable[Sequence[Any]], **more: Any) -> Grid:
    """Return a grid of texts and cells.

    heads  names of the columns; the first stands above the names of the lines
    lines  each begins with its name
    more   further fields of `Grid`
    """

    def cell_of(content: Any) -> Cell:
        return Cell(content) if isinstance(content, str) else content

    rows = [TableRow(name, tuple(map(cell_of, contents))) for name, *contents in lines]
    corner, *columns = heads
    return Grid(corner, tuple(columns), tuple(rows), **more)


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
    missing: Cell = DASH,
    **more: Any,
) -> Grid:
    """Return the rows of a frame as a grid: a cell for each row, placed by two of its columns.

    Functions get the rows of the frame as mappings.

    line, column            columns of the frame: a value of the first is a line of the grid, a
                            value of the second a column
    cell                    returns the cell of a row
    corner                  what the names of the lines are
    lines, columns          values of the two columns, in order; by default all, in the order of the
                            rows
    line_name, column_name  return the name of a line from its first row, and of a column from the
                            value
    before, after           further columns at both sides: functions of the first row of a line
    about                   returns what stands in small letters beside a line's name, from its rows
    missing                 cell for a line and a column that no row has
    more                    further fields of `Grid`
    """
    rows = row_mappings(frame)
    across = ordered(row[column] for row in rows) if columns is None else list(columns)
    down = ordered(row[line] for row in rows) if lines is None else list(lines)
    before, after = before or {}, after or {}
    table_rows = []
    for key in down:
        of_line = [row for row in rows if row[line] == key]
        at_column = {row[column]: row for row in of_line}
        cells = []
        if of_line:
            cells += [further(of_line[0]) for further in before.values()]
        cells += [cell(at_column[name]) if name in at_column else missing for name in across]
        if of_line:
            cells += [further(of_line[0]) for further in after.values()]
        name = line_name(of_line[0]) if line_name else str(key)
        table_rows.append(TableRow(name, tuple(cells), about(of_line)))
    heads = (*before, *map(column_name, across), *after)
    return Grid(corner, heads, tuple(table_rows), keys=len(before), **more)


def row_mappings(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a frame as mappings from columns to values, numbers as those of Python."""
    return frame.to_dict("records")  # type: ignore[return-value]


def ordered(values: Iterable[K]) -> list[K]:
    """Return each value once, in the order of first appearance."""
    return list(dict.fromkeys(values))
