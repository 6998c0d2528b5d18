"""Grids as plain text for a terminal, no wider and no longer than asked for."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich.cells import cell_len, set_cell_size

from bench.tables.grid import BEST, FEWER, Cell, Grid
from bench.tables.markdown import visible

WIDEST_NAME = 30
GAP = "  "
NOTES = 3  # of all grids
FEWEST_LINES = 10
STAR = "* best of those that compete"


def plain(grids: Sequence[Grid], width: int, lines: int) -> list[str]:
    """Return lines of at most `width` columns, at most `lines` of them, but 10 at least.

    All grids have lines of the same names. They stand side by side or one below the other, with
    intervals where there is room; what has no room is left out, and a line says how much.
    """
    shown = [grid for grid in grids if not grid.void]
    notes = [_cut(visible(note), width) for grid in grids for note in grid.notes]
    if len(notes) > NOTES:
        notes[NOTES:] = [f"... {len(notes) - NOTES} more remarks, in the tables"]
    cells = [cell for grid in shown for line in grid.lines for cell in line.cells]
    rows, end = list[str](), list[str]()
    for intervals in (True, False):
        marks = [STAR] if any(cell.special is BEST for cell in cells) else []
        if intervals and any(cell.interval for cell in cells):
            marks.append(f"[{shown[0].interval}]")
        if any(cell.coarse for cell in cells):
            marks.append(FEWER)
        end = [*([_cut("; ".join(marks), width)] if marks else []), *notes]
        for beside in (True, False):
            fits, rows = _rows(shown, intervals, beside, width)
            if fits and len(rows) + len(end) <= lines:
                return [*rows, *end]
    most = max(FEWEST_LINES, lines) - len(end)
    if len(rows) > most:
        left = len(rows) - most + 1
        rows[most - 1 :] = [_cut(f"... {left} more lines, in the tables", width)]
    return [*rows, *end]


def _rows(
    grids: Sequence[Grid], intervals: bool, beside: bool, width: int
) -> tuple[bool, list[str]]:
    """Return the lines, and whether no grid had to be divided."""
    fits, rows = True, []
    for some in [grids] if beside else [[grid] for grid in grids]:
        names = [visible(line.name) for line in some[0].lines] if some else []
        wide = min(WIDEST_NAME, max(map(cell_len, names), default=0))
        first = [set_cell_size(_cut(name, wide), wide) for name in ("", "", *names)]
        left = max(1, width - wide - len(GAP))
        groups = [group for grid in some for group in _groups(grid, intervals, left)]
        if any(cell_len(group[0]) > left for group in groups):
            fits = False
            rows += _stacked(names, some, width)
            continue
        whole = len(groups) == len(some)
        if beside and whole and sum(len(group[0]) + len(GAP) for group in groups) <= left:
            rows += _joined([first, *groups])
            continue
        fits &= whole and not beside
        for group in groups:
            rows += _joined([first, group])
    return fits, rows


def _groups(grid: Grid, intervals: bool, width: int) -> list[list[str]]:
    """Return title, heads and values of a grid in lines of one width.

    They are in several parts where they are wider than `width`.
    """
    columns = []
    for place, head in enumerate(grid.columns):
        cells = [line.cells[place] for line in grid.lines]
        values = _aligned([visible(cell.text) + "* "[cell.special is not BEST] for cell in cells])
        ends = _aligned([_interval(cell) if intervals else "" for cell in cells])
        texts = [f"{value}{end}" for value, end in zip(values, ends, strict=True)]
        columns.append(_aligned([visible(head.name), *texts]))
    better = "higher" if grid.higher else "lower"
    title = _cut(f"{visible(grid.caption.partition(',')[0])}, {better} is better", width)
    groups = []
    for part in in_groups(columns, width):
        rows = [GAP.join(texts) for texts in zip(*part, strict=True)]
        wide = max(len(title), len(rows[0]))
        groups.append([title.ljust(wide), *(row.rjust(wide) for row in rows)])
    return groups


def _stacked(names: Sequence[str], grids: Sequence[Grid], width: int) -> list[str]:
    """Return each name on a line above its values: with the names at the left they have no room."""
    rows = []
    for grid in grids:
        for title, heads, *values in _groups(grid, False, width - len(GAP)):
            rows += [title.rstrip(), GAP + heads]
            for name, texts in zip(names, values, strict=True):
                rows += [_cut(name, width), (GAP + texts).rstrip()]
    return rows


def in_groups(columns: Sequence[list[str]], width: int) -> list[list[list[str]]]:
    """Return columns of texts of one width each in groups, none wider than `width` with its gaps.

    A column that is wider is a group of its own.
    """
    groups: list[list[list[str]]] = [[]]
    for column in columns:
        if groups[-1] and sum(len(c[0]) + len(GAP) for c in groups[-1]) + len(column[0]) > width:
            groups.append([])
        groups[-1].append(column)
    return groups


def _joined(blocks: Sequence[Sequence[str]]) -> list[str]:
    return [GAP.join(texts).rstrip() for texts in zip(*blocks, strict=True)]


def _aligned(texts: Sequence[str]) -> list[str]:
    wide = max(map(len, texts), default=0)
    return [text.rjust(wide) for text in texts]


def _interval(cell: Cell) -> str:
    """Return the ends of an interval in the digits of the value, as its two sides may differ."""
    if cell.value is None or cell.interval is None:
        return ""
    low, high = (re.sub(r"^(-?)0\.", r"\1.", end) for end in cell.interval)
    return f"[{low}, {high}]"


def _cut(text: str, width: int) -> str:
    if cell_len(text) <= width:
        return text
    return set_cell_size(text, max(0, width - 1)).rstrip() + "…"
