"""Text on a terminal, laid out by rich: paragraphs and tables, no wider than the terminal.

rich is imported where something is laid out: what needs no table answers at once.
"""

from __future__ import annotations

import io
import re
import shutil
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from bench.tables.grid import BEST, DASH, Cell, Grid, meanings
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from rich.padding import Padding
    from rich.table import Table

ANY_WIDTH = 10_000  # columns: more than any line has
_MOST_NOTES = 3  # notes that are shown; a line counts the others
_FEWEST_LINES = 10  # lines that grids have at least, however low the terminal is
STAR = "* best of those that compete"  # the meaning of a star


def terminal_width(otherwise: int = 80) -> int:
    """Return the columns of the terminal or those of COLUMNS; `otherwise` without either."""
    return shutil.get_terminal_size((otherwise, 24)).columns


def line_width() -> int:
    """Return the columns that lines on stdout may have: any number where it is no terminal."""
    return terminal_width() if sys.stdout.isatty() else ANY_WIDTH


def laid_out(blocks: Iterable[str | Table | Padding], width: int) -> list[str]:
    """Return paragraphs and tables as lines of at most `width` columns, without colours.

    Texts wrap at words, and a word that is wider than its column goes on in the next line.
    """
    from rich.console import Console

    text = io.StringIO()
    console = Console(
        file=text, width=width, color_system=None, markup=False, emoji=False, highlight=False
    )
    for block in blocks:
        console.print(block)
    return [line.rstrip() for line in text.getvalue().splitlines()]


def table(heads: Sequence[str], lines: Iterable[Sequence[str]], left: int = 1) -> Table:
    """Return a table without rules, its first `left` columns aligned at the left."""
    from rich.table import Table

    laid = Table(box=None, pad_edge=False, show_header=any(heads))
    for number, head in enumerate(heads):
        laid.add_column(head, justify="left" if number < left else "right", overflow="fold")
    for line in lines:
        laid.add_row(*line)
    return laid


def in_parts(heads: Sequence[str], lines: Sequence[Sequence[str]], width: int) -> list[Table]:
    """Return a table, or several with some of its columns each where it is wider than `width`.

    The first column is in all of them.
    """
    from rich.console import Console
    from rich.measure import Measurement

    console = Console(width=ANY_WIDTH)
    tables: list[Table] = []
    for size in range(len(heads) - 1, 0, -1):  # columns in each part, beside the first
        tables = []
        for start in range(1, len(heads), size):
            part = slice(start, start + size)
            lines_of_part = [[line[0], *line[part]] for line in lines]
            tables.append(table([heads[0], *heads[part]], lines_of_part))
        if all(Measurement.get(console, console.options, t).maximum <= width for t in tables):
            break
    return tables


def grid_lines(grids: Sequence[Grid], width: int, lines: int) -> list[str]:
    """Return grids as lines of at most `width` columns: at most `lines` of them, but 10 at least.

    Intervals are shown where there is room for them. Where lines have to be left out, one says how
    many.
    """
    shown = [grid for grid in grids if not grid.void]
    notes = [visible(note) for grid in grids for note in grid.notes]
    if len(notes) > _MOST_NOTES:
        notes[_MOST_NOTES:] = [f"... {len(notes) - _MOST_NOTES} more remarks, in the tables"]
    has_intervals = any(cell.interval for cell in _cells(shown))
    rows, end = list[str](), list[str]()
    for intervals in (True, False) if has_intervals else (False,):
        texts = [_legend(shown, intervals), *notes]
        end = [_cut(text, width) for text in texts if text]
        tables = [_tables(grid, intervals, width) for grid in shown]
        rows = []
        for grid, of_grid in zip(shown, tables, strict=True):
            better = "higher" if grid.higher else "lower"
            rows += [_cut(f"{grid.metric}, {better} is better", width), *laid_out(of_grid, width)]
        if len(rows) + len(end) <= lines and all(len(of_grid) == 1 for of_grid in tables):
            break
    most = max(_FEWEST_LINES, lines) - len(end)
    if len(rows) > most:
        left_out = len(rows) - most + 1
        rows[most - 1 :] = [_cut(f"... {left_out} more lines, in the tables", width)]
    return [*rows, *end]


def _cells(grids: Iterable[Grid]) -> list[Cell]:
    return [cell for grid in grids for line in grid.lines for cell in line.cells]


def _legend(grids: Sequence[Grid], intervals: bool) -> str:
    """Return the meaning of the marks of all cells, which may be shown without intervals."""
    cells = _cells(grids)
    texts = [STAR] if any(cell.special is BEST for cell in cells) else []
    if intervals:
        texts.append(f"[{grids[0].interval}]")
    else:
        cells = [replace(cell, interval=None) for cell in cells]
    return "; ".join([*texts, *meanings(cells)])


def _tables(grid: Grid, intervals: bool, width: int) -> list[Table]:
    """Return a grid as a table, or as several where it is wider than `width`."""
    heads = ["", *map(visible, grid.columns)]
    lines = [
        [visible(line.name), *(value_text(cell, intervals) for cell in line.cells)]
        for line in grid.lines
    ]
    return in_parts(heads, lines, width)


def value_text(cell: Cell, interval: bool) -> str:
    """Return the value, and its interval without the zeros before the points: "0.812 [.79, .83]".

    A dash where all images failed.
    """
    if cell.count and not cell.count[0]:
        return DASH.text
    text = visible(cell.text)
    if cell.special is BEST:
        text = f"*{text}"
    if not interval or cell.value is None or cell.interval is None:
        return text
    low, high = (re.sub(r"^(-?)0\.", r"\1.", end) for end in cell.interval)
    return f"{text} [{low}, {high}]"


def _cut(text: str, width: int) -> str:
    """Return a text as one line of at most `width` columns, which ends in "…" where it is cut."""
    from rich.text import Text

    line = Text(text)
    line.truncate(width, overflow="ellipsis")
    return line.plain
