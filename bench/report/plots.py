"""Figures of frames: methods along an axis, quality against cost, and dots in rows.

Better is up, of dots to the right. What is worse than a white image is shaded.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from bench.analysis.comparison import ALL
from bench.analysis.paper import AVERAGE
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOOR, find_setting, role
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better
from bench.report.figure import TEXT, WIDTH_IN, drawing, panels
from bench.report.styles import INK, PAPER, RULE, SHADE, SOFT, MethodStyle
from bench.tables.grid import ordered
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Styles = Mapping[str, MethodStyle]
Scale = Literal["linear", "log", "distance"]

PANEL_IN, ENTRY_IN = 2.5, 0.2  # heights of a panel and of a line of the legend
LETTERS_PER_INCH, ENTRY_LETTERS = 15, 8  # of a legend, and beside each name
LONGEST = 24  # letters of a name
_LINEAR = 1  # below it an axis of distances is linear, above it logarithmic
DIRECTIONS = "\N{LEFTWARDS ARROW} worse   better \N{RIGHTWARDS ARROW}"
_WORSE = "worse than a white image"
OPTIONAL = {"low": math.nan, "high": math.nan, "kind": "", "hollow": False}  # columns of a point
_BESIDE = (  # places of a label: offset in points of 1/72 inch, alignment
    *((6, 4, "left", "bottom"), (6, -4, "left", "top"), (-6, 4, "right", "bottom")),
    *((-6, -4, "right", "top"), (0, 7, "center", "bottom"), (0, -7, "center", "top")),
    *((7, 0, "left", "center"), (-7, 0, "right", "center")),
)


@dataclass(frozen=True, eq=False)
class SweepPanel:
    """Values of methods along an axis.

    values     a point a row: method, x, value; perhaps low and high, the ends of its interval; kind
               (a line joins only neighbours of one kind); hollow (it is drawn as an outline)
    title      above the panel
    x_label    below it, `y_label` at its left
    ticks      names by their places on the axis; None for numbers
    kinds      names below the ticks, by place
    turned     whether lower values are better, and stand higher
    joined     whether lines join the points of a method
    trained    (method, left, right): where a network was trained, as a band
    """

    values: pd.DataFrame
    title: str = ""
    x_label: str = ""
    y_label: str = ""
    ticks: Mapping[float, str] | None = None
    kinds: Mapping[float, str] = field(default_factory=dict)
    turned: bool = False
    joined: bool = True
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    trained: Sequence[tuple[str, float, float]] = ()


def grouped(frame: pd.DataFrame, by: str | list[str]) -> list[tuple[Any, pd.DataFrame]]:
    """Return the rows of each value of a column, or of each values of several, in their order."""
    return list(frame.groupby(by, sort=False))


def points_of(frame: pd.DataFrame) -> list[Any]:
    """Return the rows of a frame with their columns as attributes."""
    return list(frame.itertuples())


def axis_title(metric: str) -> str:
    """Return the metric and its better direction."""
    return f"{metric} ({'higher' if higher_is_better(metric) else 'lower'} is better)"


def marker(style: MethodStyle, size: float = 5.5, *, hollow: bool = False) -> dict[str, Any]:
    """Return matplotlib's settings for a point of `size` / 72 inch, without a line."""
    whole = style.fill == "full" and not hollow  # a thin light edge parts it from its neighbours
    return {
        "color": style.colour,
        "marker": style.marker or "None",
        "markersize": size,
        "fillstyle": style.fill,
        "markerfacecolor": PAPER if hollow else style.colour,
        "markerfacecoloralt": PAPER,
        "markeredgecolor": PAPER if whole else style.colour,
        "markeredgewidth": 0.4 if whole else 0.9,
        "linestyle": "none",
    }


