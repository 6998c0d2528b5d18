"""Figures of frames: methods along an axis, quality against cost, and dots in rows.

Better is up, of dots to the right. What is worse than a white image is shaded.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.compare import ALL
from bench.analysis.paper import AVERAGE
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOOR, find_setting, role
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better
from bench.report.styles import INK, PAPER, RULE, SHADE, SOFT, MethodStyle
from bench.tables.grid import ordered
from bench.tables.markdown import visible
from data_prep.files.atomic_write import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = "figures"  # folder of figures in that of a run
DPI = 110  # pixels per inch of a PNG
# Figures fit a page: they are 800 px wide, sheets of images at most 1,600 px high.
WIDTH_IN, MOST_HIGH_IN = 800 / DPI, 1600 / DPI
TEXT = 8.0  # points, the smallest in a figure
# Text of an SVG stays text, its ids are the same every time, and a $ in a name is a $.
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pc2pix-bench",
    "text.parse_math": False,
}

Image = NDArray[np.uint8]


@contextmanager
def drawing() -> Iterator[None]:
    """Set the style of figures; names are drawn as they stand, whatever their characters are."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        yield


def panels(
    rows: int,
    columns: int,
    size_in: tuple[float, float],
    *,
    layout: str | None = "constrained",
    **shared: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of `size_in` inches (width, height) and its axes [rows, columns]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, layout=layout)  # type: ignore[arg-type]
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def save(figure: Figure, path: Path, dpi: float = DPI) -> None:
    """Write a figure as the suffix says, PNG or SVG; the same figure gives the same bytes.

    Raises OSError.
    """
    kind = path.suffix.removeprefix(".")
    metadata = {"Date": None} if kind == "svg" else None
    with drawing(), atomic_write(path) as new:
        figure.savefig(new, format=kind, dpi=dpi, metadata=metadata)


Styles = Mapping[str, MethodStyle]
Scale = Literal["linear", "log", "distance"]

PANEL_IN = 2.5  # inches: height of a panel
ENTRY_IN = 0.2  # inches: height of a line of the legend
LETTERS_PER_INCH = 15  # letters of the legend that have room in an inch, at the size TEXT
ENTRY_LETTERS = 8  # letters that would have room in place of an entry's marker and margins
LEGEND = "legend: "  # begins the id of a name in a legend
_TITLE_LETTERS = 48  # letters in a line of a title: more are wider than one of two panels
LONGEST = 24  # letters of a method's name in a legend; of a longer one the end is shown
DIRECTIONS = "\N{LEFTWARDS ARROW} worse   better \N{RIGHTWARDS ARROW}"
_WORSE = "worse than a white image"
# Columns that a frame of points may lack, with the values that they then have.
OPTIONAL = {"low": math.nan, "high": math.nan, "kind": "", "hollow": False, "title": ""}
# Where a label may stand beside its point, tried in this order: offsets to the right and upwards in
# points (1/72 inch), and the side or corner of the text that stands there.
_BESIDE = (
    (6, 4, "left", "bottom"),
    (6, -4, "left", "top"),
    (-6, 4, "right", "bottom"),
    (-6, -4, "right", "top"),
    (0, 7, "center", "bottom"),
    (0, -7, "center", "top"),
    (7, 0, "left", "center"),
    (-7, 0, "right", "center"),
)


