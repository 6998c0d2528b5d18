"""Tables: tidy rows for scripts, and grids of cells for people.

A `Table` is written as CSV, as Markdown (`bench.tables.markdown`), as LaTeX (`bench.tables.latex`)
and as HTML (its grids, by the template of the report). All four are pure functions of it.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from bench.catalogue.suites import TRUTHS, Suite
from bench.records.run_folder import COLOURED, TRUTH
from bench.tables import latex, markdown
from bench.tables.grid import Block, Grid, records
from data_prep.files.atomic_write import write_whole
from data_prep.progress import log

TABLES = "tables"  # folder of a run


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

    name    of its files, without suffix
    frame   its rows; the columns are those of the CSV
    layout  returns what people see of the frame; None: the table is for scripts alone
    remark  what one has to know to read it in the report
    digits  format of the floats of its CSV; one that is not finite is an empty field
    hidden  columns of the frame for the layout alone
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
        return csv_text(shown.columns, (map(self._field, line.values()) for line in records(shown)))

    def to_rows(self) -> list[dict[str, object]]:
        """Return values by column, unrounded; None for a float that is not finite."""
        return [
            {
                name: None if isinstance(value, float) and not math.isfinite(value) else value
                for name, value in line.items()
            }
            for line in records(self._shown)
        ]

    def to_markdown(self) -> str:
        """Return the title and what people see."""
        return markdown.document([f"# {self.title}", *self._blocks()])

    def to_latex(self) -> str:
        """Return the grids of the report as tables of LaTeX, for below `latex.PREAMBLE`."""
        return latex.document(self.name, self.title, self._blocks())

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


def of_protocol(table: Table, suite: Suite, version: int) -> Table:
    """Return the table with the truth and the protocol's version in its title and as columns.

    Only truth in grey has a column, the last: in colours the suite alone tells it.
    """
    frame = table.frame.assign(protocol=version)
    if suite.truth != COLOURED:
        frame = frame.assign(**{TRUTH: suite.truth})
    title = f"{table.title}; against {TRUTHS[suite.truth]}; protocol {version}"
    return replace(table, title=title, frame=frame)


def table_files(tables: Iterable[Table]) -> dict[str, str]:
    """Return file names and contents: each as CSV, and as Markdown where it has a layout."""
    texts = {".csv": Table.to_csv, ".md": Table.to_markdown}
    return {f"{table.name}{kind}": texts[kind](table) for table in tables for kind in _kinds(table)}


def _kinds(table: Table) -> tuple[str, ...]:
    return (".csv", ".md") if table.layout is not None else (".csv",)


def write_tables(directory: Path, tables: Iterable[Table]) -> None:
    """Write tables into the folder of tables of a run, each file whole or not at all."""
    for name, text in table_files(tables).items():
        write_whole(directory / TABLES / name, text.encode())


def remove_stale(directory: Path, tables: Iterable[Table], own: Iterable[str]) -> None:
    """Remove tables of earlier versions of a run that are not among these, and name them.

    `own` are the names of all tables that a run of its kind writes: other files of that folder are
    of the user, or of `bench score`.
    """
    written, folder = {f"{t.name}{kind}" for t in tables for kind in _kinds(t)}, directory / TABLES
    files = (folder / f"{name}{kind}" for name in own for kind in (".csv", ".md"))
    stale = sorted(path for path in files if path.name not in written and path.is_file())
    if folder.is_symlink():
        return
    for path in stale:
        path.unlink()
    if stale:
        names = ", ".join(dict.fromkeys(path.stem for path in stale))
        log(f"removed from {folder}, as no table of the run as it is now: {names}")