@drawing()
def sweep_figure(
    shown: Sequence[SweepPanel],
    styles: Styles,
    *,
    columns: int = 2,
    width_in: float = WIDTH_IN,
    panel_in: float = PANEL_IN,
    dodge: float = 0.0,
    fontsize: float = TEXT,
    **shared: Any,
) -> Figure:
    """Return panels of methods along an axis, line by line, under one legend.

    shown               one panel or more
    styles              of every method of the panels; one without a marker is a floor, a line alone
    columns             panels beside each other
    width_in, panel_in  width of the figure and height of a panel, inches
    dodge               part of a unit of the axis that the methods at one place take side by side
    fontsize            of all text, points
    **shared            `sharex`, `sharey` as of `matplotlib.figure.Figure.subplots`
    """
    columns = min(columns, len(shown))
    rows = math.ceil(len(shown) / columns)
    figure, axes = panels(rows, columns, (width_in, panel_in * rows), **shared)
    for axis, panel in zip(axes.flat, shown, strict=False):
        _draw_sweep(axis, panel, styles, dodge)
        _name_axes(axis, panel, fontsize)
    for axis in axes.flat[len(shown) :]:
        axis.remove()
    for axis, panel in zip(axes.flat, shown, strict=False):  # with the limits that they share
        blank = panel.values[panel.values["method"] == FLOOR]
        _shade_worse(axis, blank["x"].tolist(), blank["value"].tolist())
    _legend(figure, fontsize)
    return figure


def _draw_sweep(axis: Any, panel: SweepPanel, styles: Styles, dodge: float) -> None:
    missing = {name: value for name, value in OPTIONAL.items() if name not in panel.values}
    values = panel.values.assign(**missing)
    by_method = dict(grouped(values, "method"))
    dodged = [method for method in by_method if styles[method].marker]
    for method, points in by_method.items():
        style, name = styles[method], shortened(method)
        if not style.marker:
            _draw_floor(axis, points["x"].tolist(), points["value"].tolist(), style, name)
            continue
        x = points["x"] + dodge * ((dodged.index(method) + 0.5) / len(dodged) - 0.5)
        line = {"linestyle": style.dashes if panel.joined else "none", "linewidth": 1.2}
        neighbours = (points["kind"] != points["kind"].shift()).cumsum()
        for number, part in points.groupby(neighbours):
            label = {"label": name} if number == 1 else {}
            axis.plot(x[part.index], part["value"], **marker(style) | line | label)
        axis.vlines(x, points["low"], points["high"], color=style.colour, linewidth=0.9)
        outlines = points["hollow"].astype(bool)
        axis.plot(x[outlines], points["value"][outlines], **marker(style, hollow=True))
    for name, low, high in panel.trained:
        if name in by_method:
            band: dict[str, Any] = {"color": styles[name].colour, "alpha": 0.13, "linewidth": 0}
            axis.axvspan(low, high, label=f"{shortened(name)} was trained here", **band)


def _name_axes(axis: Any, panel: SweepPanel, fontsize: float) -> None:
    from matplotlib.ticker import SymmetricalLogLocator

    axis.set_title(visible(panel.title), fontsize=fontsize + 1)
    axis.set_xlabel(panel.x_label, fontsize=fontsize)
    axis.set_ylabel(panel.y_label, fontsize=fontsize)
    axis.set_xscale(panel.x_scale)
    if panel.y_scale == "distance":
        axis.set_yscale("symlog", linthresh=_LINEAR)
        subs = {"base": 10, "linthresh": _LINEAR, "subs": (1, 2, 5)}
        axis.yaxis.set_major_locator(SymmetricalLogLocator(**subs))
    else:
        axis.set_yscale(panel.y_scale)
    if panel.y_scale != "linear":  # a power would be written as a formula
        axis.yaxis.set_major_formatter("{x:g}")
    if panel.ticks is not None:
        axis.set_xticks(list(panel.ticks), list(map(visible, panel.ticks.values())))
        axis.xaxis.remove_overlapping_locs = False  # a kind stands below its only condition
        axis.set_xticks(list(panel.kinds), list(panel.kinds.values()), minor=True)
        axis.tick_params(axis="x", which="minor", length=0, pad=5 + 1.4 * fontsize)
    axis.yaxis.set_inverted(panel.turned)
    _tidy(axis, fontsize)


