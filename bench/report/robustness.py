"""Metrics against the conditions of a run, all methods in one plot: as files and on the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.analysis.comparison import Estimate
from bench.analysis.scores import QualityRow
from bench.catalogue.conditions import ConditionName, condition_name, condition_words, places
from bench.catalogue.methods import COST_VARIANTS, FLOOR, find_setting, role
from bench.catalogue.metrics import FURTHER_METRICS, higher_is_better, is_mean
from bench.records.artifacts import JobName
from bench.records.record import GROUND_TRUTH
from bench.records.stored_artifacts import Artifact
from bench.report.blank_region import shade_worse
from bench.report.figure import FIGURES, TEXT, WIDTH_IN, drawing, panels, save
from bench.report.image_sheets import write_images, write_thin_parts
from bench.report.inline import MarkedFigure, inline
from bench.report.page import Plot
from bench.report.styles import PAPER, RULE, MethodStyle, method_styles
from bench.tables.grid import Cell, Tags, ordered, shown
from bench.tables.markdown import visible
from bench.tables.quality import quality_cell
from bench.tables.table import Table

# The headline first; SSIM as the paper has it, which likes a white image, is one among the others.
METRICS = (
    *("ssim-object", "lpips", "silhouette-iou", "fd-views"),
    *("structure", "ssim", "fd-alexnet", "fid"),
    *FURTHER_METRICS,
)
COLUMNS = 2  # of panels in the file
MOST_STEPS = 8  # conditions or classes beside each other in a panel of half the width
HEIGHT_IN = 2.7
PLOT_IN, WIDE_IN = (5.4, 3.3), (10.8, 3.8)  # of a plot of the page
PLOT_TEXT = 9.0  # points: at least 11 px on a page, which shows a plot with at least 480 px
LEGEND_IN, LEGEND_COLUMNS = 0.5, 5
DODGE = 0.44  # of a step, that the methods of one condition take side by side
LONGEST = 18  # letters of a name
LINEAR = 1  # below it an axis of distances is linear, above it logarithmic
SUBDIVIDED = (1, 2, 5)


def write_figures(
    directory: Path, tables: Sequence[Table[QualityRow]], artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write robustness curves (after Tables 3 and 4), image grids and a sheet of thin parts.

    The grids are the paper's Figures 1 and 3. `artifacts` are all of the run, ground truths
    included. Nothing is written where all methods have failed.
    """
    if all(name.method == GROUND_TRUTH for name in artifacts):
        return
    folder = directory / FIGURES
    styles = method_styles(ordered(row.method for table in tables for row in table.rows))
    curved = curve_panels(tables)
    if curved:
        figure = robustness_figure(curved, styles).figure
        for kind in ("png", "svg"):
            save(figure, folder / f"robustness.{kind}")
    conditions = ordered(name.condition for name in artifacts if name.condition)
    write_images(folder / "pictures.png", artifacts, conditions)
    write_thin_parts(folder / "thin-parts.png", artifacts)


@dataclass(frozen=True)
class CurvePanel:
    """The values of a metric of one class by condition, or at one condition by class.

    Attributes
    ----------
    metric : str
        Id of the metric.
    place : str
        The class, or with `by_class` the condition.
    by_class : bool
        Whether the classes stand side by side, because there are several.
    rows : tuple of Row
        The values, in the order of the table.
    """

    metric: str
    place: str
    by_class: bool
    rows: tuple[QualityRow, ...]

    @property
    def steps(self) -> list[str]:
        """Return the conditions, or the classes, that stand side by side."""
        return ordered(map(self.step, self.rows))

    def step(self, row: QualityRow) -> str:
        """Return the condition, or the class, of a row."""
        return row.class_name if self.by_class else row.condition


def axis_title(metric: str) -> str:
    """Return the metric and its better direction."""
    return f"{metric} ({'higher' if higher_is_better(metric) else 'lower'} is better)"


