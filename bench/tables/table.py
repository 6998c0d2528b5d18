"""Tables: tidy rows for scripts, and grids of cells for people.

A `Table` is written as CSV, as Markdown (`bench.tables.markdown`), as LaTeX (`bench.tables.latex`)
and as HTML (its grids, by the template of the report). All four are pure functions of it.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import pandas as pd

from bench.catalogue.suites import TRUTHS, Suite
from bench.records.folder import COLOURED, TRUTH
from bench.tables import latex, markdown
from bench.tables.grid import Block, Grid, row_mappings
from data_prep.files.atomic_write import write_whole
from data_prep.progress import log

TABLES = "tables"  # folder of tables in that of a run


def csv_text(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return rows that end with a line feed; a field with a line break of any kind is quoted."""
    return "".join(map(_csv_line, (header, *rows)))


def _csv_line(values: Iterable[object]) -> str:
    # `csv` quotes only the characters of its own line end, and readers stop at either.
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\r\n").writerow(values)
    return buffer.getvalue().removesuffix("\r\n") + "\n"


@dataclass(frozen=True, eq=False)
class Table:
    """A finished table.

    name    name of its files, without suffix
    title   above the table
    frame   its rows, with the columns of the CSV and those that are hidden
    layout  returns the texts and grids that people see of the frame; None for a table that only
            scripts read
    remark  what a reader has to know to read it in the report
    digits  format of the floats in the CSV; a float that is not finite is an empty field
    hidden  columns of the frame that the layout needs, and that no file has
    """

    name: str
    title: str
    frame: pd.DataFrame
    layout: Callable[[pd.DataFrame], Iterable[Block]] | None = None
    remark: str = ""
    digits: str = ".6f"
    hidden: tuple[str, ...] = ()

    def to_csv(self) -> str:
        """Return a header, and a line for each row."""
        shown = self._shown
        return csv_text(
            shown.columns, (map(self._field, line.values()) for line in row_mappings(shown))
        )

    def to_rows(self) -> list[dict[str, object]]:
        """Return values by column, unrounded; None for a float that is not finite."""
        rows: list[dict[str, object]] = []
        for row in row_mappings(self._shown):
            rows.append({name: _finite_or_none(value) for name, value in row.items()})
        return rows

    def to_markdown(self) -> str:
        """Return the title and what people see."""
        return markdown.document([f"# {self.title}", *self._blocks()])

    def to_latex(self) -> str:
        """Return the grids of the report as LaTeX, which has to follow `latex.PREAMBLE`."""
        return latex.document(self.name, self.title, self._blocks())

    def of_methods(self, methods: Collection[str]) -> Table:
        """Return the table with the rows of these methods; of pairs those of two of them."""
        frame = self.frame
        for column in {"method", "rival"}.intersection(frame.columns):
            frame = frame[frame[column].isin(methods)]
        return replace(self, frame=frame.reset_index(drop=True))

    def grids(self) -> tuple[Grid, ...]:
        """Return the grids that the report shows."""
        return tuple(b for b in self._blocks() if isinstance(b, Grid) and b.caption)

    @property
    def _shown(self) -> pd.DataFrame:
        return self.frame.drop(columns=[*self.hidden])

    def _field(self, value: object) -> object:
        if not isinstance(value, float):
            return value
        return format(value, self.digits) if math.isfinite(value) else ""

    def _blocks(self) -> Iterable[Block]:
        return self.layout(self.frame) if self.layout else ()


def _finite_or_none(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def of_protocol(table: Table, suite: Suite, version: int) -> Table:
    """Return the table with the version of the protocol and the truth in its title and columns.

    There is a column of the truth, the last one, only where true images are grey: without it they
    are in colours.
    """
    frame = table.frame.assign(protocol=version)
    if suite.truth != COLOURED:
        frame = frame.assign(**{TRUTH: suite.truth})
    title = f"{table.title}; against {TRUTHS[suite.truth]}; protocol {version}"
    return replace(table, title=title, frame=frame)


def table_files(tables: Iterable[Table]) -> dict[str, str]:
    """Return file names and contents: each as CSV, and as Markdown where it has a layout."""
    texts = {}
    for table in tables:
        texts[f"{table.name}.csv"] = table.to_csv()
        if table.layout is not None:
            texts[f"{table.name}.md"] = table.to_markdown()
    return texts


def write_tables(directory: Path, tables: Iterable[Table]) -> None:
    """Write tables into the folder of tables of a run, each file whole or not at all."""
    for name, text in table_files(tables).items():
        write_whole(directory / TABLES / name, text.encode())


def remove_stale(directory: Path, tables: Iterable[Table], own: Iterable[str]) -> None:
    """Remove the tables that a run had before and no longer has, and name them on stderr.

    tables  those that it has now
    own     names of all tables that a run of its suite can have; files of other names in the folder
            belong to the user or to `bench score`, and stay
    """
    folder = directory / TABLES
    written = set()
    for table in tables:
        written.add(f"{table.name}.csv")
        if table.layout is not None:
            written.add(f"{table.name}.md")
    possible = [f"{name}{suffix}" for name, suffix in product(own, (".csv", ".md"))]
    stale = sorted(folder / name for name in possible if name not in written)
    stale = [path for path in stale if path.is_file()]
    if folder.is_symlink():
        return
    for path in stale:
        path.unlink()
    if stale:
        names = ", ".join(dict.fromkeys(path.stem for path in stale))
        log(f"removed from {folder}, as no table of the run as it is now: {names}")
