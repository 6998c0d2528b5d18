"""Quality against cost: a plot for each condition."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.comparison import Comparison, decimals, milliseconds
from bench.analysis.frontier import FrontierPoint, places
from bench.catalogue.lookup import family_of, variant_of
from bench.catalogue.methods import role
from bench.catalogue.metrics import IMAGE_METRICS
from bench.catalogue.parameters import find_setting
from bench.report.inline import Drawing, inline
from bench.report.page import Plot
from bench.report.robustness import axis_title, point_style, shortened
from bench.report.styles import INK, PAPER, RULE, SOFT, Look, looks
from bench.tables.figure import drawing, panels, save
from bench.tables.markdown import visible
from bench.tables.table import Tags, scored_as_blank
from data_prep.arrays import Floats

RINGS = (9, 14, 20, 28, 38, 50, 64)  # distances tried around a point, in points of 1/72 inch
DIRECTIONS_DEG = (90, 270, 45, 135, 315, 225, 0, 180, 67, 113, 247, 293)  # above, below, ...


def place_labels(anchors: Floats, sizes: Floats, obstacles: Floats, area: Floats) -> Floats:
    """Centres [n, 2] of labels of these sizes [n, 2], each near its anchor [n, 2].

    obstacles [m, 4] and area [4] are boxes (left, bottom, right, top). One label after the other
    takes the nearest of the places around its anchor where it covers neither an obstacle nor a
    label before it and stays inside the area; where there is none, the one that covers least.
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
    """Area of each box [n, 4] that the others [m, 4] cover, [n]; twice what is covered twice."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    return np.clip(high - low, 0, None).prod(axis=2).sum(axis=1)


def _outside(boxes: Floats, area: Floats) -> Floats:
    whole = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return whole - covered(boxes, area[None])


PANEL_IN = (4.9, 4.7)
CELL_IN, WIDE_IN = (5.0, 4.4), (10.5, 5.6)  # of a plot of the page
FEW = 12  # points that labels have room for in the smaller one
LABEL_SIZE = 7.5
FAR_OFF = 8.0  # points of 1/72 inch between a point and its label
POINTS_PER_INCH = 72
LONGEST = 24  # letters of a label

Limits = tuple[tuple[float, float], tuple[float, float]]


def write_frontier(folder: Path, places: Sequence[FrontierPoint]) -> None:
    """A figure for each metric, as PNG and SVG, of the largest number of views.

    The first metric's is `frontier`, the others' are `frontier-METRIC`. A metric that no candidate
    has a value of gets none.
    """
    views = max(place.views for place in places)
    styles = looks(dict.fromkeys(place.method for place in places))
    for number, metric in enumerate(dict.fromkeys(place.metric for place in places)):
        shown = [p for p in places if (p.metric, p.views) == (metric, views) and _drawn(p)]
        if not any(_competes(place) for place in shown):
            continue
        figure = frontier_figure(shown, metric, views, styles).figure
        name = "frontier" if number == 0 else f"frontier-{metric}"
        for kind in ("png", "svg"):
            save(figure, folder / f"{name}.{kind}", dpi=130)


@drawing()
def frontier_figure(
    places: Sequence[FrontierPoint],
    metric: str,
    views: int,
    styles: Mapping[str, Look],
    *,
    panel_in: tuple[float, float] = PANEL_IN,
    limits: Limits | None = None,
    legend_columns: int = 6,
) -> Drawing:
    """Panels side by side with the same axes; places of one metric and one number of views.

    limits  of the axes, x and y; None: what is drawn has room
    """
    cells = list(dict.fromkeys((p.condition, p.class_name) for p in places))
    size_in = (panel_in[0] * len(cells), panel_in[1])
    figure, axes = panels(1, len(cells), size_in, sharex=True, sharey=True)
    drawn = Drawing(figure)
    styles = _of_families(places, styles)
    several = len({class_name for _, class_name in cells}) > 1
    labels = []
    for axis, cell in zip(axes[0], cells, strict=True):
        of_cell = [p for p in places if (p.condition, p.class_name) == cell]
        _scale(axis, metric)
        labels.append(_draw_panel(drawn, axis, of_cell, styles))
        axis.set_title(visible(", ".join(cell) if several else cell[0]), fontsize=10)
        axis.set_xlabel(f"ms for a cloud with {views} view{'s' * (views > 1)}", fontsize=9)
        axis.grid(color=RULE, linewidth=0.6, which="major")
        axis.set_axisbelow(True)
        axis.tick_params(labelsize=9, which="both")
    if limits is not None:
        axes[0][0].set(xlim=limits[0], ylim=limits[1])
    left, right = axes[0][0].get_xlim()
    for axis, cell in zip(axes[0], cells, strict=True):
        _draw_frontier(axis, [p for p in places if (p.condition, p.class_name) == cell], right)
        axis.set_xlim(left, right)
    axes[0][0].set_ylabel(axis_title(metric), fontsize=9)
    drawn.legend(legend_columns, fontsize=8)
    _write_labels(drawn, axes[0], labels, styles)
    return drawn


def _scale(axis: Any, metric: str) -> None:
    from matplotlib.ticker import LogFormatter

    axis.set_xscale("log")
    scales = [axis.xaxis]
    if metric not in IMAGE_METRICS:
        axis.set_yscale("log")
        scales.append(axis.yaxis)
    for scale in scales:
        scale.set_major_formatter(_plain)
        # Of a decade or less; matplotlib's own is TeX, which figures show as it is.
        scale.set_minor_formatter(LogFormatter())


def _draw_panel(
    drawn: Drawing, axis: Any, places: Sequence[FrontierPoint], styles: Mapping[str, Look]
) -> list[tuple[FrontierPoint, str]]:
    """Draw one condition; the points that get a label, with it."""
    rivals = [p for p in places if _competes(p)]
    labels = []
    for name in dict.fromkeys(map(_family, rivals)):
        members = [p for p in rivals if _family(p) == name]
        settings = [find_setting(p.method) for p in members]
        parameter = next((setting.parameter.name for setting in settings if setting), None)
        look = styles[members[0].method]
        (line,) = axis.plot(
            [p.cost_ms.value for p in members],
            [p.quality.value for p in members],
            **point_style(look, 5.5)
            | {"linestyle": "-" if parameter else "none", "linewidth": 0.9, "markevery": []},
            label=visible(name) + (f" ({parameter})" if parameter else ""),
        )
        drawn.mark(line, Tags(method=members[0].method) if len(members) == 1 else Tags())
        for p in members:
            _draw_point(drawn, axis, p, look, 7 if p.method == name else 4)
        turned = [(p, _short(p)) for p in members if p.method != name]
        labels += [(p, visible(name)) for p in members if p.method == name]
        labels += turned if parameter is None else turned[:: max(len(turned) - 1, 1)]
    for p in (p for p in places if role(p.method) == "floor"):
        look = styles[p.method]
        line = axis.axhline(
            p.quality.value, color=look.colour, linewidth=0.9, linestyle=look.dashes, label=p.method
        )
        drawn.mark(line, Tags(method=p.method), _text(p), series=True)
    return labels


def _draw_point(drawn: Drawing, axis: Any, place: FrontierPoint, look: Look, size: float) -> None:
    cost, quality, tags = place.cost_ms, place.quality, Tags(method=place.method)
    thin: dict[str, Any] = {"color": look.colour, "linewidth": 0.6, "alpha": 0.6}
    if math.isfinite(quality.low):
        (line,) = axis.plot([cost.value] * 2, [quality.low, quality.high], **thin)
        drawn.mark(line, tags)
    if math.isfinite(cost.low):
        (line,) = axis.plot([cost.low, cost.high], [quality.value] * 2, **thin)
        drawn.mark(line, tags)
    style = point_style(look, size)
    if place.verdict == "below a white image":
        style |= {"markerfacecolor": PAPER, "markeredgecolor": look.colour, "markeredgewidth": 1.0}
    (point,) = axis.plot(cost.value, quality.value, **style)
    drawn.mark(point, tags, _text(place), series=True)


def _draw_frontier(axis: Any, places: Sequence[FrontierPoint], right: float) -> None:
    """What the best costs, in steps up to `right`: at each cost the best quality that it buys."""
    steps = sorted((p.cost_ms.value, p.quality.value) for p in places if p.verdict == "frontier")
    if not steps:
        return
    cost, quality = zip(*steps, strict=True)
    axis.step(
        (*cost, right), (*quality, quality[-1]), where="post", color=INK, linewidth=1.3,
        alpha=0.75, zorder=1.5, label="frontier",
    )  # fmt: skip


def _plain(value: float, _: int) -> str:
    return f"{value:g}"


def _short(place: FrontierPoint) -> str:
    """What tells a method from others of its family: a parameter's value, a variant's name."""
    setting = find_setting(place.method)
    if setting is not None:
        return f"{setting.value:g}"
    return shortened(visible(variant_of(place.method)), LONGEST)


def _family(place: FrontierPoint) -> str:
    return family_of(place.method)


def _of_families(places: Sequence[FrontierPoint], styles: Mapping[str, Look]) -> dict[str, Look]:
    """Variants look like their method, or where it is not there like the first of them."""
    first: dict[str, Look] = {}
    return {
        p.method: styles.get(_family(p), first.setdefault(_family(p), styles[p.method]))
        for p in places
    }


def _competes(place: FrontierPoint) -> bool:
    return not role(place.method)


def _drawn(place: FrontierPoint) -> bool:
    """Whether it has a place on the axes, which may be logarithmic; of the ceiling there is none,
    and a floor has no cost."""
    positive = place.metric in IMAGE_METRICS or place.quality.value > 0
    if not math.isfinite(place.quality.value) or not positive or role(place.method) == "ceiling":
        return False
    return role(place.method) == "floor" or (
        math.isfinite(place.cost_ms.value) and place.cost_ms.value > 0
    )


def _write_labels(
    drawn: Drawing,
    axes: Sequence[Any],
    labels: Sequence[Sequence[tuple[FrontierPoint, str]]],
    styles: Mapping[str, Look],
) -> None:
    """Labels where they cover nothing, each with a hair line to its point where it is far off."""
    figure = drawn.figure
    figure.draw_without_rendering()  # only now is it known where everything lies
    scale = POINTS_PER_INCH / figure.dpi
    for axis, of_axis in zip(axes, labels, strict=True):
        if not of_axis:
            continue
        xy = np.array([(p.cost_ms.value, p.quality.value) for p, _ in of_axis])
        anchors = axis.transData.transform(xy) * scale
        notes = [
            axis.annotate(text, point, xytext=(0, 0), textcoords="offset points", ha="center",
                          va="center", fontsize=LABEL_SIZE, color=styles[p.method].colour)
            for point, (p, text) in zip(xy, of_axis, strict=True)
        ]  # fmt: skip
        extents = [note.get_window_extent() for note in notes]
        sizes = np.array([(e.width, e.height) for e in extents]) * scale
        area = np.array(axis.bbox.extents) * scale
        centres = place_labels(anchors, sizes, _obstacles(axis) * scale, area)
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
    """Small boxes along all lines of an axis, as far as they are in sight, [m, 4] in pixels."""
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
    styles: Mapping[str, Look],
) -> tuple[Plot, ...]:
    """A plot for each metric, condition and class; the ceiling is left out, floors are lines.

    All plots of a metric have the same axes, so that they can be compared. Methods without a time
    or a value have no point.
    """
    plots = []
    for metric in metrics:
        cells = {
            (c.condition, c.class_name): [p for p in places(c, (metric,), views) if _drawn(p)]
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
                panel_in=WIDE_IN if wide else CELL_IN,
                limits=limits,
                legend_columns=6 if wide else 3,
            )
            points = sorted(filter(_competes, of_cell), key=lambda p: p.cost_ms.value)
            description = "; ".join(map(_text, points))
            plot = Plot(
                title=f"{condition}, {class_name}",
                axis=axis_title(metric),
                description=f"{axis_title(metric)}, by rising cost: {description}.",
                svg=inline(figure, f"cost-{len(plots)}"),
                wide=wide,
                tags=Tags(condition=condition, class_name=class_name),
            )
            plots.append(plot)
    return tuple(plots)


def _limits(places: Sequence[FrontierPoint], metric: str, styles: Mapping[str, Look]) -> Limits:
    """Of axes on which all of these have room."""
    figure, ((axis,),) = panels(1, 1, PANEL_IN)
    _scale(axis, metric)
    _draw_panel(Drawing(figure), axis, places, styles)
    return axis.get_xlim(), axis.get_ylim()


def _text(place: FrontierPoint) -> str:
    value = f"{place.quality.value:.{decimals(place.metric)}f}"
    if role(place.method) == "floor":
        return f"{place.method}: {value}, looks at no cloud"
    verdicts = {"frontier": ", on the frontier", "below a white image": ", below a white image"}
    verdict = verdicts.get(place.verdict, "")
    failures = scored_as_blank(place.n_ok, place.n)
    cost = f"{milliseconds(place.cost_ms.value)} ms"
    return f"{place.method}: {cost}, {value}{verdict}{f' ({failures})' if failures else ''}"