@dataclass(frozen=True, eq=False)
class SweepPanel:
    """Values of methods along an axis.

    values   a row for each point, with the columns method, x and value; perhaps low and high (the
             ends of its interval), kind (a line joins only neighbours of the same kind), hollow (it
             is drawn as an outline) and title (what the page says of a point)
    title    above the panel
    x_label  below it
    y_label  at its left
    ticks    names by their positions on the x axis; None where it has numbers
    kinds    names below the ticks, by position
    turned   whether lower values are better, and stand higher
    joined   whether lines join the points of a method
    x_scale  scale of the x axis
    y_scale  scale of the y axis; "distance" is logarithmic where all values are over 0
    trained  (method, left, right): a band where a network was trained
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
    """Return (value, its rows) for each value of a column, in the order of the rows.

    by  the column; of several columns each combination of values has its rows
    """
    return list(frame.groupby(by, sort=False))


def points_of(frame: pd.DataFrame) -> list[Any]:
    """Return the rows of a frame as tuples, with their columns as attributes."""
    return list(frame.itertuples())


def axis_title(metric: str) -> str:
    """Return the metric and its better direction."""
    return f"{metric} ({'higher' if higher_is_better(metric) else 'lower'} is better)"


def marks_id(method: str, titles: Iterable[str] = ()) -> str:
    """Return the id by which the page knows whose marks these are, and the title of each."""
    return json.dumps([shortened(method), *titles])


def marker(style: MethodStyle, size: float = 5.5, *, hollow: bool = False) -> dict[str, Any]:
    """Return matplotlib's settings for a point of `size` / 72 inch, without a line."""
    return {
        "color": style.colour,
        "marker": style.marker or "None",
        "markersize": size,
        "markerfacecolor": PAPER if hollow else style.colour,
        # A thin light edge parts a whole point from its neighbours.
        "markeredgecolor": style.colour if hollow else PAPER,
        "markeredgewidth": 0.9 if hollow else 0.4,
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
    dodge               part of a unit of the x axis over which methods stand side by side
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
        if _white_is_best(panel):  # the whole panel would be shaded
            title = f"{axis.get_title()}\nno method is better than a white image"
            axis.set_title(title.strip(), fontsize=fontsize + 1)
            continue
        _shade_worse(axis, blank["x"].tolist(), blank["value"].tolist())
    _legend(figure, fontsize)
    return figure


def _draw_sweep(axis: Any, panel: SweepPanel, styles: Styles, dodge: float) -> None:
    """Draw the points, lines and intervals of a panel, and the bands of trained networks."""
    missing = {name: value for name, value in OPTIONAL.items() if name not in panel.values}
    values = panel.values.assign(**missing)
    by_method = dict(grouped(values, "method"))
    dodged = [method for method in by_method if styles[method].marker]
    for method, points in by_method.items():
        style, name = styles[method], shortened(method)
        if not style.marker:
            _draw_floor(axis, points["x"].tolist(), points["value"].tolist(), style, name)
            axis.lines[-1].set_gid(marks_id(method, points["title"].iloc[:1]))
            continue
        x = points["x"] + dodge * ((dodged.index(method) + 0.5) / len(dodged) - 0.5)
        line = {"linestyle": style.dashes if panel.joined else "none", "linewidth": 1.2}
        part_numbers = (points["kind"] != points["kind"].shift()).cumsum()  # 1 and up
        for number, part in points.groupby(part_numbers):
            label = {"label": name} if number == 1 else {}
            gid = marks_id(method, part["title"][part["value"].notna()])
            axis.plot(x[part.index], part["value"], gid=gid, **marker(style) | line | label)
        bars: dict[str, Any] = {"color": style.colour, "linewidth": 0.9, "gid": marks_id(method)}
        low = points["low"]
        if panel.y_scale == "distance":  # near 0 an interval would fill a logarithmic axis
            low = low.clip(lower=panel.values["value"].min() / 2)
        axis.vlines(x, low, points["high"], **bars)
        outlines = points[points["hollow"].astype(bool) & points["value"].notna()]
        gid = marks_id(method, outlines["title"])
        axis.plot(x[outlines.index], outlines["value"], gid=gid, **marker(style, hollow=True))
    for name, low, high in panel.trained:
        if name in by_method:
            band: dict[str, Any] = {"color": styles[name].colour, "alpha": 0.13, "linewidth": 0}
            axis.axvspan(low, high, label=f"{shortened(name)} was trained here", **band)
            axis.patches[-1].set_gid(marks_id(axis.patches[-1].get_label()))


def _name_axes(axis: Any, panel: SweepPanel, fontsize: float) -> None:
    """Set the title, the labels, the scales and the ticks of a panel."""
    from matplotlib.ticker import LogLocator, NullLocator

    axis.set_title(fill(visible(panel.title), _TITLE_LETTERS), fontsize=fontsize + 1)
    axis.set_xlabel(panel.x_label, fontsize=fontsize)
    axis.set_ylabel(panel.y_label, fontsize=fontsize)
    axis.set_xscale(panel.x_scale)
    scale = panel.y_scale
    if scale == "distance":
        scale = "log" if (panel.values["value"] > 0).all() else "linear"
    axis.set_yscale(scale)
    if scale == "log":
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_minor_locator(NullLocator())
    if scale != "linear":  # a power would be written as a formula
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
    """Draw one line across the axis, or steps where the levels at the positions x differ."""
    look: dict[str, Any] = {"color": style.colour, "linestyle": style.dashes, "linewidth": 1}
    if np.ptp(levels) < 1e-6:
        axis.axhline(levels[0], label=name, **look)
    else:
        axis.plot(x, levels, drawstyle="steps-mid", label=name, **look)


def _white_is_best(panel: SweepPanel) -> bool:
    """Return whether a white image is as good as every method, or better, at each position."""
    is_blank = panel.values["method"] == FLOOR
    white = panel.values[is_blank].set_index("x")["value"]
    others = panel.values[~is_blank]
    lead = others["value"] - others["x"].map(white)
    known = lead.dropna()
    return not known.empty and not (known < 0 if panel.turned else known > 0).any()


def _shade_worse(axis: Any, x: Sequence[float], levels: Sequence[float]) -> None:
    """Shade the side of the axis on which values are worse than those of a white image.

    x, levels  the positions and values of the white image
    """
    if not np.isfinite(levels).any():
        return
    limits = {"xlim": axis.get_xlim(), "ylim": axis.get_ylim()}
    look: dict[str, Any] = {"color": SHADE, "linewidth": 0, "zorder": 0.4, "label": _WORSE}
    look["gid"] = marks_id(_WORSE)
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
    for rows in range(1, len(names) + 1):  # the fewest in which the names have room
        columns = [names[start : start + rows] for start in range(0, len(names), rows)]
        letters = sum(max(map(len, column)) + ENTRY_LETTERS for column in columns)
        if letters <= LETTERS_PER_INCH * width * TEXT / fontsize:
            break
    figure.set_size_inches(width, height + ENTRY_IN * (rows + 1) * fontsize / TEXT)
    legend = figure.legend(
        list(entries.values()),
        names,
        loc="outside upper center",
        ncols=math.ceil(len(names) / rows),
        fontsize=fontsize,
        frameon=False,
        handlelength=2.6,
    )
    for text in legend.get_texts():
        text.set_gid(LEGEND + shortened(text.get_text()))


def shortened(name: str) -> str:
    """Return the printable name in at most `LONGEST` letters."""
    # The end is kept, as it tells most: a name may be the path of a file of weights.
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

    points    a row for each method in each panel, with the columns metric, panel (its title),
              method, cost, cost_low, cost_high, value, low, high and verdict (as in
              `bench.analysis.frontier.frontier_verdicts`), and perhaps title (what the page says
              of a point). A floor has no cost and is a line. The panels of a metric have the same
              axes.
    styles    of every method
    x_label   what the costs are
    columns   panels beside each other
    named     methods of the legend; the points of others are small. Default: all methods but
              settings of a parameter.
    width_in  width of the figure, inches
    panel_in  height of a panel, inches
    fontsize  of all text, points
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    points = points.assign(title=points.get("title", ""))
    by_panel = grouped(points, ["metric", "panel"])
    columns = min(columns, len(by_panel))
    rows = math.ceil(len(by_panel) / columns)
    figure, axes = panels(rows, columns, (width_in, panel_in * rows), sharex=True)
    first: dict[str, Any] = {}  # axes of the first panel of a metric
    for axis, ((metric, title), of_panel) in zip(axes.flat, by_panel, strict=False):
        if first.setdefault(metric, axis) is not axis:
            axis.sharey(first[metric])
        _draw_costs(axis, of_panel, styles, named)
        axis.set_title(visible(title), fontsize=fontsize + 1)
        axis.set_xlabel(x_label, fontsize=fontsize)
        axis.set_ylabel(axis_title(metric) if axis in axes[:, 0] else "", fontsize=fontsize)
        axis.tick_params(labelbottom=True, which="both")
        _scale_costs(axis, metric)
        _tidy(axis, fontsize, "both")
    for axis in axes.flat[len(by_panel) :]:
        axis.remove()
    for axis, (_, of_panel) in zip(axes.flat, by_panel, strict=False):
        _draw_frontier(axis, of_panel[of_panel["verdict"] == "frontier"])
        blank = of_panel[of_panel["method"] == FLOOR]["value"].tolist()
        _shade_worse(axis, [1.0 for _ in blank], blank)
    _legend(figure, fontsize)
    figure.draw_without_rendering()  # gives everything its place on the figure
    # One renderer for all labels: without it matplotlib makes one for the size of each text.
    renderer = FigureCanvasAgg(figure).get_renderer()
    for axis, (_, of_panel) in zip(axes.flat, by_panel, strict=False):
        _label_where_free(axis, of_panel, named, fontsize, renderer)
    return figure


def _is_named(method: str, named: Container[str] | None) -> bool:
    """Return whether the legend has a method, as `frontier_figure` says of `named`."""
    return find_setting(method) is None if named is None else method in named


def _scale_costs(axis: Any, metric: str) -> None:
    """Set the scales of quality against cost, and how their numbers are written."""
    from matplotlib.ticker import LogFormatter

    axis.set_xscale("log")
    axis.set_yscale("linear" if metric in IMAGE_METRICS else "log")
    axis.yaxis.set_inverted(not higher_is_better(metric))
    logarithmic = [axis.xaxis]
    if metric not in IMAGE_METRICS:
        logarithmic.append(axis.yaxis)
    for scale in logarithmic:
        scale.set_major_formatter("{x:g}")
        # matplotlib's own labels within a decade are TeX, which these figures would show as text.
        scale.set_minor_formatter(LogFormatter())


def _draw_costs(
    axis: Any, points: pd.DataFrame, styles: Styles, named: Container[str] | None
) -> None:
    """Draw the points of all methods with their intervals, and join the settings of a method."""
    rivals = [point for point in points_of(points) if not role(point.method)]
    axis.margins(x=0.1, y=0.12)  # room for a name above the best point
    for family in ordered(family_of(point.method) for point in rivals):
        variants = [point for point in rivals if family_of(point.method) == family]
        if any(find_setting(point.method) for point in variants):
            swept = [p for p in variants if p.method == family or find_setting(p.method)]
            costs, values = [p.cost for p in swept], [p.value for p in swept]
            look = {"color": styles[family].colour, "linewidth": 0.9, "gid": marks_id(family)}
            axis.plot(costs, values, **look)
    for point in rivals:
        thin: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.6, "gid": marks_id(point.method)}
        thin["colors"] = styles[point.method].colour
        axis.vlines(point.cost, point.low, point.high, **thin)
        axis.hlines(point.value, point.cost_low, point.cost_high, **thin)
        in_legend = _is_named(point.method, named)
        look = marker(
            styles[point.method],
            size=6.5 if in_legend else 3.0,
            hollow=point.verdict == "below a white image",
        )
        if in_legend:
            look["label"] = shortened(point.method)
        axis.plot(point.cost, point.value, gid=marks_id(point.method, [point.title]), **look)
    for point in points_of(points):
        if role(point.method) == "floor":
            name = shortened(point.method)
            _draw_floor(axis, [1.0], [point.value], styles[point.method], name)
            axis.lines[-1].set_gid(marks_id(point.method, [point.title]))