def curve_panels(tables: Sequence[Table[QualityRow]]) -> list[CurvePanel]:
    """Return a panel for each of the metrics that has values, and for each class or condition.

    The ceiling, settings of a parameter, and methods measured for their cost alone are left out.
    """
    panels_ = []
    for metric in METRICS:
        rows = _rows(tables, metric)
        by_class = len({row.class_name for row in rows}) > 1
        places: dict[str, list[QualityRow]] = {}
        for row in rows:
            places.setdefault(row.condition if by_class else row.class_name, []).append(row)
        panels_ += [CurvePanel(metric, at, by_class, tuple(rows)) for at, rows in places.items()]
    return panels_


def _rows(tables: Sequence[Table[QualityRow]], metric: str) -> list[QualityRow]:
    """Return the rows of a metric that are drawn, of the table that has most of them."""
    by_table = [[row for row in table.rows if row.metric == metric] for table in tables]
    cost_variants = [method.id for method in COST_VARIANTS]
    return [
        row
        for row in max(by_table, key=len, default=[])
        if math.isfinite(row.value)
        and role(row.method) not in ("ceiling", "chosen")
        and find_setting(row.method) is None
        and row.method not in cost_variants
    ]


def curves(
    panels_: Sequence[CurvePanel], styles: Mapping[str, MethodStyle], name: str = "curve"
) -> tuple[Plot, ...]:
    """Return each panel as a plot of the page, whose legend stands beside the plots.

    `name`, unlike any other, begins the ids of their parts.
    """
    return tuple(_plot(panel, styles, f"{name}-{number}") for number, panel in enumerate(panels_))


def _plot(panel: CurvePanel, styles: Mapping[str, MethodStyle], name: str) -> Plot:
    place, axis = panel.place, axis_title(panel.metric)
    steps = (f"{panel.step(row)}{f' ({row.n_ok} of {row.n})' * row.failed}" for row in panel.rows)
    description = in_words(
        (row.method, step, quality_cell(row).text)
        for row, step in zip(panel.rows, steps, strict=True)
    )
    where = f" at {condition_words(place)}, by class" if panel.by_class else f", class {place}"
    wide = len(panel.steps) > MOST_STEPS
    figure = robustness_figure([panel], styles, WIDE_IN if wide else PLOT_IN, PLOT_TEXT)
    return Plot(
        title=f"{panel.metric}{where}",
        axis=f"{'higher' if higher_is_better(panel.metric) else 'lower'} is better",
        description=f"{axis}. {description}",
        svg=inline(figure, name),
        wide=wide,
        tags=Tags(condition=place) if panel.by_class else Tags(class_name=place),
    )


@drawing()
def robustness_figure(
    shown: Sequence[CurvePanel],
    styles: Mapping[str, MethodStyle],
    plot_in: tuple[float, float] | None = None,
    fontsize: float = TEXT,
) -> MarkedFigure:
    """Draw panels side by side, with one legend below, or one panel of `plot_in` without it.

    The methods of a step stand side by side, so that intervals do not cover each other. Floors are
    level lines without their intervals. What is worse than a white image is shaded.
    """
    columns = 1 if any(len(panel.steps) > MOST_STEPS for panel in shown) else COLUMNS
    columns = min(columns, len(shown))
    lines = math.ceil(len(shown) / columns)
    size_in = plot_in or (WIDTH_IN, HEIGHT_IN * lines + LEGEND_IN)
    figure, axes = panels(lines, columns, size_in)
    drawn = MarkedFigure(figure)
    for axis, panel in zip(axes.flat, shown, strict=False):
        _draw_panel(drawn, axis, panel, styles, fontsize)
        axis.set_title(axis_title(panel.metric), fontsize=fontsize + 1)
    for axis in axes.flat[len(shown) :]:
        axis.remove()
    if plot_in is None:
        drawn.legend(LEGEND_COLUMNS, fontsize)
    return drawn


