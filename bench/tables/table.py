"""What a table is: tidy rows for scripts, and grids of cells for people.

A `Table` is written as CSV (`Table.to_csv`), as Markdown (`Table.to_markdown`, by
`bench.tables.markdown`) and as HTML (its `Table.grids`, by the template of the report). All three
are pure functions of it; the modules beside this one say which rows and columns there are.

Texts of grids are plain: each renderer escapes them.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from bench.tables import markdown
from data_prep.files.atomic_write import write_whole

NAN = float("nan")
R = TypeVar("R")
K = TypeVar("K")


# --- tidy rows ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Column:
    """A column of a CSV file.

    of      its value in a row
    digits  format of its floats; one that is not finite is an empty field
    """

    name: str
    of: Callable[[Any], object]
    digits: str = ".6f"

    def field(self, row: object) -> object:
        """What is written for a row."""
        value = self.of(row)
        if not isinstance(value, float):
            return value
        return format(value, self.digits) if math.isfinite(value) else ""


def columns(*names: str | tuple[str, str], digits: str = ".6f") -> tuple[Column, ...]:
    """Columns of attributes: each a name, or a name and the path of its attribute ("lead.low")."""
    pairs = [(name, name) if isinstance(name, str) else name for name in names]
    return tuple(Column(name, attrgetter(path), digits) for name, path in pairs)


def columns_of(kind: type, digits: str = ".6f") -> tuple[Column, ...]:
    """A column for each field of a dataclass; `class_name` is the column `class`."""
    names = [one.name for one in fields(kind)]
    titles = {"class_name": "class"}
    return columns(*((titles.get(name, name), name) for name in names), digits=digits)


def constant(name: str, value: object) -> Column:
    """A column that is the same in all rows."""
    return Column(name, lambda row: value)


def csv_text(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Rows that end with a line feed; what holds a line break of any kind is quoted."""
    return "".join(map(_row, (header, *rows)))


def _row(values: Iterable[object]) -> str:
    # The module quotes only the characters of its own line end, and readers stop at either.
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\r\n").writerow(values)
    return buffer.getvalue().removesuffix("\r\n") + "\n"


# --- grids ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tags:
    """What the filters of the report go by; an empty field is no obstacle to any choice."""

    method: str = ""
    condition: str = ""
    class_name: str = ""
    outcomes: tuple[str, ...] = ()


ANY = Tags()


class Annotation(NamedTuple):
    """What is special about a value.

    word      in the report
    markdown  how Markdown shows it
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
    """A value of a grid, as people read it.

    text      the value, or why there is none
    value     what a column is sorted by; None: comes last
    interval  its ends
    rest      what follows
    count     images that are there, and that should be
    blank     the value with a blank image in place of each that failed, "-" without one; None
              where none failed
    caveat    what speaks against a value that scores failed images as blank ones already
    paper     the published value; empty where there is none
    special   what is special about it
    link      where the value leads, on a page
    """

    text: str
    value: float | None = None
    interval: tuple[str, str] | None = None
    rest: str = ""
    count: tuple[int, int] | None = None
    blank: str | None = None
    caveat: str = ""
    paper: str = ""
    special: Annotation | None = None
    link: str = ""

    @property
    def beside(self) -> str:
        """In the report: its interval, or what it is made of."""
        return " to ".join(self.interval) if self.interval else self.rest

    @property
    def mark(self) -> str:
        """In the report: what is special about it."""
        return self.special.word if self.special and not self.special.against else ""

    @property
    def gap(self) -> str:
        """In the report: what speaks against it, or is missing from it."""
        if self.special and self.special.against:
            return "; ".join(filter(None, (self.special.word, self.caveat)))
        if self.blank is None or self.count is None:
            return self.caveat
        text = f"{self.count[0]} of {self.count[1]} pictures"
        return text if self.blank == "-" else f"{text}; {self.blank} with blank ones for the others"


NOTHING = Cell("-")


def scored_as_blank(n_ok: int, n: int) -> str:
    """Say how many images a value scores as blank ones because they failed; empty for none."""
    return f"{n_ok} of {n} images, the others scored as blank" if n_ok < n else ""


def number(
    estimate: tuple[float, float, float], show: Callable[[float], str], **beside: Any
) -> Cell:
    """A number (value, low, high) with its interval; a dash where it is not finite, and no interval
    where that is not. `beside` are further fields of `Cell`."""
    value, low, high = estimate
    if not math.isfinite(value):
        return Cell("-", **beside)
    interval = (show(low), show(high)) if math.isfinite(low) else None
    return Cell(show(value), value, interval, **beside)


def shown(value: float, decimals: int) -> str:
    """A number for people, 0 without a sign; a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    text = f"{value:.{decimals}f}"
    return text if float(text) else text.removeprefix("-")


class ColumnHeader(NamedTuple):
    """A column of a grid."""

    name: str
    tags: Tags = ANY


@dataclass(frozen=True)
class TableRow:
    """A row of a grid: its name, `about` it in small letters, and a cell for each column; on a page
    the name may `link` somewhere."""

    name: str
    cells: tuple[Cell, ...]
    about: str = ""
    tags: Tags = ANY
    special: Annotation | None = None
    link: str = ""


@dataclass(frozen=True)
class Grid:
    """Cells in lines and columns.

    corner    what the names of the lines are
    caption   in the report; a grid without one is not shown there
    remark    what one has to know to read it
    notes     what is missing, and why
    void      whether nothing was measured: in place of the cells Markdown has the notes alone
    higher    whether a higher value is better: the order that a first sorting gives
    unfolded  whether the report shows it at once
    """

    corner: str
    columns: tuple[ColumnHeader, ...]
    lines: tuple[TableRow, ...]
    caption: str = ""
    remark: str = ""
    notes: tuple[str, ...] = ()
    void: bool = False
    higher: bool = True
    unfolded: bool = True
    tags: Tags = ANY

    @property
    def valued(self) -> bool:
        """Whether there is any number in it."""
        return any(cell.value is not None for line in self.lines for cell in line.cells)


