"""Metrics against the conditions of a run, all methods in one plot: as files and on the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.comparison import decimals
from bench.catalogue.methods import FLOORS, find_method, role
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better
from bench.metrics.silhouette import object_boxes
from bench.metrics.thin_parts import evaluated
from bench.records.artifacts import Artifact, Item
from bench.records.record import GROUND_TRUTH
from bench.report.page import Mark, Plot, Series, Style, Word
from bench.report.styles import family, is_yardstick
from bench.tables.quality import Row
from bench.tables.table import Table, Tags

FIGURES = "figures"
OBJECTS_SHOWN = 4
THIN_OF = 8  # the first objects of a run, of which those with most thin parts are shown
THIN_CONDITIONS = ("2048", "noise-0.05")
THIN_TINT = (225, 0, 75)
METRICS_SHOWN = ("ssim", "structure", "fd-views", "fid")


def write_figures(
    directory: Path, tables: Sequence[Table[Row]], artifacts: Sequence[Artifact]
) -> None:
    """Robustness curves (after Tables 3 and 4), picture grids (the paper's Figures 1 and 3) and a
    sheet of thin parts.

    `artifacts` are all that there are, ground truths included. Where all methods have failed, there
    is nothing to draw.
    """
    if all(artifact.item.method == GROUND_TRUTH for artifact in artifacts):
        return
    import matplotlib as mpl

    mpl.use("Agg")
    folder = directory / FIGURES
    folder.mkdir(exist_ok=True)
    _robustness(folder / "robustness.png", tables)
    _grid(folder / "pictures.png", artifacts)
    _thin_parts(folder / "thin-parts.png", artifacts)


def _robustness(path: Path, tables: Sequence[Table[Row]]) -> None:
    from matplotlib import pyplot as plt

    shown: dict[str, list[Row]] = {}
    for row in (row for table in tables for row in table.rows):
        if row.metric in METRICS_SHOWN and math.isfinite(row.value):
            shown.setdefault(row.metric, []).append(row)
    figure, axes = plt.subplots(
        1, len(shown), figsize=(5 * len(shown), 4), squeeze=False, layout="constrained"
    )
    for axis, (metric, rows) in zip(axes[0], shown.items(), strict=True):
        for method in dict.fromkeys(row.method for row in rows):
            of_method = [row for row in rows if row.method == method]
            values = np.array([row.value for row in of_method])
            ends = np.array([(row.ci_low, row.ci_high) for row in of_method]).T
            reach = np.nan_to_num(np.abs(ends - values))
            axis.errorbar(
                [row.condition for row in of_method],
                values,
                yerr=reach,
                label=method,
                capsize=3,
                marker="o",
            )
        higher = metric in IMAGE_METRICS
        axis.set_title(f"{metric} ({'higher' if higher else 'lower'} is better)")
        axis.set_xlabel("condition")
        axis.grid(alpha=0.3)
        if not higher:
            axis.set_yscale("symlog", linthresh=10)
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _grid(path: Path, artifacts: Sequence[Artifact]) -> None:
    """The first view of the first objects: a row per object and method, a column per condition.

    Ceiling and floors are left out: the first column shows the truth, and what looks at no cloud
    needs no picture.
    """
    from matplotlib import pyplot as plt

    by_item = {artifact.item: artifact for artifact in artifacts}
    objects = list(dict.fromkeys(item.object for item in by_item))[:OBJECTS_SHOWN]
    conditions = list(dict.fromkeys(item.condition for item in by_item if item.condition))
    methods = _rivals(by_item)
    rows = [(obj, method) for obj in objects for method in methods]
    columns = [GROUND_TRUTH, *conditions]
    if not rows:
        return
    figure, axes = plt.subplots(
        len(rows), len(columns), figsize=(1.3 * len(columns) + 1, 1.3 * len(rows)), squeeze=False
    )
    for axis_row, (obj, method) in zip(axes, rows, strict=True):
        for axis, column in zip(axis_row, columns, strict=True):
            of_method = (method, column) if column != GROUND_TRUTH else (GROUND_TRUTH, "")
            artifact = by_item.get(Item(*of_method, *obj))
            show(axis, None if artifact is None else artifact.pictures()[0])
        axis_row[0].set_ylabel(f"{obj[1][:18]}\n{method}", fontsize=7)
    for axis, column in zip(axes[0], columns, strict=True):
        axis.set_title(column, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _thin_parts(path: Path, artifacts: Sequence[Artifact]) -> None:
    """Objects with the most thin parts, each in the view that shows most of them, cut out.

    Columns: the truth, the truth with the evaluated pixels tinted, then method by method the
    pictures at a clean and at a noisy condition.
    """
    from matplotlib import pyplot as plt

    by_item = {artifact.item: artifact for artifact in artifacts}
    truths = [artifact for artifact in artifacts if artifact.item.method == GROUND_TRUTH][:THIN_OF]
    parts = {truth.item.object: evaluated(truth.pictures()) for truth in truths}
    counts = {obj: part.sum(axis=(1, 2)) for obj, part in parts.items()}
    by_count = sorted(truths, key=lambda truth: -int(counts[truth.item.object].sum()))
    chosen = [truth for truth in by_count if counts[truth.item.object].any()][:OBJECTS_SHOWN]
    there = {item.condition for item in by_item}
    columns = [
        (method, condition)
        for method in _rivals(by_item)
        for condition in THIN_CONDITIONS
        if condition in there
    ]
    if not chosen or not columns:
        return
    figure, axes = plt.subplots(
        len(chosen),
        2 + len(columns),
        figsize=(2.2 * (2 + len(columns)), 2.3 * len(chosen)),
        squeeze=False,
    )
    for axis_row, truth in zip(axes, chosen, strict=True):
        obj = truth.item.object
        view = int(counts[obj].argmax())
        true = truth.pictures()[view]
        top, bottom, left, right = object_boxes(true[None])[0].tolist()
        cut = slice(max(top - 3, 0), bottom + 3), slice(max(left - 3, 0), right + 3)
        tinted = np.where(parts[obj][view][..., None], np.array(THIN_TINT, np.uint8), true)
        show(axis_row[0], true[cut], "nearest")
        show(axis_row[1], tinted[cut], "nearest")
        for axis, cell in zip(axis_row[2:], columns, strict=True):
            artifact = by_item.get(Item(*cell, *obj))
            show(axis, None if artifact is None else artifact.pictures()[view][cut], "nearest")
        axis_row[0].set_ylabel(f"{obj[1][:18]}\nview {view}", fontsize=7)
    titles = [GROUND_TRUTH, "its thin parts", *(f"{m}\n{c}" for m, c in columns)]
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def show(axis: Any, picture: NDArray[np.uint8] | None, interpolation: str | None = None) -> None:
    """A picture without a frame, or the word that there is none."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_visible(False)
    if picture is None:
        axis.text(0.5, 0.5, "failed", ha="center", va="center", transform=axis.transAxes)
    else:
        axis.imshow(picture, interpolation=interpolation)


def _rivals(items: Iterable[Item]) -> list[str]:
    """The methods that are compared, in order: without ceiling and floors."""
    methods = dict.fromkeys(item.method for item in items if item.condition)
    return [m for m in methods if m not in FLOORS and not find_method(m).sees_mesh]


WIDE = 20.0  # positive values whose greatest is so many times the least have a logarithmic axis
PAD = 0.06  # of the values' reach, at both ends


@dataclass(frozen=True)
class Axis:
    """Values from `low` to `high` on pixels from `start` to `end`."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool

    def at(self, value: float) -> float:
        """The pixel of a value; of what lies beyond the axis (0 on a logarithmic one), its end."""
        low, high = self._scale(self.low), self._scale(self.high)
        inside = min(max(value, self.low), self.high)
        return self.start + (self._scale(inside) - low) / (high - low) * (self.end - self.start)

    def ticks(self, most: int = 6) -> list[tuple[float, str]]:
        """Round values in the axis' reach as (pixel, label)."""
        values = self._powers(most) if self.logarithmic else self._steps(most)
        return [(self.at(value), f"{value:g}") for value in values]

    def _scale(self, value: float) -> float:
        return math.log10(value) if self.logarithmic else value

    def _powers(self, most: int) -> list[float]:
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        for digits in ((1, 2, 5), (1, 3), (1,)):
            values = [digit * 10.0**power for power in range(first, last + 1) for digit in digits]
            values = [value for value in values if self.low <= value <= self.high]
            if len(values) <= most:
                break
        return values

    def _steps(self, most: int) -> list[float]:
        rough = (self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(s for s in (power, 2 * power, 5 * power, 10 * power) if s >= rough * (1 - 1e-9))
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        digits = max(0, 2 - math.floor(math.log10(step)))
        return [round(number * step, digits) for number in range(first, last + 1)]


def axis_of(
    values: Sequence[float], start: float, end: float, logarithmic: bool | None = None
) -> Axis:
    """An axis on which all finite values have room.

    logarithmic  None: where all are positive and far apart. Otherwise what is asked for; the axis
                 of a logarithm leaves out what is not positive.

    Without any value it goes from 0 to 1, with equal ones a little to both sides.
    """
    finite = [value for value in values if math.isfinite(value)]
    if logarithmic is None:
        logarithmic = bool(finite) and min(finite) > 0 and max(finite) / min(finite) > WIDE
    if logarithmic:
        finite = [math.log10(value) for value in finite if value > 0]
    low, high = (min(finite), max(finite)) if finite else (0.0, 1.0)
    pad = PAD * (high - low) or 0.1 * max(abs(low), 1.0)
    low, high = low - pad, high + pad
    if logarithmic:
        low, high = 10.0**low, 10.0**high
    return Axis(low, high, start, end, logarithmic)


def axis_with_room(
    values: Sequence[float], ends: Sequence[float], start: float, end: float
) -> Axis:
    """The axis of `values` on which `ends`, of their intervals say, have room too.

    The values alone decide about a logarithm: an interval that reaches down to 0 ends at the axis.
    """
    return axis_of(ends, start, end, axis_of(values, start, end).logarithmic)


def spread(wanted: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Places near the wanted ones, in their order, `gap` apart and from `low` to `high`.

    Where there is no room for all they go on beyond `low`.
    """
    order = sorted(range(len(wanted)), key=lambda i: wanted[i])
    places = [max(wanted[i], low) for i in order]
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + gap)
    ceiling = high
    for i in reversed(range(len(places))):
        places[i] = min(places[i], ceiling)
        ceiling = places[i] - gap
    back = dict(zip(order, places, strict=True))
    return [back[i] for i in range(len(wanted))]


METRICS = ("ssim", "structure", "silhouette-iou", "fd-views", "fid")
HEIGHT = 330
MARGINS = (52.0, 12.0, 148.0, 46.0)  # left, top, right, bottom; labels stand at the right
LEAST_STEP = 60.0  # pixels between conditions
LETTER = 7.0  # pixels of a letter of a tick's label
SLANTED = 40.0  # pixels more at the bottom for names of many classes, which are slanted
DODGE = 0.44  # of a step, that the methods of one condition take side by side
LABEL_GAP = 15.0
LONGEST = 18  # letters of a label


def curves(tables: Sequence[Table[Row]], styles: Mapping[str, Style]) -> tuple[Plot, ...]:
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


def _rows(tables: Sequence[Table[Row]], metric: str) -> list[Row]:
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
