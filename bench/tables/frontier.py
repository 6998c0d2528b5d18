"""Quality against cost in tables: the frontier, and what fewer points save."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from bench.analysis.comparison import Comparison, milliseconds
from bench.analysis.frontier import FrontierPoint, SubsampledFrontier, places
from bench.analysis.paired import Verdicts
from bench.catalogue.methods import role
from bench.catalogue.suites import TableSpec
from bench.tables import markdown
from bench.tables.grid import (
    NOTHING,
    Annotation,
    Block,
    Cell,
    ColumnHeader,
    Grid,
    TableRow,
    Tags,
    measured,
    number,
    ordered,
    pivot,
)
from bench.tables.table import Column, Table, columns, constant

MARKS = {
    "frontier": Annotation("frontier", "**{value}**{interval}"),
    "tied": Annotation("tied", "{value}{interval} ="),
    "below a white image": Annotation(
        "below a white image", "{value}{interval} *below*", against=True
    ),
    "reference": Annotation("reference", "{value}{interval} *ref*"),
}

CLAIMED = Annotation("claimed", "{value}{interval} *claimed*")  # of a cost


def _interval_columns(name: str, path: str, ends: str) -> tuple[Column, ...]:
    """Return the columns `name` of a value, and `ends` with `_low` and `_high` of its interval."""
    return columns(
        (name, f"{path}.value"), (f"{ends}_low", f"{path}.low"), (f"{ends}_high", f"{path}.high")
    )


def frontier_table(
    spec: TableSpec, rows: Iterable[FrontierPoint], remark: str
) -> Table[FrontierPoint]:
    """Return the places of all methods, at each condition and for each number of views.

    `remark` is what people have to know to read it.
    """
    csv = (
        *columns("condition", ("class", "class_name"), "views", "metric", "method"),
        *_interval_columns("cost_ms", "cost_ms", "cost_ci"),
        *_interval_columns("value", "quality", "ci"),
        *columns("n_ok", "n", "verdict", ("rival", "baseline")),
    )
    layout = partial(_frontier, remark)
    return Table.of_rows(spec.name, spec.title, csv, tuple(rows), layout)


def _frontier(remark: str, rows: Sequence[FrontierPoint]) -> Iterator[Block]:
    """Yield a grid for each condition and number of views, methods by rising cost."""
    yield remark
    yield _LEGEND + _OF_CLAIMED * any(p.verdict == "claimed" for p in rows)
    for cell in ordered((p.condition, p.class_name, p.views) for p in rows):
        condition, class_name, views = cell
        yield f"## {markdown.cell(f'{condition}, {class_name}, {_of_views(views)}')}"
        of_cell = [p for p in rows if (p.condition, p.class_name, p.views) == cell]
        costs = {p.method: p.cost_ms for p in of_cell}
        yield pivot(
            of_cell,
            "method",
            "metric",
            _quality,
            lines=sorted(costs, key=lambda m: (not math.isfinite(costs[m].value), costs[m])),
            before={"ms": _cost},
            after={"images": lambda p: Cell(f"{p.n_ok}/{p.n}")},
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


def points_table(
    spec: TableSpec, rows: Iterable[SubsampledFrontier], views: int
) -> Table[SubsampledFrontier]:
    """Return the losses and savings of methods where a cloud with these views has fewer points."""
    csv = (
        *columns(("class", "class_name"), "metric", "method", "condition", "points"),
        constant("views", views),
        *_interval_columns("cost_ms", "cost_ms", "cost_ci"),
        *_interval_columns("value", "quality", "ci"),
        *_interval_columns("lost", "lost", "lost_ci"),
    )
    layout = partial(_points, views)
    return Table.of_rows(spec.name, spec.title, csv, tuple(rows), layout)


def _points(views: int, rows: Sequence[SubsampledFrontier]) -> Iterator[Block]:
    """Yield a grid for each metric, methods down and numbers of points across."""
    yield (
        f"Clouds with {_of_views(views)}: value, loss against the full cloud [95 % "
        "interval, paired over objects], milliseconds. A loss under 0 is a gain."
    )
    for class_name, metric in ordered((row.class_name, row.metric) for row in rows):
        of_cell = [row for row in rows if (row.class_name, row.metric) == (class_name, metric)]
        yield f"## {markdown.cell(metric)}, {markdown.cell(class_name)}"
        yield pivot(
            of_cell,
            "method",
            "points",
            _thinned,
            columns=sorted({row.points for row in of_cell}, reverse=True),
            column_name="{} points".format,
            corner="method",
        )


def cost_grid(
    comparisons: Sequence[Comparison], metric: str, views: int, verdicts: Verdicts
) -> Grid | None:
    """Return the milliseconds for a cloud with its views, by method and condition.

    Return None without any times.

    With several classes each line is of one class. Beside a cost stands what it is made of; its
    mark says whether the method is on the frontier by `metric`, or worse than a white image.
    """
    classes = ordered(c.class_name for c in comparisons)
    conditions = ordered(c.condition for c in comparisons)
    at = {(c.condition, c.class_name): c for c in comparisons}
    special = {
        (c.condition, c.class_name, p.method): MARKS[p.verdict]
        for c in comparisons
        for p in places(c, (metric,), views, verdicts)
        if p.verdict in ("frontier", "below a white image")
    }

    claimed = any(c.claimed for c in comparisons)

    def cell(condition: str, class_name: str, method: str) -> Cell:
        comparison = at.get((condition, class_name))
        if comparison is None or method not in comparison.images:
            return NOTHING
        cost, (n_ok, n) = comparison.cost_ms(method, views).value, comparison.images[method]
        return Cell(
            milliseconds(cost),
            cost if math.isfinite(cost) else None,
            rest=_made_of(comparison, method, views),
            caveat=f"of {n_ok} of {n} images" if n_ok < n else "",
            special=CLAIMED
            if method in comparison.claimed
            else special.get((condition, class_name, method)),
        )

    costs = Grid(
        corner="method",
        columns=tuple(
            ColumnHeader(condition, Tags(condition=condition)) for condition in conditions
        ),
        lines=tuple(
            TableRow(
                method,
                tuple(cell(condition, class_name, method) for condition in conditions),
                class_name if len(classes) > 1 else role(method),
                Tags(method=method, class_name=class_name),
            )
            for class_name in classes
            for method in ordered(m for c in comparisons for m in c.images)
        ),
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


def _made_of(comparison: Comparison, method: str, views: int) -> str:
    prepare, draw = (
        np.nanmedian(1000 * seconds[method]) if np.isfinite(seconds[method]).any() else math.nan
        for seconds in (comparison.prepare_s, comparison.draw_s)
    )
    if not math.isfinite(prepare):
        return "no times"
    times = f" × {views}" if views > 1 else ""
    return f"{milliseconds(float(prepare))} + {milliseconds(float(draw))}{times}"


def _cost(place: FrontierPoint) -> Cell:
    special = CLAIMED if place.verdict == "claimed" else None
    return number(place.cost_ms, milliseconds, special=special)


def _quality(place: FrontierPoint) -> Cell:
    return measured(place.quality, place.metric, place.method, special=MARKS.get(place.verdict))


def _thinned(row: SubsampledFrontier) -> Cell:
    value = measured(row.quality, row.metric, row.method)
    rest = f", {milliseconds(row.cost_ms.value)} ms{' claimed' * row.claimed}"
    if not (math.isfinite(row.lost.low) and any(row.lost)):
        return Cell(value.text, rest=rest, coarse=value.coarse)
    lost = measured(row.lost, row.metric, row.method, sign="+")
    text = f"{value.text}, {lost.text}"
    return Cell(text, interval=lost.interval, rest=rest, coarse=lost.coarse)


def _of_views(views: int) -> str:
    return "1 view" if views == 1 else f"{views} views"