def _draw_panel(
    drawn: MarkedFigure,
    axis: Any,
    panel: CurvePanel,
    styles: Mapping[str, MethodStyle],
    fontsize: float,
) -> None:
    steps, methods = panel.steps, ordered(row.method for row in panel.rows)
    # Of noise after fewer points nothing lies between: the lines end at a gap.
    names = [ConditionName("", step, step) for step in steps]
    names = names if panel.by_class else list(map(condition_name, steps))
    places_ = list(map(float, range(len(steps)))) if panel.by_class else places(steps)
    if not is_mean(panel.metric):
        scale_distances(axis)
    dodged = [method for method in methods if styles[method].marker]
    for method in methods:
        shift = 0.0
        if method in dodged:
            shift = DODGE * ((dodged.index(method) + 0.5) / len(dodged) - 0.5)
        points = [
            Point(
                places_[steps.index(panel.step(row))] + shift,
                row.condition,
                row.class_name,
                Estimate(row.value, row.ci_low, row.ci_high),
                quality_cell(row),
                _caveat(row),
                names[steps.index(panel.step(row))].kind,
            )
            for row in panel.rows
            if row.method == method
        ]
        # Classes have no order that a line could follow.
        joined = not panel.by_class
        line = draw_curve(drawn, axis, method, points, styles[method], joined)
        drawn.mark(line, Tags(method=method), series=not styles[method].marker)
    axis.grid(axis="y", color=RULE, linewidth=0.8)
    axis.set_axisbelow(True)
    axis.set_xlim(-0.5, max(places_[-1] + 0.5, 0.5))
    axis.set_xticks(places_, [visible(name.short) for name in names], fontsize=fontsize)
    axis.tick_params(axis="y", labelsize=fontsize)
    axis.spines[["top", "right", "left"]].set_visible(False)
    levels = {panel.step(row): row.value for row in panel.rows if row.method == FLOOR}
    spans = [
        (x - 0.5, x + 0.5, levels.get(s, math.nan)) for x, s in zip(places_, steps, strict=True)
    ]
    shade_worse(axis, panel.metric, spans, fontsize)
    hollow = any(row.failed and styles[row.method].marker for row in panel.rows)
    title = "; hollow: failed images are left out" * hollow
    if panel.by_class:
        for label in axis.get_xticklabels():
            label.set(rotation=38, ha="right", rotation_mode="anchor")
        title = f"class{title}"
    else:
        title = title.removeprefix("; ")
        _name_kinds(axis, places_, [name.kind for name in names], fontsize)
    # Below the names of kinds, for which an empty line keeps the room.
    axis.set_xlabel(
        title or " ", fontsize=fontsize, labelpad=4 if panel.by_class else 1.3 * fontsize
    )


def _name_kinds(axis: Any, at: Sequence[float], kinds: Sequence[str], fontsize: float) -> None:
    """Write below the ticks what changes there: the number of points, the noise."""
    for kind, group in groupby(zip(at, kinds, strict=True), key=itemgetter(1)):
        of_kind = [x for x, _ in group]
        title = "noise, of the radius" if kind == "noise" and len(of_kind) > 1 else kind
        axis.annotate(
            visible(title), ((of_kind[0] + of_kind[-1]) / 2, 0), (0, -fontsize * 1.9),
            ("data", "axes fraction"), "offset points", ha="center", va="top", fontsize=fontsize,
        )  # fmt: skip


def _caveat(row: QualityRow) -> str:
    """Return how many images a value is of, and the value with blank ones; "" without failures."""
    if not row.failed:
        return ""
    with_blank = shown(row.failures_as_blank, row.decimals)
    return f"{row.n_ok} of {row.n} images, {with_blank} with blank ones for the others"


class Point(NamedTuple):
    """A value of a method, as it is and as printed, and its place; hollow if it has a caveat.

    A line joins only neighbours of one kind.
    """

    x: float
    condition: str
    class_name: str
    estimate: Estimate
    printed: Cell
    caveat: str = ""
    kind: str = ""


