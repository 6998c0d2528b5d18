"""Quality against cost: a plot for each condition."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.comparison import Comparison, milliseconds
from bench.analysis.frontier import FrontierPoint, places
from bench.analysis.paired import Verdicts
from bench.catalogue.conditions import condition_words
from bench.catalogue.lookup import family_of, variant_of
from bench.catalogue.methods import FLOOR, find_setting, role
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better
from bench.report.blank_region import shade_worse
from bench.report.figure import TEXT, WIDTH_IN, drawing, panels, save
from bench.report.inline import MarkedFigure, inline
from bench.report.page import Plot
from bench.report.robustness import (
    PLOT_TEXT,
    axis_title,
    make_hollow,
    point_style,
    shortened,
)
from bench.report.styles import INK, RULE, SOFT, MethodStyle, method_styles
from bench.tables.grid import Tags, measured, scored_as_blank
from bench.tables.markdown import visible
from data_prep.arrays import Floats

RINGS = (9, 14, 20, 28, 38, 50, 64)  # distances tried around a point, in points of 1/72 inch
DIRECTIONS_DEG = (90, 270, 45, 135, 315, 225, 0, 180, 67, 113, 247, 293)  # above, below, ...


def place_labels(anchors: Floats, sizes: Floats, obstacles: Floats, area: Floats) -> Floats:
    """Return centres [n, 2] of labels of these sizes [n, 2], each near its anchor [n, 2].

    `obstacles` [m, 4] and `area` [4] are boxes (left, bottom, right, top). One label after the
    other takes the nearest place around its anchor where it covers neither an obstacle nor an
    earlier label and stays inside the area; where there is none, the place that covers least.
    """
    angles = np.radians(DIRECTIONS_DEG)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    taken = obstacles.reshape(-1, 4)
    centres = np.empty_like(anchors)
    for i, (anchor, size) in enumerate(zip(anchors, sizes, strict=True)):
        # A wide label is moved further aside than up, so that its edge keeps the distance.
        steps = [around * (ring + (size - size.min()) / 2 * np.abs(around)) for ring in RINGS]
        tried = anchor + np.concatenate(steps)
        boxes = np.concatenate([tried - size / 2, tried + size / 2], axis=1)
        cost = covered(boxes, taken) + _outside(boxes, area)
        best = int(cost.argmin())  # of equals the first, which is the nearest
        centres[i] = tried[best]
        taken = np.concatenate([taken, boxes[best : best + 1]])
    return centres


def covered(boxes: Floats, others: Floats) -> Floats:
    """Return the area of each box [n, 4] that the others [m, 4] cover, [n].

    An area that two of them cover counts twice.
    """
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    return np.clip(high - low, 0, None).prod(axis=2).sum(axis=1)


def _outside(boxes: Floats, area: Floats) -> Floats:
    whole = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return whole - covered(boxes, area[None])


HEIGHT_IN, LEGEND_IN = 4.2, 0.5  # of a panel of a file
CELL_IN, WIDE_IN = (5.4, 3.9), (10.8, 5.6)  # of a plot of the page
FEW = 12  # points that labels have room for in the smaller one
LEGEND_COLUMNS = 5
FAR_OFF = 8.0  # points of 1/72 inch between a point and its label
POINTS_PER_INCH = 72
LONGEST = 24  # letters of a label

Limits = tuple[tuple[float, float], tuple[float, float]]


def write_frontier(folder: Path, places: Sequence[FrontierPoint]) -> None:
    """Write a figure for each metric, as PNG and SVG.

    The files of the first metric are named `frontier`, others `frontier-METRIC`. A metric without
    a value of any candidate gets no figure.
    """
    styles = method_styles(dict.fromkeys(place.method for place in places))
    for number, metric in enumerate(dict.fromkeys(place.metric for place in places)):
        shown = [p for p in places if p.metric == metric and _drawn(p)]
        if not any(_competes(place) for place in shown):
            continue
        figure = frontier_figure(shown, metric, shown[0].views, styles).figure
        name = "frontier" if number == 0 else f"frontier-{metric}"
        for kind in ("png", "svg"):
            save(figure, folder / f"{name}.{kind}")


@drawing()
def frontier_figure(
    places: Sequence[FrontierPoint],
    metric: str,
    views: int,
    styles: Mapping[str, MethodStyle],
    *,
    plot_in: tuple[float, float] | None = None,
    fontsize: float = TEXT,
    limits: Limits | None = None,
) -> MarkedFigure:
    """Draw panels below each other with the same axes, of one metric and one number of views.

    Without `plot_in` the figure is that of a file, with a legend; else a plot of the page, whose
    legend stands beside it. `limits` are those of the axes, x and y; without them the axes hold
    all that is drawn.
    """
    cells = list(dict.fromkeys((p.condition, p.class_name) for p in places))
    size_in = plot_in or (WIDTH_IN, HEIGHT_IN * len(cells) + LEGEND_IN)
    figure, column = panels(len(cells), 1, size_in, sharex=True, sharey=True)
    axes = list(column[:, 0])
    drawn = MarkedFigure(figure)
    several = len({class_name for _, class_name in cells}) > 1
    labels = []
    for axis, cell in zip(axes, cells, strict=True):
        of_cell = [p for p in places if (p.condition, p.class_name) == cell]
        _scale(axis, metric)
        labels.append(_draw_panel(drawn, axis, of_cell, styles))
        words = condition_words(cell[0])
        axis.set_title(visible(f"{words}, {cell[1]}" if several else words), fontsize=fontsize + 1)
        axis.set_ylabel(axis_title(metric), fontsize=fontsize)
        axis.grid(color=RULE, linewidth=0.6, which="major")
        axis.set_axisbelow(True)
        axis.tick_params(labelsize=fontsize, which="both")
    axes[-1].set_xlabel(f"ms for a cloud with {views} view{'s' * (views > 1)}", fontsize=fontsize)
    if limits is not None:
        axes[0].set(xlim=limits[0], ylim=limits[1])
    left, right = axes[0].get_xlim()
    for axis, cell in zip(axes, cells, strict=True):
        of_cell = [p for p in places if (p.condition, p.class_name) == cell]
        _draw_frontier(axis, of_cell, right)
        axis.set_xlim(left, right)
        blank = next((p.quality.value for p in of_cell if p.method == FLOOR), math.nan)
        shade_worse(axis, metric, [(left, right, blank)], fontsize)
    if plot_in is None:
        drawn.legend(LEGEND_COLUMNS, fontsize=fontsize)
    _write_labels(drawn, axes, labels, fontsize)
    return drawn


def _scale(axis: Any, metric: str) -> None:
    from matplotlib.ticker import LogFormatter

    axis.set_xscale("log")
    scales = [axis.xaxis]
    if metric not in IMAGE_METRICS:
        axis.set_yscale("log")
        scales.append(axis.yaxis)
    for scale in scales:
        scale.set_major_formatter("{x:g}")
        # matplotlib's own labels within a decade are TeX, which figures show as it is.
        scale.set_minor_formatter(LogFormatter())


def _draw_panel(
    drawn: MarkedFigure,
    axis: Any,
    places: Sequence[FrontierPoint],
    styles: Mapping[str, MethodStyle],
) -> list[tuple[FrontierPoint, str]]:
    """Draw one condition, and return the points that get a label, with their labels."""
    rivals = [p for p in places if _competes(p)]
    labels = []
    for name in dict.fromkeys(family_of(p.method) for p in rivals):
        members = [p for p in rivals if family_of(p.method) == name]
        settings = [find_setting(p.method) for p in members]
        parameter = next((setting.parameter.name for setting in settings if setting), None)
        (line,) = axis.plot(
            [p.cost_ms.value for p in members],
            [p.quality.value for p in members],
            **point_style(replace(styles[members[0].method], fill="full"), 5.5)
            | {"linestyle": "-" if parameter else "none", "linewidth": 0.9, "markevery": []},
            label=visible(name) + (f" ({parameter})" if parameter else ""),
        )
        drawn.mark(line, Tags(method=members[0].method) if len(members) == 1 else Tags())
        for p in members:
            _draw_point(drawn, axis, p, styles[p.method], 7 if p.method == name else 4)
        variants = [(p, _variant_label(p.method)) for p in members if p.method != name]
        labels += [(p, visible(name)) for p in members if p.method == name]
        # Of the values of a parameter, which a line joins, only the ends are labelled.
        labels += variants if parameter is None else variants[:: max(len(variants) - 1, 1)]
    for p in (p for p in places if role(p.method) == "floor"):
        floor = styles[p.method]
        line = axis.axhline(
            p.quality.value,
            color=floor.colour,
            linewidth=0.9,
            linestyle=floor.dashes,
            label=p.method,
        )
        drawn.mark(line, Tags(method=p.method), _text(p), series=True)
    return labels


def _draw_point(
    drawn: MarkedFigure, axis: Any, place: FrontierPoint, style: MethodStyle, size: float
) -> None:
    cost, quality, tags = place.cost_ms, place.quality, Tags(method=place.method)
    thin: dict[str, Any] = {"color": style.colour, "linewidth": 0.6, "alpha": 0.6}
    if math.isfinite(quality.low):
        (line,) = axis.plot([cost.value] * 2, [quality.low, quality.high], **thin)
        drawn.mark(line, tags)
    if math.isfinite(cost.low):
        (line,) = axis.plot([cost.low, cost.high], [quality.value] * 2, **thin)
        drawn.mark(line, tags)
    (point,) = axis.plot(cost.value, quality.value, **point_style(style, size))
    if place.verdict == "below a white image":
        make_hollow(point, style, 1.0)
    drawn.mark(point, tags, _text(place), series=True)


def _draw_frontier(axis: Any, places: Sequence[FrontierPoint], right: float) -> None:
    """Draw the best quality that each cost buys, in steps up to `right`."""
    steps = sorted((p.cost_ms.value, p.quality.value) for p in places if p.verdict == "frontier")
    if not steps:
        return
    cost, quality = zip(*steps, strict=True)
    axis.step(
        (*cost, right), (*quality, quality[-1]), where="post", color=INK, linewidth=1.3,
        alpha=0.75, zorder=1.5, label="frontier",
    )  # fmt: skip


def _variant_label(method: str) -> str:
    """Return the part of an id that tells it from its family: the value of a parameter, a name."""
    setting = find_setting(method)
    if setting is not None:
        return f"{setting.value:g}"
    return shortened(visible(variant_of(method)), LONGEST)


def _competes(place: FrontierPoint) -> bool:
    return not role(place.method)


def _drawn(place: FrontierPoint) -> bool:
    """Return whether a point has a place on the axes, which may be logarithmic.

    The ceiling has none; a floor has no cost and needs none.
    """
    positive = place.metric in IMAGE_METRICS or place.quality.value > 0
    if not math.isfinite(place.quality.value) or not positive or role(place.method) == "ceiling":
        return False
    return role(place.method) == "floor" or (
        math.isfinite(place.cost_ms.value) and place.cost_ms.value > 0
    )


def _write_labels(
    drawn: MarkedFigure,
    axes: Sequence[Any],
    labels: Sequence[Sequence[tuple[FrontierPoint, str]]],
    fontsize: float,
) -> None:
    """Write labels where they cover nothing, with a hair line to points that are far off."""
    figure = drawn.figure
    figure.draw_without_rendering()  # before it nothing has a place
    scale = POINTS_PER_INCH / figure.dpi
    for axis, of_axis in zip(axes, labels, strict=True):
        if not of_axis:
            continue
        taken = [_obstacles(axis)]
        taken += [np.array([text.get_window_extent().extents]) for text in axis.texts]
        xy = np.array([(p.cost_ms.value, p.quality.value) for p, _ in of_axis])
        anchors = axis.transData.transform(xy) * scale
        notes = [
            axis.annotate(text, point, xytext=(0, 0), textcoords="offset points", ha="center",
                          va="center", fontsize=fontsize)
            for point, (_, text) in zip(xy, of_axis, strict=True)
        ]  # fmt: skip
        extents = [note.get_window_extent() for note in notes]
        sizes = np.array([(e.width, e.height) for e in extents]) * scale
        area = np.array(axis.bbox.extents) * scale
        centres = place_labels(anchors, sizes, np.concatenate(taken) * scale, area)
        placed = zip(notes, of_axis, centres - anchors, sizes, strict=True)
        for note, (place, _), offset, size in placed:
            tags = Tags(method=place.method)
            note.set_position(offset)
            note.set_in_layout(False)
            drawn.mark(note, tags)
            nearest = np.clip(0, offset - size / 2, offset + size / 2)  # to the point
            if np.linalg.norm(nearest) > FAR_OFF:
                leader = axis.annotate(
                    "", note.xy, xytext=nearest, textcoords="offset points", zorder=1,
                    arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": SOFT,
                                "shrinkA": 0, "shrinkB": 2},
                )  # fmt: skip
                leader.set_in_layout(False)
                drawn.mark(leader.arrow_patch, tags)


def _obstacles(axis: Any) -> Floats:
    """Return small boxes along the visible part of all lines of an axis, [m, 4] in pixels."""
    from matplotlib.cbook import pts_to_poststep

    boxes = []
    corners = axis.bbox.get_points()
    for line in axis.lines:
        # An interval down to 0 has no end on a logarithmic axis.
        xy = line.get_xydata()
        if line.get_drawstyle() == "steps-post":
            xy = np.transpose(pts_to_poststep(*xy.T))
        path = np.clip(line.get_transform().transform(xy), *corners)
        reach = 2.0 + line.get_markersize() * (line.get_marker() not in ("None", None, "", " "))
        for start, end in pairwise(path):
            count = max(int(np.linalg.norm(end - start) // 4), 1)
            along = start + (end - start) * np.linspace(0, 1, count + 1)[:, None]
            boxes.append(np.concatenate([along - reach / 2, along + reach / 2], axis=1))
        boxes.append(np.concatenate([path - reach, path + reach], axis=1))
    return np.concatenate([box for box in boxes if np.isfinite(box).all()])


def cost_plots(
    comparisons: Sequence[Comparison],
    metrics: Sequence[str],
    views: int,
    styles: Mapping[str, MethodStyle],
    verdicts: Verdicts,
) -> tuple[Plot, ...]:
    """Return a plot for each metric, condition and class, without ceiling, with floors as lines.

    Their legend stands beside them.
    All plots of a metric have the same axes, so that they can be compared. Methods without a time
    or a value have no point.
    """
    plots = []
    for metric in metrics:
        cells = {
            (c.condition, c.class_name): list(filter(_drawn, places(c, (metric,), views, verdicts)))
            for c in comparisons
        }
        counts = [sum(map(_competes, of_cell)) for of_cell in cells.values()]
        if not any(counts):
            continue
        wide = max(counts) > FEW
        every = [p for of_cell in cells.values() for p in of_cell]
        limits = _limits(every, metric, styles)
        for (condition, class_name), of_cell in cells.items():
            if not of_cell:
                continue
            figure = frontier_figure(
                *(of_cell, metric, views, styles),
                plot_in=WIDE_IN if wide else CELL_IN,
                fontsize=PLOT_TEXT,
                limits=limits,
            )
            points = sorted(filter(_competes, of_cell), key=lambda p: p.cost_ms.value)
            description = "; ".join(map(_text, points))
            plot = Plot(
                title=f"{metric}: {condition_words(condition)}, {class_name}",
                axis=f"{'higher' if higher_is_better(metric) else 'lower'} is better",
                description=f"{axis_title(metric)}, by rising cost: {description}.",
                svg=inline(figure, f"cost-{len(plots)}"),
                wide=wide,
                tags=Tags(condition=condition, class_name=class_name),
            )
            plots.append(plot)
    return tuple(plots)


def _limits(
    places: Sequence[FrontierPoint], metric: str, styles: Mapping[str, MethodStyle]
) -> Limits:
    """Return the limits of axes on which all of these points have room."""
    figure, ((axis,),) = panels(1, 1, CELL_IN)
    _scale(axis, metric)
    _draw_panel(MarkedFigure(figure), axis, places, styles)
    return axis.get_xlim(), axis.get_ylim()


def _text(place: FrontierPoint) -> str:
    value = measured(place.quality, place.metric, place.method).text
    if role(place.method) == "floor":
        return f"{place.method}: {value}, looks at no cloud"
    verdicts = {
        "frontier": ", on the frontier",
        "below a white image": ", below a white image",
        "claimed": ", cost as claimed",
    }
    verdict = verdicts.get(place.verdict, "")
    failures = scored_as_blank(place.n_ok, place.n)
    cost = f"{milliseconds(place.cost_ms.value)} ms"
    return f"{place.method}: {cost}, {value}{verdict}{f' ({failures})' if failures else ''}"
