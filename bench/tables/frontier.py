"""Quality against cost in tables: the frontier, and what fewer points save."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from bench.analysis.compare import COST, IMAGE_SET, VALUE, Estimate, milliseconds
from bench.analysis.differences import Verdicts
from bench.analysis.frontier import FRONTIER, LOST, POINTS, frontier_verdicts
from bench.catalogue.suites import TableSpec
from bench.records.job import TIMES
from bench.tables import markdown
from bench.tables.grid import (
    DASH,
    Annotation,
    Block,
    Cell,
    Grid,
    TableRow,
    metric_cell,
    number_cell,
    pivot,
    role_in_words,
    row_mappings,
)
from bench.tables.table import Table
from data_prep.arrays import Floats

MARKS = {
    "frontier": Annotation("frontier", "**{value}**{interval}"),
    "tied": Annotation("tied", "{value}{interval} ="),
    "below a white image": Annotation(
        "below a white image", "{value}{interval} *below*", against=True
    ),
    "reference": Annotation("reference", "{value}{interval} *ref*"),
}

# At a cost that the author of a method states, of another machine.
CLAIMED = Annotation("claimed", "{value}{interval} *claimed*")


def frontier_table(spec: TableSpec, frame: pd.DataFrame, remark: str) -> Table:
    """Return the table of quality against cost.

    frame   as `frontier_verdicts` returns it
    remark  what a reader has to know to read it
    """
    return Table(spec.name, spec.title, frame[FRONTIER], partial(_frontier, remark))


def _frontier(remark: str, frame: pd.DataFrame) -> Iterator[Block]:
    """Yield a grid for each condition and number of views, methods by rising cost."""
    yield remark
    has_claimed = (frame["verdict"] == "claimed").any()
    yield _LEGEND + _OF_CLAIMED if has_claimed else _LEGEND
    for (condition, class_name), rows in frame.groupby(["condition", "class"], sort=False):
        drawn = _of_views(int(rows["views"].iloc[0]))
        yield f"## {markdown.cell(f'{condition}, {class_name}, {drawn}')}"
        yield pivot(
            rows,
            line="method",
            column="metric",
            cell=_marked_value,
            lines=rows.sort_values([*COST], kind="stable")["method"].unique(),
            before={"ms": _cost},
            after={"images": _image_count},
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
    for group, rows in frame.groupby(["class", "metric"], sort=False):
        class_name, metric = (markdown.cell(str(name)) for name in group)
        yield f"## {metric}, {class_name}"
        yield pivot(
            rows,
            line="method",
            column="points",
            cell=_thinned,
            columns=sorted(rows["points"].unique(), reverse=True),
            column_name="{} points".format,
            corner="method",
        )


def cost_grid(compared: pd.DataFrame, metric: str, views: int, verdicts: Verdicts) -> Grid | None:
    """Return the milliseconds for a cloud with its views, by method and condition.

    Of several classes each has lines of its own. Beside a cost stand the times that it is the sum
    of; its mark says whether the method is on the frontier by `metric`, or worse than a white
    image. None where no time is known.
    """
    of_metric = compared[compared["metric"] == metric]
    further = {name: of_metric[name].tolist() for name in (*TIMES, "claimed")}
    placed = frontier_verdicts(of_metric, views, verdicts).assign(**further)
    rows = {(row["condition"], row["class"], row["method"]): row for row in row_mappings(placed)}
    conditions, classes, methods = (placed[name].unique() for name in IMAGE_SET)
    lines = []
    for class_name in classes:
        for method in methods:
            cells = []
            for condition in conditions:
                row = rows.get((condition, class_name, method))
                cells.append(DASH if row is None else _cost_of(row))
            about = class_name if len(classes) > 1 else role_in_words(method)
            lines.append(TableRow(method, tuple(cells), about))
    notes = [
        f"“frontier”: no other method has at least its {metric} for at most its cost; “below a "
        f"white image”: its {metric} is worse than that of `blank`."
    ]
    if placed["claimed"].any():
        notes.append("“claimed”: its author states the times, of another machine.")
    cloud = f"a cloud with its {views} views" if views > 1 else "a cloud with 1 view"
    costs = Grid(
        corner="method",
        columns=tuple(conditions),
        lines=tuple(lines),
        caption=f"Milliseconds for {cloud}, "
        "median over objects; beneath, what they are made of: prepare the cloud + draw a view",
        notes=tuple(notes),
        higher=False,
    )
    return costs if costs.valued else None


def _cost_of(row: Mapping[str, Any]) -> Cell:
    """Return the cost of a cloud, beside it the times that it is the sum of."""
    cost, n_ok, n, views = row["cost_ms"], row["n_ok"], row["n"], row["views"]
    prepare_ms, draw_ms = (_median_ms(row[name]) for name in TIMES)
    if math.isfinite(prepare_ms):
        rest = f"{milliseconds(prepare_ms)} + {milliseconds(draw_ms)}"
        if views > 1:
            rest += f" × {views}"
    else:
        rest = "no times"
    if row["claimed"]:
        special = CLAIMED
    elif row["verdict"] in ("tied", "reference"):
        special = None
    else:
        special = MARKS.get(row["verdict"])
    return Cell(
        milliseconds(cost),
        cost if math.isfinite(cost) else None,
        rest=rest,
        count=(n_ok, n),
        blank="-" if n_ok < n else None,
        special=special,
    )


def _median_ms(seconds: Floats) -> float:
    """Return the median of the known times of objects [G], in milliseconds; NaN without any."""
    return float(np.nanmedian(1000 * seconds)) if np.isfinite(seconds).any() else math.nan


def _image_count(row: Mapping[str, Any]) -> Cell:
    """Return how many images exist, of how many that should exist."""
    return Cell(f"{row['n_ok']}/{row['n']}")


def _cost(row: Mapping[str, Any]) -> Cell:
    """Return the cost of a cloud with its interval."""
    special = CLAIMED if row["verdict"] == "claimed" else None
    return number_cell(_estimate(row, COST), milliseconds, special=special)


def _marked_value(row: Mapping[str, Any]) -> Cell:
    """Return the value with its interval, marked by the method's verdict."""
    return _value(row, special=MARKS.get(row["verdict"]))


def _value(row: Mapping[str, Any], **beside: Any) -> Cell:
    """Return the value with its interval; `beside` are further fields of the cell."""
    return metric_cell(_estimate(row, VALUE), row["metric"], row["method"], **beside)


def _estimate(row: Mapping[str, Any], names: Sequence[str]) -> Estimate:
    return Estimate(*(row[name] for name in names))


def _thinned(row: Mapping[str, Any]) -> Cell:
    """Return the value, what is lost against the full cloud, and the cost."""
    value, lost = _value(row), _estimate(row, LOST)
    rest = f", {milliseconds(row['cost_ms'])} ms"
    if row["claimed"]:
        rest += " claimed"
    if not (math.isfinite(lost.low) and any(lost)):
        return Cell(value.text, rest=rest)
    loss = metric_cell(lost, row["metric"], row["method"], sign="+")
    text = f"{value.text}, {loss.text}"
    return Cell(text, interval=loss.interval, rest=rest)


def _of_views(views: int) -> str:
    return "1 view" if views == 1 else f"{views} views"