def _draw_frontier(axis: Any, best: pd.DataFrame) -> None:
    """Draw the best quality that each cost buys, in steps up to the right end."""
    if best.empty:
        return
    best, limits = best.sort_values("cost"), axis.get_xlim()
    cost, value = [*best["cost"], limits[1]], [*best["value"], best["value"].iloc[-1]]
    steps: dict[str, Any] = {"color": INK, "linewidth": 1.3, "alpha": 0.75, "zorder": 1.5}
    axis.step(cost, value, where="post", label="frontier", gid=marks_id("frontier"), **steps)
    axis.set_xlim(limits)


def _label_where_free(
    axis: Any, points: pd.DataFrame, named: Container[str] | None, fontsize: float, renderer: Any
) -> None:
    """Write names beside points where they cover nothing; the legend has the others."""
    from matplotlib.transforms import Bbox

    competing = [point for point in points_of(points) if not role(point.method)]
    # In pixels; without a method that competes one box at the origin, which is in nobody's way.
    centres = axis.transData.transform([(p.cost, p.value) for p in competing] or [(0, 0)])
    taken = [Bbox.from_bounds(x - 4, y - 4, 8, 8) for x, y in centres]
    frontier = [line for line in axis.lines if line.get_drawstyle() == "steps-post"]
    for line in frontier:
        for (x, y), (x2, y2) in pairwise(axis.transData.transform(line.get_xydata())):
            low, high = sorted((y, y2))
            taken.append(Bbox([(x, y - 1), (x2, y + 1)]))  # the level part of a step
            taken.append(Bbox([(x2 - 1, low), (x2 + 1, high)]))  # its upright part
    for point in points_of(points):
        if role(point.method) == "floor":  # its line goes from side to side
            y = axis.transData.transform((point.cost, point.value))[1]
            taken.append(Bbox([(axis.bbox.x0, y - 1), (axis.bbox.x1, y + 1)]))
    # The best methods choose first: those of the frontier, from its dear end.
    for point in sorted(competing, key=lambda point: (point.verdict != "frontier", -point.cost)):
        if not _is_named(point.method, named):
            continue
        note = axis.annotate(
            shortened(point.method),
            xy=(point.cost, point.value),
            xytext=(0, 0),
            xycoords="data",
            textcoords="offset points",
            fontsize=fontsize,
        )
        note.set_in_layout(False)
        note.set_gid(marks_id(point.method))
        for *offset, ha, va in _BESIDE:
            note.set(position=offset, ha=ha, va=va)
            box = note.get_window_extent(renderer)
            if axis.bbox.count_contains(box.corners()) == 4 and not box.count_overlaps(taken):
                taken.append(box)
                break
        else:  # no place beside the point is free
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

    values    a row for each dot, with the columns panel (its title), turned (whether lower values
              are better), row (the name of its line), method and value; perhaps low, high and
              hollow. The line of all classes stands apart.
    styles    of every method
    zero      whether values are differences: then the side of 0 that is worse is shaded. Otherwise
              a line joins the dots of a row, and the axis begins at 0.
    width_in  width of the figure, inches
    fontsize  of all text, points
    """
    missing = {name: value for name, value in OPTIONAL.items() if name not in values}
    values = values.assign(**missing)
    height = {name: float(number) for number, name in enumerate(ordered(values["row"]))}
    apart = [name for name in height if name in (ALL, AVERAGE) and len(height) > 1]
    height |= {name: height[name] + 0.5 for name in apart}
    methods = ordered(values["method"])
    by_panel = grouped(values, "panel")
    size_in = (width_in, 0.7 + 0.28 * len(height))
    figure, (axes,) = panels(1, len(by_panel), size_in, sharey=True)
    for axis, (title, of_panel) in zip(axes, by_panel, strict=True):
        if not zero:
            for name, of_row in grouped(of_panel, "row"):
                y = [height[name] for _ in range(len(of_row))]
                axis.plot(of_row["value"], y, color=RULE, linewidth=3, zorder=1)
        for number, method in enumerate(methods):
            dots, style = of_panel[of_panel["method"] == method], styles[method]
            y = dots["row"].map(height).astype(float)
            if zero:  # side by side: without joining lines equal dots would cover each other
                y += (number - (len(methods) - 1) / 2) * min(0.3, 0.6 / len(methods))
            axis.hlines(y, dots["low"], dots["high"], color=style.colour, linewidth=0.9)
            axis.plot(dots["value"], y, **marker(style) | {"label": shortened(method)})
            hollow = dots["hollow"].astype(bool)
            axis.plot(dots["value"][hollow], y[hollow], **marker(style, hollow=True))
        for name in apart:
            axis.axhline(height[name] - 0.75, color=RULE, linewidth=0.8)
        axis.set_title(visible(title), fontsize=fontsize + 1)
        if not zero:
            axis.set_xlim(left=0)
        axis.xaxis.set_inverted(bool(of_panel["turned"].iloc[0]))
        if zero:
            axis.axvline(0, color=SOFT, linewidth=1)
            worst, best = axis.get_xlim()
            axis.axvspan(worst, 0, color=SHADE, linewidth=0, zorder=0)
            axis.set_xlim(worst, best)
            axis.set_xlabel(DIRECTIONS, fontsize=fontsize)
        _tidy(axis, fontsize, "x")
    axes[0].set_yticks(list(height.values()), list(map(visible, height)))
    axes[0].set_ylim(max(height.values()) + 0.6, -0.6)
    _legend(figure, fontsize)
    return figure