Block = str | Grid  # a paragraph, a heading or a list in Markdown; or a grid


def grid(heads: Sequence[str], lines: Iterable[Sequence[str | Cell]], **more: Any) -> Grid:
    """A grid from its texts, the first of each line being its name. `more` are fields of `Grid`."""
    made = []
    for line in lines:
        name, *cells = (Cell(text) if isinstance(text, str) else text for text in line)
        made.append(TableRow(name.text, tuple(cells), special=name.special))
    return Grid(heads[0], tuple(map(ColumnHeader, heads[1:])), tuple(made), **more)


def pivot(
    rows: Sequence[R],
    line: str,
    column: str,
    cell: Callable[[R], Cell],
    *,
    lines: Iterable[Any] | None = None,
    columns: Iterable[Any] | None = None,
    named: Callable[[R], str] | None = None,
    title: Callable[[Any], str] = str,
    before: Mapping[str, Callable[[R], Cell]] | None = None,
    after: Mapping[str, Callable[[R], Cell]] | None = None,
    about: Callable[[Sequence[R]], str] = lambda of_line: "",
    outcomes: Callable[[Sequence[R]], tuple[str, ...]] = lambda of_line: (),
    missing: Cell = NOTHING,
    corner: str = "",
    **more: Any,
) -> Grid:
    """Tidy rows laid out by two of their attributes; `missing` stands where there is no row.

    lines, columns  values of the attributes, in order; default: all, in the order of the rows
    named           what a line is called, from its first row; default: its attribute
    title           what a column is called, from its attribute
    before, after   further columns at both sides, from the first row of a line
    about, outcomes of a line, from its rows; see `TableRow` and `Tags`
    more            fields of `Grid`
    """
    line_of, column_of = attrgetter(line), attrgetter(column)
    across = ordered(map(column_of, rows)) if columns is None else list(columns)
    before, after = before or {}, after or {}
    made = []
    for key in ordered(map(line_of, rows)) if lines is None else lines:
        of_line = [row for row in rows if line_of(row) == key]
        at = {column_of(row): row for row in of_line}
        first = of_line[:1]
        cells = (
            *(make(row) for make in before.values() for row in first),
            *(cell(at[place]) if place in at else missing for place in across),
            *(make(row) for make in after.values() for row in first),
        )
        name = named(first[0]) if named else str(key)
        tags = _tags(line, key, outcomes(of_line))
        made.append(TableRow(name, cells, about(of_line), tags))
    heads = (
        *map(ColumnHeader, before),
        *(ColumnHeader(title(place), _tags(column, place)) for place in across),
        *map(ColumnHeader, after),
    )
    return Grid(corner, heads, tuple(made), **more)


def _tags(attribute: str, value: Any, outcomes: tuple[str, ...] = ()) -> Tags:
    if attribute not in ("method", "condition", "class_name"):
        return Tags(outcomes=outcomes)
    return Tags(**{attribute: value}, outcomes=outcomes)


def ordered(values: Iterable[K]) -> list[K]:
    """Each value once, in the order of the first times."""
    return list(dict.fromkeys(values))


# --- tables ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Table(Generic[R]):
    """A finished table.

    name     of its files, without suffix
    columns  of its CSV
    layout   what people see of its rows; None: the table is for scripts alone
    remark   what one has to know to read it in the report
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[R, ...]
    layout: Callable[[Sequence[R]], Iterable[Block]] | None = field(default=None, compare=False)
    remark: str = ""

    def to_csv(self) -> str:
        """For scripts: a header, and a line for each row."""
        return csv_text(
            [column.name for column in self.columns],
            ([column.field(row) for column in self.columns] for row in self.rows),
        )

    def to_rows(self) -> list[dict[str, object]]:
        """For scripts: values by column, unrounded; None for a float that is not finite."""

        def value(column: Column, row: R) -> object:
            of = column.of(row)
            return None if isinstance(of, float) and not math.isfinite(of) else of

        return [{c.name: value(c, row) for c in self.columns} for row in self.rows]

    def to_markdown(self) -> str:
        """For people."""
        return markdown.document([f"# {self.title}", *self._blocks()])

    def grids(self) -> tuple[Grid, ...]:
        """What the report shows."""
        return tuple(b for b in self._blocks() if isinstance(b, Grid) and b.caption)

    def _blocks(self) -> Iterable[Block]:
        return self.layout(self.rows) if self.layout else ()


def of_protocol(table: Table[R], version: int) -> Table[R]:
    """The table with the version of the protocol in its title and as the last column of its CSV."""
    title = f"{table.title}; protocol {version}"
    return replace(table, title=title, columns=(*table.columns, constant("protocol", version)))


def table_files(tables: Iterable[Table[Any]]) -> dict[str, str]:
    """File names and contents of tables: each as CSV, and as Markdown where it has a layout."""
    files = {}
    for table in tables:
        files[f"{table.name}.csv"] = table.to_csv()
        if table.layout is not None:
            files[f"{table.name}.md"] = table.to_markdown()
    return files


TABLES = "tables"


def write_tables(directory: Path, tables: Iterable[Table[Any]]) -> None:
    """Write them into the folder of tables of a run, each file whole or not at all."""
    for name, text in table_files(tables).items():
        write_whole(directory / TABLES / name, text.encode())