def draw_curve(
    drawn: MarkedFigure,
    axis: Any,
    method: str,
    points: Sequence[Point],
    style: MethodStyle,
    joined: bool = True,
) -> Any:
    """Draw the points of a method with their intervals, and a line through them if `joined`.

    A floor is the line alone, or if it is not joined a level at each point. Return the line, which
    is labelled with the method and not marked yet.
    """
    at, values = _broken(points)
    of_line: Any = {"linestyle": style.dashes if joined else "none", "linewidth": 1.2}
    of_line |= {"markevery": [], "label": shortened(visible(method), LONGEST)}
    (line,) = axis.plot(at, values, **point_style(style, 5.5) | of_line)
    if not style.marker and not joined:
        left, right = np.array(at) - 0.5, np.array(at) + 0.5
        levels = axis.hlines(values, left, right, style.colour, style.dashes, linewidth=1)
        drawn.mark(levels, Tags(method=method))
    for at_point in points if style.marker else ():
        x, condition, class_name, (value, low, high), cell, caveat, _ = at_point
        if not math.isfinite(value):
            continue
        tags = Tags(method, condition, class_name)
        description = f"{method}, {condition}, {class_name}: {cell.text}"
        if cell.interval:
            description += " [{}, {}]".format(*cell.interval)
            (interval,) = axis.plot([x, x], [low, high], color=style.colour, linewidth=0.9)
            drawn.mark(interval, tags)
        (point,) = axis.plot(x, value, **point_style(style, 5.5))
        if caveat:
            make_hollow(point, style, 1.2)
            description += f"; {caveat}"
        drawn.mark(point, tags, description, series=True)
    return line


def _broken(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    """Return the places and values of a line, with a NaN where points of another kind begin."""
    at: list[float] = []
    values: list[float] = []
    for i, point in enumerate(points):
        if i and point.kind != points[i - 1].kind:
            at.append(math.nan)
            values.append(math.nan)
        at.append(point.x)
        values.append(point.estimate.value)
    return at, values


def in_words(values: Iterable[tuple[str, str, str]]) -> str:
    """Return (method, step, value) in words, for readers who do not see the plot."""
    by_method: dict[str, list[str]] = {}
    for method, step, value in values:
        by_method.setdefault(method, []).append(f"{step} {value}")
    return " ".join(f"{method}: {', '.join(steps)}." for method, steps in by_method.items())


def point_style(style: MethodStyle, size: float) -> dict[str, Any]:
    """Return matplotlib's settings for a point of `size` / 72 inch.

    Full markers have a thin light edge, partly filled ones an edge in their colour.
    """
    full = style.fill == "full"
    return {
        "color": style.colour,
        "marker": style.marker,
        "markersize": size,
        "fillstyle": style.fill,
        "markerfacecoloralt": PAPER,
        "markeredgecolor": PAPER if full else style.colour,
        "markeredgewidth": 0.4 if full else 0.8,
        "linestyle": "none",
    }


def make_hollow(point: Any, style: MethodStyle, edge: float) -> None:
    """Turn a point into an outline with an edge of `edge` / 72 inch."""
    point.set(markerfacecolor=PAPER, markeredgecolor=style.colour, markeredgewidth=edge)


def scale_distances(axis: Any) -> None:
    """Make an axis linear up to LINEAR and logarithmic above, for distances far apart."""
    from matplotlib.ticker import SymmetricalLogLocator

    axis.set_yscale("symlog", linthresh=LINEAR)
    axis.yaxis.set_major_locator(SymmetricalLogLocator(base=10, linthresh=LINEAR, subs=SUBDIVIDED))
    axis.yaxis.set_major_formatter("{x:g}")


def shortened(name: str, longest: int) -> str:
    """Return a name in at most `longest` letters."""
    # Its end tells most: it may be the path of a weights file.
    return name if len(name) <= longest else f"…{name[1 - longest :]}"
