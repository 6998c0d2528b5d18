"""Quality against cost in tables: the frontier, and what fewer points save."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.comparison import CLOUD, COST, VALUE, Estimate, milliseconds
from bench.analysis.frontier import FRONTIER, LOST, POINTS, places
from bench.analysis.paired import Verdicts
from bench.catalogue.methods import role
from bench.catalogue.suites import TableSpec
from bench.records.record import TIMES
from bench.tables import markdown
from bench.tables.grid import (
    NOTHING,
    Annotation,
    Block,
    Cell,
    Grid,
    TableRow,
    measured,
    number,
    pivot,
    records,
)
from bench.tables.table import Table

MARKS = {
    "frontier": Annotation("frontier", "**{value}**{interval}"),
    "tied": Annotation("tied", "{value}{interval} ="),
    "below a white image": Annotation(
        "below a white image", "{value}{interval} *below*", against=True
    ),
    "reference": Annotation("reference", "{value}{interval} *ref*"),
}

CLAIMED = Annotation("claimed", "{value}{interval} *claimed*")  # of a cost


def frontier_table(spec: TableSpec, frame: pd.DataFrame, remark: str) -> Table:
    """Return the table of the places of all methods, as `places` returns them.

    `remark` is what people have to know to read it.
    """
    return Table(spec.name, spec.title, frame[FRONTIER], partial(_frontier, remark))


def _frontier(remark: str, frame: pd.DataFrame) -> Iterator[Block]:
    """Yield a grid for each condition and number of views, methods by rising cost."""
    yield remark
    yield _LEGEND + _OF_CLAIMED * bool((frame["verdict"] == "claimed").any())
    for (condition, class_name), rows in frame.groupby(["condition", "class"], sort=False):
        drawn = _of_views(int(rows["views"].iloc[0]))
        yield f"## {markdown.cell(f'{condition}, {class_name}, {drawn}')}"
        yield pivot(
            rows,
            "method",
            "metric",
            lambda row: _value(row, special=MARKS.get(row["verdict"])),
            lines=rows.sort_values([*COST], kind="stable")["method"].unique(),
            before={"ms": _cost},
            after={"images": lambda row: Cell(f"{row['n_ok']}/{row['n']}")},
            corner="method",
        )


_LEGEND = (
    "**Bold**: on the frontier, no other is at least as good for at most that cost. `=`: something "
    "that costs no more is at least as good, but is not shown to be better (by the rule of `bench "
    "compare`). None of these: one that costs no more is shown to be better. *below*: worse than a "
    "white image, which costs nothing. *ref*: no choice, it sees the mesh or no cloud. Costs in "
    "milliseconds for a cloud with its views, median over objects; qualities are means over "
    "objects, failed images scored as blank ones. [95 % interval over objects]."
)


_OF_CLAIMED = (
    " *claimed*: the author states this cost, of another machine; it has no part in the frontier."
)


def points_table(spec: TableSpec, frame: pd.DataFrame) -> Table:
    """Return the table of what fewer points lose and save, as `thinned` returns it."""
    frame = frame[[*POINTS, "claimed"]].reset_index(drop=True)
    return Table(spec.name, spec.title, frame, _points, hidden=("claimed",))


def _points(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield a grid for each metric, methods down and numbers of points across."""
    yield (
        f"Clouds with {_of_views(frame['views'].max())}: value, loss against the full cloud [95 % "
        "interval, paired over objects], milliseconds. A loss under 0 is a gain."
    )
    for cell, rows in frame.groupby(["class", "metric"], sort=False):
        class_name, metric = (markdown.cell(str(name)) for name in cell)
        yield f"## {metric}, {class_name}"
        yield pivot(
            rows,
            "method",
            "points",
            _thinned,
            columns=sorted(rows["points"].unique(), reverse=True),
            column_name="{} points".format,
            corner="method",
        )


def cost_grid(compared: pd.DataFrame, metric: str, views: int, verdicts: Verdicts) -> Grid | None:
    """Return the milliseconds for a cloud with its views, by method and condition.

    Return None without any times.

    With several classes each line is of one class. Beside a cost stands what it is made of; its
    mark says whether the method is on the frontier by `metric`, or worse than a white image.
    """
    of_metric = compared[compared["metric"] == metric]
    further = {name: of_metric[name].tolist() for name in (*TIMES, "claimed")}
    placed = places(of_metric, views, verdicts).assign(**further)
    rows = {(row["condition"], row["class"], row["method"]): row for row in records(placed)}
    conditions, classes, methods = (placed[name].unique() for name in CLOUD)
    lines = []
    for class_name in classes:
        for method in methods:
            cells = (rows.get((condition, class_name, method)) for condition in conditions)
            about = class_name if len(classes) > 1 else role(method)
            lines.append(TableRow(method, tuple(map(_cost_of, cells)), about))
    claimed = placed["claimed"].any()
    costs = Grid(
        corner="method",
        columns=tuple(conditions),
        lines=tuple(lines),
        caption=f"Milliseconds for a cloud with {'its ' if views > 1 else ''}{_of_views(views)}, "
        "median over objects; beneath, what they are made of: prepare the cloud + draw a view",
        notes=(
            f"“frontier”: no other method has at least its {metric} for at most its cost; “below a "
            f"white image”: its {metric} is worse than that of `blank`.",
            *(["“claimed”: its author states the times, of another machine."] if claimed else []),
        ),
        higher=False,
    )
    return costs if costs.valued else None


def _cost_of(row: Mapping[str, Any] | None) -> Cell:
    if row is None:
        return NOTHING
    cost, n_ok, n, views = (row[name] for name in ("cost_ms", "n_ok", "n", "views"))
    prepare, draw = (
        np.nanmedian(1000 * row[name]) if np.isfinite(row[name]).any() else math.nan
        for name in TIMES
    )
    times = f" × {views}" if views > 1 else ""
    rest = f"{milliseconds(float(prepare))} + {milliseconds(float(draw))}{times}"
    special = MARKS.get(row["verdict"]) if row["verdict"] not in ("tied", "reference") else None
    return Cell(
        milliseconds(cost),
        cost if math.isfinite(cost) else None,
        rest=rest if math.isfinite(prepare) else "no times",
        count=(n_ok, n),
        blank="-" if n_ok < n else None,
        special=CLAIMED if row["claimed"] else special,
    )


def _cost(row: Mapping[str, Any]) -> Cell:
    special = CLAIMED if row["verdict"] == "claimed" else None
    return number(_estimate(row, COST), milliseconds, special=special)


def _value(row: Mapping[str, Any], **beside: Any) -> Cell:
    return measured(_estimate(row, VALUE), row["metric"], row["method"], **beside)


def _estimate(row: Mapping[str, Any], names: Sequence[str]) -> Estimate:
    return Estimate(*(row[name] for name in names))


def _thinned(row: Mapping[str, Any]) -> Cell:
    value, lost = _value(row), _estimate(row, LOST)
    rest = f", {milliseconds(row['cost_ms'])} ms{' claimed' * row['claimed']}"
    if not (math.isfinite(lost.low) and any(lost)):
        return Cell(value.text, rest=rest)
    loss = measured(lost, row["metric"], row["method"], sign="+")
    text = f"{value.text}, {loss.text}"
    return Cell(text, interval=loss.interval, rest=rest)


def _of_views(views: int) -> str:
    return "1 view" if views == 1 else f"{views} views"