def _draw_floor(
    axis: Any, x: Sequence[float], levels: Sequence[float], style: MethodStyle, name: str
) -> None:
    """Draw a level across the axis, or one at each place where they differ."""
    look: dict[str, Any] = {"color": style.colour, "linestyle": style.dashes, "linewidth": 1}
    if np.ptp(levels) < 1e-6:
        axis.axhline(levels[0], label=name, **look)
    else:
        axis.plot(x, levels, drawstyle="steps-mid", label=name, **look)


def _shade_worse(axis: Any, x: Sequence[float], levels: Sequence[float]) -> None:
    """Shade what is below the levels of a white image, as the axis is turned."""
    if not np.isfinite(levels).any():
        return
    limits = {"xlim": axis.get_xlim(), "ylim": axis.get_ylim()}
    look: dict[str, Any] = {"color": SHADE, "linewidth": 0, "zorder": 0.4, "label": _WORSE}
    if np.ptp(levels) < 1e-6:
        axis.axhspan(levels[0], limits["ylim"][0], **look)
    else:
        around, ends = [x[0] - 1, *x, x[-1] + 1], [levels[0], *levels, levels[-1]]
        axis.fill_between(around, ends, limits["ylim"][0], step="mid", **look)
    axis.set(**limits)


def _tidy(axis: Any, fontsize: float, grid: Literal["x", "y", "both"] = "y") -> None:
    axis.grid(axis=grid, color=RULE, linewidth=0.7)
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=fontsize, which="both")
    axis.spines[["top", "right"]].set_visible(False)


def _legend(figure: Figure, fontsize: float) -> None:
    """Write one legend above all axes, and give the figure the room for it."""
    entries: dict[str, Any] = {}
    for axis in figure.axes:
        handles, labels = axis.get_legend_handles_labels()
        entries = dict(zip(labels, handles, strict=True)) | entries
    if _WORSE in entries:
        entries[_WORSE] = entries.pop(_WORSE)  # last
    names, (width, height) = list(entries), figure.get_size_inches()
    rows = 1
    for rows in range(1, len(names) + 1):
        columns = [names[i : i + rows] for i in range(0, len(names), rows)]
        letters = sum(max(map(len, column)) + ENTRY_LETTERS for column in columns)
        if letters <= LETTERS_PER_INCH * width * TEXT / fontsize:
            break
    figure.set_size_inches(width, height + ENTRY_IN * (rows + 1) * fontsize / TEXT)
    figure.legend(
        *(list(entries.values()), names), loc="outside upper center",
        ncols=math.ceil(len(names) / rows), fontsize=fontsize, frameon=False, handlelength=2.6,
    )  # fmt: skip


def shortened(name: str) -> str:
    """Return the printable name in at most `LONGEST` letters."""
    # Its end tells most: it may be the path of a weights file.
    name = visible(name)
    return name if len(name) <= LONGEST else f"…{name[1 - LONGEST :]}"


