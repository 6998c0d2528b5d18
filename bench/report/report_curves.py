"""Robustness curves of the report: a metric against the conditions, all methods in one plot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from bench.analysis.comparison import decimals
from bench.report.page import Mark, Plot, Series, Style, Tags, Word
from bench.report.report_axes import axis_with_room, spread
from bench.report.styles import family, higher_is_better, is_yardstick, role
from bench.tables.quality import Table
from bench.tables.table import Row

METRICS = ("ssim", "structure", "silhouette-iou", "fd-views", "fid")
HEIGHT = 330
MARGINS = (52.0, 12.0, 148.0, 46.0)  # left, top, right, bottom; labels stand at the right
LEAST_STEP = 60.0  # pixels between conditions
LETTER = 7.0  # pixels of a letter of a tick's label
SLANTED = 40.0  # pixels more at the bottom for names of many classes, which are slanted
DODGE = 0.44  # of a step, that the methods of one condition take side by side
LABEL_GAP = 15.0
LONGEST = 18  # letters of a label


def curves(tables: Sequence[Table], styles: Mapping[str, Style]) -> tuple[Plot, ...]:
    """A plot for each of the metrics that has values, and for each class or condition.

    With one class the conditions stand side by side and are joined; with several the classes do, a
    plot for each condition. Left out are the ceiling, settings of a knob, and what is measured for
    its cost alone.
    """
    plots = []
    for metric in METRICS:
        rows = _rows(tables, metric)
        by_class = len({row.class_name for row in rows}) > 1
        for panel in dict.fromkeys(_panel(row, by_class) for row in rows):
            chosen = [row for row in rows if _panel(row, by_class) == panel]
            plots.append(_plot(metric, panel, chosen, by_class, styles))
    return tuple(plots)


def _rows(tables: Sequence[Table], metric: str) -> list[Row]:
    """The rows of a metric that are drawn; of several tables with it, of the one with most."""
    found = [[row for row in table.rows if row.metric == metric] for table in tables]
    return [
        row
        for row in max(found, key=len, default=[])
        if math.isfinite(row.value)
        and role(row.method) != "ceiling"
        and family(row.method) == row.method
        and not is_yardstick(row.method)
    ]


def _panel(row: Row, by_class: bool) -> str:
    return row.condition if by_class else row.class_name


def _step(row: Row, by_class: bool) -> str:
    return row.class_name if by_class else row.condition


def _plot(
    metric: str,
    panel: str,
    rows: Sequence[Row],
    by_class: bool,
    styles: Mapping[str, Style],
) -> Plot:
    steps = list(dict.fromkeys(_step(row, by_class) for row in rows))
    left, top = MARGINS[:2]
    longest = 0.0 if by_class else 12 + LETTER * max(map(len, steps))
    step = max(LEAST_STEP, longest)
    right, bottom = left + step * max(len(steps), 4), HEIGHT - MARGINS[3]
    methods = list(dict.fromkeys(row.method for row in rows))
    pitch = (right - left) / len(steps)
    ends = [v for row in rows for v in (row.value, row.ci_low, row.ci_high)]
    axis = axis_with_room([row.value for row in rows], ends, bottom, top)
    dodged = [method for method in methods if styles[method].marker]
    series, told, digits = [], [], decimals(metric)
    for method in methods:
        of_method = [row for row in rows if row.method == method]
        shift = 0.0
        if method in dodged:
            shift = pitch * DODGE * ((dodged.index(method) + 0.5) / len(dodged) - 0.5)
        marks = tuple(
            _mark(
                row,
                left + pitch * (steps.index(_step(row, by_class)) + 0.5) + shift,
                axis.at(row.value),
                (axis.at(row.ci_low), axis.at(row.ci_high))
                if math.isfinite(row.ci_low) and method in dodged
                else None,
            )
            for row in of_method
        )
        if not by_class:
            path = "M" + "L".join(f"{m.x:.1f} {m.y:.1f}" for m in marks)
        else:  # classes have no order that a line could follow; a floor has a level at each
            path = "" if method in dodged else "".join(_level(mark, step) for mark in marks)
        series.append(Series(method, styles[method], path, marks, (), Tags(method=method)))
        values = ", ".join(f"{_step(r, by_class)} {r.value:.{digits}f}" for r in of_method)
        told.append(f"{method}: {values}.")
    heights = spread([s.marks[-1].y for s in series], LABEL_GAP, top + 6, bottom)
    labelled = tuple(
        replace(of_method, words=(_label(of_method, right, height),))
        for of_method, height in zip(series, heights, strict=True)
    )
    better = f"{'higher' if higher_is_better(metric) else 'lower'} is better"
    where = f"at {panel}, by class" if by_class else f"against the conditions, class {panel}"
    return Plot(
        title=f"{metric} {where}",
        told=f"{better}. {' '.join(told)}",
        width=int(right + MARGINS[2]),
        height=HEIGHT + int(SLANTED) * by_class,
        area=(left, top, right, bottom),
        x_title="class" if by_class else "condition",
        y_title=f"{metric} ({better}{', logarithmic' if axis.logarithmic else ''})",
        x_ticks=tuple((left + pitch * (i + 0.5), name) for i, name in enumerate(steps)),
        y_ticks=tuple(axis.ticks()),
        series=labelled,
        slanted=by_class,
        wide=by_class,
        tags=Tags(condition=panel) if by_class else Tags(class_name=panel),
    )


def _level(mark: Mark, step: float) -> str:
    return f"M{mark.x - step / 2:.1f} {mark.y:.1f}h{step:.1f}"


def _label(series: Series, right: float, y: float) -> Word:
    last = series.marks[-1]
    leader = f"M{last.x + 6:.1f} {last.y:.1f}L{right + 12:.1f} {y:.1f}"
    return Word(right + 16, y, _short(series.name), leader=leader)


def _short(name: str) -> str:
    """The name of weights may be a long path: its end tells most."""
    return name if len(name) <= LONGEST else f"…{name[1 - LONGEST :]}"


def _mark(row: Row, x: float, y: float, upright: tuple[float, float] | None) -> Mark:
    digits = decimals(row.metric)
    interval = ""
    if math.isfinite(row.ci_low):
        interval = f" [{row.ci_low:.{digits}f}, {row.ci_high:.{digits}f}]"
    where = f"{row.method}, {row.condition}, {row.class_name}"
    tags = Tags(condition=row.condition, class_name=row.class_name)
    return Mark(x, y, f"{where}: {row.value:.{digits}f}{interval}", tags, upright=upright)
