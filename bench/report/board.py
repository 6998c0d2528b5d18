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

HEADLINE_METRICS = ("ssim-object", "lpips")  # stand before the other metrics of a suite
_WORDS = {  # what stands beside a method's name, by its id or by its role
    "ceiling": "reference: the true mesh",
    "floor": "reference: sees no cloud",
    RECOMMENDED: "recommended",
    RECOMMENDED_IN_COLOUR: "recommended in colours",
}


class BoardCell(NamedTuple):
    """A cell of a leaderboard.

    text     the value as people read it
    value    the number by which its column is sorted; None comes last
    letters  letters of a rank: methods that share one do not differ significantly
    beneath  a remark in small letters beneath the value
    caveat   what speaks against the value
    """

    text: str
    value: float | None = None
    letters: str = ""
    beneath: str = ""
    caveat: str = ""


EMPTY = BoardCell("–")  # of a method without a value


class BoardColumn(NamedTuple):
    """A column of a leaderboard.

    title    what its values are, in full
    cells    by the name of a method, for those that have a value
    numeric  whether it is sorted by numbers
    higher   whether a higher value is better
    placed   whether it is a metric, in which methods have places
    """

    name: str
    title: str
    cells: Mapping[str, BoardCell]
    numeric: bool = True
    higher: bool = False
    placed: bool = False


class BoardGroup(NamedTuple):
    """Columns under one common head; columns of a group without a name have none above them.

    title  what the values are, in full
    about  the same in a few words, which stand beneath the name
    link   address that the name links to
    """

    columns: Sequence[BoardColumn]
    name: str = ""
    title: str = ""
    about: str = ""
    link: str = ""


def value_cell(value: float, metric: str, method: str, **beside: str) -> BoardCell:
    """Return the cell of a value, which is written without a 0 before the point.

    beside  further fields of the cell
    """
    text = f"{value:.{decimals(metric, method)}f}"
    text = text.removeprefix("0") if text.startswith("0.") else text.replace("-0.", "−.")
    if is_coarse(metric, method):
        text = MOVED + text
    return BoardCell(text, value, **beside)


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
    """Return what the template of a leaderboard shows: every method in a row of its own.

    groups     columns of values; places are those in their columns of metrics
    further    columns after the mean places
    ids        ids of the catalogue by the names of all methods
    competing  names of the methods that have places
    notes      stand below, after what the metrics mean

    It has `caption`, `notes`, `groups` as (number of the group's first column, BoardGroup), and
    `rows` in the order of the places: place (or None), name, about, whether it is a reference,
    cells.
    """
    metric_columns = []
    for group in groups:
        metric_columns += [column for column in group.columns if column.placed]
    places = mean_places(
        [(column.name, _values(column)) for column in metric_columns],
        {name: ids[name] for name in competing},
    )
    placed = sorted(places, key=places.__getitem__)
    others = [name for name in ids if name not in places]
    others.sort(key=lambda name: is_reference(ids[name]))
    mean = BoardColumn(
        "mean place",
        "of the columns that have a value; stretched to all methods",
        {method: BoardCell(f"{place:.1f}", place) for method, place in places.items()},
    )
    groups = (*groups, BoardGroup((mean, *further)))
    numbered_groups = []
    columns: list[BoardColumn] = []
    for group in groups:
        # The first two columns of the page have the place and the name.
        numbered_groups.append((2 + len(columns), group))
        columns += group.columns
    rows = [
        {
            "place": place if method in places else None,
            "name": method,
            "about": _WORDS.get(ids[method], _WORDS.get(role(ids[method]), "")),
            "reference": is_reference(ids[method]),
            "cells": [_cell(column, method, ids) for column in columns],
        }
        for place, method in enumerate((*placed, *others), 1)
    ]
    metrics = dict.fromkeys(column.name for column in metric_columns)
    meanings = "; ".join(f"{metric}: {_metric_words(metric)}" for metric in metrics)
    all_notes = [f"{meanings}.", *notes]
    if any(cell.text.startswith(MOVED) for row in rows for cell in row["cells"]):
        all_notes.append(f"{FEWER}.")
    return {"caption": caption, "groups": numbered_groups, "rows": rows, "notes": all_notes}


def _values(column: BoardColumn) -> dict[str, float]:
    """Return the values of a column by the names of the methods that have one."""
    return {name: cell.value for name, cell in column.cells.items() if cell.value is not None}


def _cell(column: BoardColumn, method: str, ids: Mapping[str, str]) -> BoardCell:
    """Return the cell of a method, which says where a white image is better."""
    cell = column.cells.get(method, EMPTY)
    if not column.placed or is_reference(ids[method]) or cell.value is None:
        return cell
    blanks = [value for name, value in _values(column).items() if ids[name] == FLOOR]
    if not blanks or not prints_better(column.name, blanks[0], cell.value, ids[method]):
        return cell
    caveats = [cell.caveat, "worse than blank"]
    return cell._replace(caveat="; ".join(filter(None, caveats)))


def is_reference(method_id: str) -> bool:
    """Return whether a method is shown for comparison only, and has no place."""
    return role(method_id) in ("ceiling", "floor")


def _metric_words(metric: str) -> str:
    """Return what a metric measures, and which values are better."""
    better = "higher is better" if higher_is_better(metric) else "lower is better"
    known = METRICS.get(metric)
    return f"{known.about if known else 'a metric of another package'}; {better}"


def trained_on(method_id: str, manifest: Mapping[str, Any] = MappingProxyType({})) -> BoardCell:
    """Return the cell with the objects that a method was trained on, or "unknown".

    manifest  of a run that has the method, where it is not of the catalogue
    """
    if is_reference(method_id):
        return EMPTY
    if role(method_id):
        return BoardCell("another at each condition")
    return BoardCell(training_objects(method_id, manifest) or "unknown")
