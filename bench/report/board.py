"""A leaderboard as plain values: methods by the mean of their places in columns of values.

`bench.report.index` makes one of runs, `studies.leaderboard` one of the project's results.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from bench.analysis.digits import decimals, is_coarse, prints_better
from bench.analysis.ranks import mean_places
from bench.catalogue.methods import (
    FLOOR,
    RECOMMENDED,
    RECOMMENDED_IN_COLOUR,
    role,
    training_objects,
)
from bench.catalogue.metrics import METRICS, higher_is_better
from bench.tables.grid import FEWER, MOVED

HEADLINE = ("ssim-object", "lpips")  # before others of a suite
_WORDS = {
    "ceiling": "reference: the true mesh",
    "floor": "reference: sees no cloud",
    RECOMMENDED: "recommended",
    RECOMMENDED_IN_COLOUR: "recommended in colours",
}


class BoardCell(NamedTuple):
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


class BoardColumn(NamedTuple):
    """A column of a leaderboard: what it has, and the cells of the methods that have one.

    placed  whether it is a metric in which methods have places
    """

    name: str
    title: str
    cells: Mapping[str, BoardCell]
    numeric: bool = True
    higher: bool = False
    placed: bool = False


class BoardGroup(NamedTuple):
    """Columns under one head; a group without a name has columns of their own.

    title  what the values are, in full
    about  the same in a few words, which stand beneath the name
    link   where the name leads
    """

    columns: Sequence[BoardColumn]
    name: str = ""
    title: str = ""
    about: str = ""
    link: str = ""


def value_cell(value: float, metric: str, method: str, **beside: str) -> BoardCell:
    """Return the cell of a value without the 0 before the point; `beside` are further fields."""
    text = f"{value:.{decimals(metric, method)}f}"
    text = text.removeprefix("0") if text.startswith("0.") else text.replace("-0.", "−.")
    return BoardCell(MOVED * is_coarse(metric, method) + text, value, **beside)


def metric_column(metric: str, cells: Mapping[str, BoardCell]) -> BoardColumn:
    """Return the column of a metric, in which methods have places."""
    higher = higher_is_better(metric)
    return BoardColumn(metric, _metric_words(metric), cells, higher=higher, placed=True)


def leaderboard(
    caption: str,
    groups: Sequence[BoardGroup],
    further: Sequence[BoardColumn],
    ids: Mapping[str, str],
    competing: Collection[str],
    notes: Sequence[str],
) -> dict[str, Any]:
    """Return the leaderboard of values, every method in a row of its own.

    groups     values; places are those in their columns of metrics
    further    columns after the mean places
    ids        ids of the catalogue by the names of all methods
    competing  names of the methods that have places
    notes      follow what the metrics mean

    `caption`, `notes`, `groups` as (number of the first column, BoardGroup), and `rows` in the
    order of the places: place (or None), name, about, whether it is a reference, cells.
    """
    columns = [column for group in groups for column in group.columns if column.placed]
    values = [
        (column.name, {m: cell.value for m, cell in column.cells.items() if cell.value is not None})
        for column in columns
    ]
    places = mean_places(values, {name: ids[name] for name in competing})
    placed = sorted(places, key=places.__getitem__)
    others = [name for name in ids if name not in places]
    others.sort(key=lambda name: is_reference(ids[name]))
    mean = BoardColumn(
        "mean place",
        "of the columns that have a value; stretched to all methods",
        {method: BoardCell(f"{place:.1f}", place) for method, place in places.items()},
    )
    groups = (*groups, BoardGroup((mean, *further)))
    starts = [2 + sum(len(group.columns) for group in groups[:i]) for i in range(len(groups))]
    rows = [
        {
            "place": place if method in places else None,
            "name": method,
            "about": _WORDS.get(ids[method], _WORDS.get(role(ids[method]), "")),
            "reference": is_reference(ids[method]),
            "cells": [_cell(column, method, ids) for group in groups for column in group.columns],
        }
        for place, method in enumerate((*placed, *others), 1)
    ]
    meanings = "; ".join(f"{c}: {_metric_words(c)}" for c in dict.fromkeys(c.name for c in columns))
    moved = any(cell.text.startswith(MOVED) for row in rows for cell in row["cells"])
    return {
        "caption": caption,
        "groups": list(zip(starts, groups, strict=True)),
        "rows": rows,
        "notes": [f"{meanings}.", *notes, *[f"{FEWER}."] * moved],
    }


def _cell(column: BoardColumn, method: str, ids: Mapping[str, str]) -> BoardCell:
    """Return the cell of a method, which says where a white image is better."""
    cell = column.cells.get(method, EMPTY)
    blanks = [of_name.value for name, of_name in column.cells.items() if ids[name] == FLOOR]
    if not column.placed or is_reference(ids[method]) or cell.value is None or not blanks:
        return cell
    blank = blanks[0]
    below = blank is not None and prints_better(column.name, blank, cell.value, ids[method])
    caveats = [cell.caveat, "worse than blank" if below else ""]
    return cell._replace(caveat="; ".join(filter(None, caveats)))


def is_reference(method_id: str) -> bool:
    """Return whether a method is shown for comparison, and has no place."""
    return role(method_id) in ("ceiling", "floor")


def _metric_words(metric: str) -> str:
    better = "higher is better" if higher_is_better(metric) else "lower is better"
    known = METRICS.get(metric)
    return f"{known.about if known else 'a metric of another package'}; {better}"


def trained_on(method_id: str, manifest: Mapping[str, Any] = MappingProxyType({})) -> BoardCell:
    """Return the objects that a method was trained on, "unknown" where nobody says.

    `manifest` is that of a run which has the method.
    """
    if is_reference(method_id):
        return EMPTY
    if role(method_id):
        return BoardCell("another at each condition")
    return BoardCell(training_objects(method_id, manifest) or "unknown")
