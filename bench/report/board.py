"""A leaderboard as plain values: methods by the mean of their places in columns of values.

`bench.report.run_board` makes one of runs, `studies.leaderboard` one of the project's results.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

from bench.analysis.digits import decimals, is_coarse, prints_better
from bench.analysis.leaderboard import mean_places
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import (
    FLOOR,
    RECOMMENDED,
    RECOMMENDED_IN_COLOUR,
    role,
    training_objects,
)
from bench.catalogue.metrics import metric_facts
from bench.tables.grid import FEWER, MOVED

RowKind = Literal["", "variant", "reference"]
HEADLINE = ("ssim-object", "lpips")  # before others of a suite
_ROLES = {"ceiling": "reference: the true mesh", "floor": "reference: sees no cloud"}


@dataclass(frozen=True)
class BoardCell:
    """A cell of a leaderboard.

    value    number that its column is sorted by; None comes last
    letters  letters of a rank
    beneath  small words beneath the value
    caveat   words that speak against the value
    """

    text: str
    value: float | None = None
    letters: str = ""
    beneath: str = ""
    caveat: str = ""


EMPTY = BoardCell("–")


def value_cell(value: float, metric: str, method: str, **beside: str) -> BoardCell:
    """Return the cell of a value without the 0 before the point; `beside` are further fields."""
    text = f"{value:.{decimals(metric, method)}f}"
    text = text.removeprefix("0") if text.startswith("0.") else text.replace("-0.", "−.")
    return BoardCell(MOVED * is_coarse(metric, method) + text, value, **beside)


@dataclass(frozen=True)
class BoardColumn:
    """A column of a leaderboard: what it has, and the cells of the methods that have one.

    placed  whether it is a metric in which methods have places
    """

    name: str
    title: str
    cells: Mapping[str, BoardCell]
    sort: Literal["number", "text"] = "number"
    higher: bool = False
    placed: bool = False


@dataclass(frozen=True)
class BoardGroup:
    """Columns under one head; a group without a name has columns of their own.

    title  what the values are, in full
    about  the same in a few words, which stand beneath the name
    link   where the name leads
    """

    columns: tuple[BoardColumn, ...]
    name: str = ""
    title: str = ""
    about: str = ""
    link: str = ""


@dataclass(frozen=True)
class BoardRow:
    """A method: its place among all that compete, and a cell for each column."""

    place: int | None
    name: str
    cells: tuple[BoardCell, ...]
    kind: RowKind
    about: str


@dataclass(frozen=True)
class Board:
    """A leaderboard: rows in the order of their places, and notes on how to read it."""

    caption: str
    groups: tuple[BoardGroup, ...]
    rows: tuple[BoardRow, ...]
    notes: tuple[str, ...]

    @property
    def starts(self) -> list[int]:
        """Return the columns at which a group begins."""
        sizes = [len(group.columns) for group in self.groups]
        return [sum(sizes[:i]) for i in range(len(sizes))]

    def count(self, kind: RowKind) -> int:
        """Return the number of rows of a kind."""
        return sum(row.kind == kind for row in self.rows)


def metric_column(metric: str, cells: Mapping[str, BoardCell]) -> BoardColumn:
    """Return the column of a metric, in which methods have places."""
    higher = metric_facts(metric).higher
    return BoardColumn(metric, metric_words(metric), cells, higher=higher, placed=True)


def leaderboard(
    caption: str,
    groups: Sequence[BoardGroup],
    further: Sequence[BoardColumn],
    ids: Mapping[str, str],
    competing: Collection[str],
    *,
    named: AbstractSet[str],
    notes: Sequence[str],
) -> Board:
    """Return the leaderboard of values.

    Parameters
    ----------
    groups : sequence of BoardGroup
        Values; places are those in their columns of metrics.
    further : sequence of BoardColumn
        Columns after the mean places.
    ids : mapping
        Ids of the catalogue by the names of all methods.
    competing : collection of str
        Names of the methods that have places.
    named : set of str
        Ids that are never variants of others.
    notes : sequence of str
        Follow what the metrics mean.
    """
    columns = [column for group in groups for column in group.columns]
    values = [
        (column.name, {m: cell.value for m, cell in column.cells.items() if cell.value is not None})
        for column in columns
        if column.placed
    ]
    places = mean_places(values, {name: ids[name] for name in competing})
    kinds = row_kinds(sorted(ids, key=lambda m: places.get(m, math.inf)), ids, named)
    ordered = sorted(kinds, key=lambda m: kinds[m] == "reference")
    mean = BoardColumn(
        "mean place",
        "of the columns that have a value; stretched to all methods",
        {method: BoardCell(f"{place:.1f}", place) for method, place in places.items()},
    )
    groups = (*groups, BoardGroup((mean, *further)))
    rows = tuple(
        BoardRow(
            place if method in places else None,
            method,
            tuple(_cell(column, method, ids) for group in groups for column in group.columns),
            kinds[method],
            method_words(ids[method]),
        )
        for place, method in enumerate(ordered, 1)
    )
    metrics = dict.fromkeys(metric for metric, _ in values)
    meanings = "; ".join(f"{metric}: {metric_words(metric)}" for metric in metrics) + "."
    moved = any(cell.text.startswith(MOVED) for row in rows for cell in row.cells)
    return Board(caption, groups, rows, (meanings, *notes, *[f"{FEWER}."] * moved))


def _cell(column: BoardColumn, method: str, ids: Mapping[str, str]) -> BoardCell:
    """Return the cell of a method, which says where a white image is better."""
    cell = column.cells.get(method, EMPTY)
    blanks = [of_name.value for name, of_name in column.cells.items() if ids[name] == FLOOR]
    if not column.placed or is_reference(ids[method]) or cell.value is None or not blanks:
        return cell
    blank = blanks[0]
    below = blank is not None and prints_better(column.name, blank, cell.value, ids[method])
    caveats = [cell.caveat, "worse than blank" if below else ""]
    return replace(cell, caveat="; ".join(filter(None, caveats)))


def row_kinds(
    ranked: Sequence[str], ids: Mapping[str, str], always: AbstractSet[str]
) -> dict[str, RowKind]:
    """Return the kinds of methods by their names; `ids` are those of the catalogue.

    An id with a variant is one, but for the best of a family without a plain method, and for those
    of `always`.
    """
    plain = {family_of(ids[m]) for m in ranked if ids[m] == family_of(ids[m])}
    kinds: dict[str, RowKind] = {}
    for method in ranked:
        family = family_of(ids[method])
        if is_reference(ids[method]):
            kinds[method] = "reference"
        elif ids[method] == family or ids[method] in always or family not in plain:
            kinds[method] = ""
            plain.add(family)
        else:
            kinds[method] = "variant"
    return kinds


def is_reference(method_id: str) -> bool:
    """Return whether a method is shown for comparison, and has no place."""
    return role(method_id) in _ROLES


def metric_words(metric: str) -> str:
    """Return the meaning of a metric and its better direction."""
    facts = metric_facts(metric)
    better = "higher is better" if facts.higher else "lower is better"
    return f"{facts.about or 'a metric of another package'}; {better}"


def method_words(method_id: str) -> str:
    """Return what a reader has to know beside the name of a method; empty for most."""
    if method_id == RECOMMENDED:
        return "recommended"
    if method_id == RECOMMENDED_IN_COLOUR:
        return "recommended in colours"
    return _ROLES.get(role(method_id), "")


def trained_on(method_id: str, manifest: Mapping[str, Any] = MappingProxyType({})) -> BoardCell:
    """Return the objects that a method was trained on, "unknown" where nobody says.

    `manifest` is that of a run which has the method.
    """
    if is_reference(method_id):
        return EMPTY
    if role(method_id):
        return BoardCell("another at each condition")
    return BoardCell(training_objects(method_id, manifest) or "unknown")