@drawing()
def frontier_figure(
    points: pd.DataFrame,
    styles: Styles,
    x_label: str,
    *,
    columns: int = 2,
    named: Container[str] | None = None,
    width_in: float = WIDTH_IN,
    panel_in: float = 3.4,
    fontsize: float = TEXT,
) -> Figure:
    """Return quality against cost, with the frontier as steps, under one legend.

    points    a method in a panel a row: metric, panel (its title), method, cost, cost_low,
              cost_high, value, low, high, verdict (as of `bench.analysis.frontier.places`). A floor
              has no cost and is a line. The panels of a metric have the same axes.
    styles    of every method
    x_label   what the costs are
    columns   panels beside each other
    named     methods of the legend, others are small. Default: all but settings of a parameter.
    width_in  width of the figure, and `panel_in`, height of a panel, inches
    fontsize  of all text, points
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    cells = grouped(points, ["metric", "panel"])
    columns = min(columns, len(cells))
    rows = math.ceil(len(cells) / columns)
    figure, axes = panels(rows, columns, (width_in, panel_in * rows), sharex=True)
    first: dict[str, Any] = {}
    for axis, ((metric, title), of_cell) in zip(axes.flat, cells, strict=False):
        if first.setdefault(metric, axis) is not axis:
            axis.sharey(first[metric])
        _draw_costs(axis, of_cell, styles, named)
        axis.set_title(visible(title), fontsize=fontsize + 1)
        axis.set_xlabel(x_label, fontsize=fontsize)
        axis.set_ylabel(axis_title(metric) if axis in axes[:, 0] else "", fontsize=fontsize)
        axis.tick_params(labelbottom=True, which="both")
        _scale_costs(axis, metric)
        _tidy(axis, fontsize, "both")
    for axis in axes.flat[len(cells) :]:
        axis.remove()
    for axis, (_, of_cell) in zip(axes.flat, cells, strict=False):
        _draw_frontier(axis, of_cell[of_cell["verdict"] == "frontier"])
        blank = of_cell[of_cell["method"] == FLOOR]["value"].tolist()
        _shade_worse(axis, [1.0] * len(blank), blank)
    _legend(figure, fontsize)
    figure.draw_without_rendering()  # before it nothing has a place
    renderer = FigureCanvasAgg(figure).get_renderer()  # one, or each text's size makes its own
    for axis, (_, of_cell) in zip(axes.flat, cells, strict=False):
        _label_where_free(axis, of_cell, named, fontsize, renderer)
    return figure


def _is_named(method: str, named: Container[str] | None) -> bool:
    return find_setting(method) is None if named is None else method in named


def _scale_costs(axis: Any, metric: str) -> None:
    from matplotlib.ticker import LogFormatter

    axis.set_xscale("log")
    axis.set_yscale("linear" if metric in IMAGE_METRICS else "log")
    axis.yaxis.set_inverted(not higher_is_better(metric))
    for scale in (axis.xaxis, axis.yaxis) if metric not in IMAGE_METRICS else (axis.xaxis,):
        scale.set_major_formatter("{x:g}")
        # matplotlib's own labels within a decade are TeX, which figures show as it is.
        scale.set_minor_formatter(LogFormatter())


def _draw_costs(
    axis: Any, points: pd.DataFrame, styles: Styles, named: Container[str] | None
) -> None:
    rivals = [p for p in points_of(points) if not role(p.method)]
    axis.margins(x=0.1, y=0.08)
    for family in ordered(family_of(p.method) for p in rivals):
        steps = [p for p in rivals if family_of(p.method) == family]
        if any(find_setting(p.method) for p in steps):  # of a parameter
            swept = [p for p in steps if p.method == family or find_setting(p.method)]
            at = [p.cost for p in swept], [p.value for p in swept]
            axis.plot(*at, color=styles[family].colour, linewidth=0.9)
    known = points[points["method"].isin([p.method for p in rivals])]
    thin: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.6}
    thin["colors"] = [styles[method].colour for method in known["method"]]
    axis.vlines(known["cost"], known["low"], known["high"], **thin)
    axis.hlines(known["value"], known["cost_low"], known["cost_high"], **thin)
    for p in rivals:
        style, big = styles[p.method], _is_named(p.method, named)
        hollow = p.verdict == "below a white image"
        label = {"label": shortened(p.method)} if big else {}
        axis.plot(p.cost, p.value, **marker(style, 6.5 if big else 3.0, hollow=hollow) | label)
    for p in points_of(points):
        if role(p.method) == "floor":
            _draw_floor(axis, [1.0], [p.value], styles[p.method], shortened(p.method))


def _draw_frontier(axis: Any, best: pd.DataFrame) -> None:
    """Draw the best quality that each cost buys, in steps up to the right end."""
    if best.empty:
        return
    best, limits = best.sort_values("cost"), axis.get_xlim()
    cost, value = [*best["cost"], limits[1]], [*best["value"], best["value"].iloc[-1]]
    steps: dict[str, Any] = {"color": INK, "linewidth": 1.3, "alpha": 0.75, "zorder": 1.5}
    axis.step(cost, value, where="post", label="frontier", **steps)
    axis.set_xlim(limits)


def _label_where_free(
    axis: Any, points: pd.DataFrame, named: Container[str] | None, fontsize: float, renderer: Any
) -> None:
    """Write names beside points where they cover nothing; the legend has the others."""
    from matplotlib.transforms import Bbox

    competing = [p for p in points_of(points) if not role(p.method)]
    places = axis.transData.transform([(p.cost, p.value) for p in competing] or [(0, 0)])
    taken = [Bbox.from_bounds(x - 4, y - 4, 8, 8) for x, y in places]
    for line in (line for line in axis.lines if line.get_drawstyle() == "steps-post"):
        for (x, y), (x2, y2) in pairwise(axis.transData.transform(line.get_xydata())):
            low, high = sorted((y, y2))
            taken += [Bbox([(x, y - 1), (x2, y + 1)]), Bbox([(x2 - 1, low), (x2 + 1, high)])]
    for p in (p for p in competing if _is_named(p.method, named)):
        at = (p.cost, p.value), (0, 0), "data", "offset points"
        note = axis.annotate(shortened(p.method), *at, fontsize=fontsize)
        note.set_in_layout(False)
        for *offset, ha, va in _BESIDE:
            note.set(position=offset, ha=ha, va=va)
            box = note.get_window_extent(renderer)
            if axis.bbox.count_contains(box.corners()) == 4 and not box.count_overlaps(taken):
                taken.append(box)
                break
        else:
            note.remove()


@drawing()
def dots_figure(
    values: pd.DataFrame,
    styles: Styles,
    *,
    zero: bool = False,
    width_in: float = WIDTH_IN,
    fontsize: float = TEXT,
) -> Figure:
    """Return dots with their intervals in rows, a panel beside the other, under one legend.

    values    a dot a row: panel (its title), turned (whether lower values are better), row (its
              name), method, value; perhaps low, high and hollow. The row of all classes stands
              apart.
    styles    of every method
    zero      whether values are differences: left of 0 is shaded. Else a line joins the dots of a
              row, and 0 is in sight.
    width_in  width of the figure, inches
    fontsize  of all text, points
    """
    values = values.assign(**{n: v for n, v in OPTIONAL.items() if n not in values})
    rows = {name: float(place) for place, name in enumerate(ordered(values["row"]))}
    apart = [name for name in rows if name in (ALL, AVERAGE) and len(rows) > 1]
    rows |= {name: rows[name] + 0.5 for name in apart}
    methods = ordered(values["method"])
    cells = grouped(values, "panel")
    size_in = (width_in, 0.7 + 0.28 * len(rows))
    figure, (axes,) = panels(1, len(cells), size_in, sharey=True)
    for axis, (title, of_cell) in zip(axes, cells, strict=True):
        if not zero:
            for name, of_row in grouped(of_cell, "row"):
                at = [rows[name]] * len(of_row)
                axis.plot(of_row["value"], at, color=RULE, linewidth=3, zorder=1)
        for number, method in enumerate(methods):
            dots = of_cell[of_cell["method"] == method]
            shift = (number - (len(methods) - 1) / 2) * min(0.3, 0.6 / len(methods)) * zero
            y, style = dots["row"].map(rows).astype(float) + shift, styles[method]
            axis.hlines(y, dots["low"], dots["high"], color=style.colour, linewidth=0.9)
            axis.plot(dots["value"], y, **marker(style) | {"label": shortened(method)})
            hollow = dots["hollow"].astype(bool)
            axis.plot(dots["value"][hollow], y[hollow], **marker(style, hollow=True))
        for name in apart:
            axis.axhline(rows[name] - 0.75, color=RULE, linewidth=0.8)
        axis.set_title(visible(title), fontsize=fontsize + 1)
        if not zero:
            axis.set_xlim(left=0)
        axis.xaxis.set_inverted(bool(of_cell["turned"].iloc[0]))
        if zero:
            axis.axvline(0, color=SOFT, linewidth=1)
            worst, best = axis.get_xlim()
            axis.axvspan(worst, 0, color=SHADE, linewidth=0, zorder=0)
            axis.set_xlim(worst, best)
            axis.set_xlabel(DIRECTIONS, fontsize=fontsize)
        _tidy(axis, fontsize, "x")
    axes[0].set_yticks(list(rows.values()), list(map(visible, rows)))
    axes[0].set_ylim(max(rows.values()) + 0.6, -0.6)
    _legend(figure, fontsize)
    return figure
