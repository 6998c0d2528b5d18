"""Quality against cost: a plot for each condition."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.comparison import Comparison, Estimate, decimals, milliseconds
from bench.analysis.frontier import Place, places
from bench.catalogue.methods import FLOORS, role
from bench.catalogue.metrics import IMAGE_METRICS, higher_is_better
from bench.catalogue.parameters import find_setting
from bench.report.page import Mark, Plot, Series, Style, Word
from bench.report.robustness import Axis, axis_of, axis_with_room, spread
from bench.report.styles import family
from bench.tables.table import Tags

Floats = NDArray[np.float64]
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


# Hues that stay apart for colour-blind eyes too (Okabe and Ito 2008).
HUES = ("#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#E69F00", "#D55E00", "#7A5C3E", "#666666")
FLOOR_STYLES = ((0, (6, 3)), (0, (2, 2)))
PANEL_IN = (4.9, 4.7)
LABEL_SIZE = 6.5
FAR_OFF = 8.0  # points of 1/72 inch between a point and its label
POINTS_PER_INCH = 72


def write_frontier(folder: Path, places: Sequence[Place]) -> None:
    """A figure for each metric, as PNG and SVG, of the largest number of views.

    The first metric's is `frontier`, the others' are `frontier-METRIC`. A metric that no candidate
    has a value of gets none.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    folder.mkdir(exist_ok=True)
    views = max(place.views for place in places)
    for number, metric in enumerate(dict.fromkeys(place.metric for place in places)):
        shown = [p for p in places if (p.metric, p.views) == (metric, views) and _drawn(p)]
        if all(place.verdict == "reference" for place in shown):
            continue
        figure = frontier_figure(shown, metric, views)
        name = "frontier" if number == 0 else f"frontier-{metric}"
        for kind in ("png", "svg"):
            figure.savefig(folder / f"{name}.{kind}", dpi=130)
        plt.close(figure)


def frontier_figure(places: Sequence[Place], metric: str, views: int) -> Any:
    """Panels side by side with the same axes; places of one metric and one number of views."""
    from matplotlib import pyplot as plt

    cells = list(dict.fromkeys((p.condition, p.class_name) for p in places))
    families = list(dict.fromkeys(_family(p) for p in places if p.verdict != "reference"))
    hues = {family: HUES[i % len(HUES)] for i, family in enumerate(families)}
    figure, axes = plt.subplots(
        1,
        len(cells),
        figsize=(PANEL_IN[0] * len(cells), PANEL_IN[1]),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    higher = metric in IMAGE_METRICS
    several = len({class_name for _, class_name in cells}) > 1
    labels = []
    for axis, cell in zip(axes[0], cells, strict=True):
        of_cell = [p for p in places if (p.condition, p.class_name) == cell]
        axis.set_xscale("log")
        if not higher:
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter(_plain)
        labels.append(_panel(axis, of_cell, hues))
        axis.xaxis.set_major_formatter(_plain)
        axis.set_title(", ".join(cell) if several else cell[0], fontsize=10)
        axis.set_xlabel(f"ms for a cloud with {views} view{'s' * (views > 1)}")
        axis.grid(alpha=0.25, which="major")
    left, right = axes[0][0].get_xlim()
    for axis, cell in zip(axes[0], cells, strict=True):
        _draw_frontier(axis, [p for p in places if (p.condition, p.class_name) == cell], right)
        axis.set_xlim(left, right)
    axes[0][0].set_ylabel(f"{metric} ({'higher' if higher else 'lower'} is better)")
    handles = {h.get_label(): h for axis in axes[0] for h in axis.get_legend_handles_labels()[0]}
    figure.legend(
        handles=list(handles.values()), loc="outside lower center", ncols=6, fontsize=8,
        frameon=False,
    )  # fmt: skip
    _write_labels(figure, axes[0], labels, hues)
    return figure


def _panel(axis: Any, places: Sequence[Place], hues: dict[str, str]) -> list[tuple[Place, str]]:
    """Draw one condition; the points that get a label, with it."""
    rivals = [p for p in places if p.verdict != "reference"]
    labels = []
    for name, hue in hues.items():
        members = [p for p in rivals if _family(p) == name]
        if not members:
            continue
        settings = [find_setting(p.method) for p in members]
        knob = next((setting.knob.name for setting in settings if setting), None)
        axis.plot(
            [p.cost_ms.value for p in members],
            [p.quality.value for p in members],
            color=hue,
            linewidth=0.9 if knob else 0,
            marker="o",
            markersize=3.5,
            label=name + (f" ({knob})" if knob else ""),
        )
        for p in members:
            _draw_intervals(axis, p, hue)
            if p.method == name:
                axis.plot(p.cost_ms.value, p.quality.value, "o", color=hue, markersize=7)
        turned = [(p, _short(p)) for p in members if _short(p)]
        labels += turned if knob is None else turned[:: max(len(turned) - 1, 1)]
    floors = [p for p in places if p.method in FLOORS]
    for p, style in zip(floors, FLOOR_STYLES, strict=False):
        axis.axhline(p.quality.value, color="0.45", linewidth=0.9, linestyle=style, label=p.method)
    return labels


def _draw_intervals(axis: Any, place: Place, hue: str) -> None:
    cost, quality = place.cost_ms, place.quality
    thin: dict[str, Any] = {"color": hue, "linewidth": 0.6, "alpha": 0.6}
    if math.isfinite(quality.low):
        axis.plot([cost.value] * 2, [quality.low, quality.high], **thin)
    if math.isfinite(cost.low):
        axis.plot([cost.low, cost.high], [quality.value] * 2, **thin)


def _draw_frontier(axis: Any, places: Sequence[Place], right: float) -> None:
    """What the best costs, in steps up to `right`: at each cost the best quality that it buys."""
    steps = sorted((p.cost_ms.value, p.quality.value) for p in places if p.verdict == "frontier")
    if not steps:
        return
    cost, quality = zip(*steps, strict=True)
    axis.step(
        (*cost, right), (*quality, quality[-1]), where="post", color="black", linewidth=1.3,
        alpha=0.75, zorder=1.5, label="frontier",
    )  # fmt: skip


def _plain(value: float, _: int) -> str:
    return f"{value:g}"


def _short(place: Place) -> str:
    """What tells a method from others of its family: a knob's value, a variant's name."""
    setting = find_setting(place.method)
    if setting is not None:
        return f"{setting.value:g}"
    return place.method.partition("@")[2]


def _family(place: Place) -> str:
    return place.method.partition("@")[0]


def _drawn(place: Place) -> bool:
    """Whether it has a place on the axes, which may be logarithmic."""
    values = (place.cost_ms.value, place.quality.value)
    positive = place.metric in IMAGE_METRICS or place.quality.value > 0
    return all(map(math.isfinite, values)) and place.cost_ms.value > 0 and positive


def _write_labels(
    figure: Any,
    axes: Sequence[Any],
    labels: Sequence[Sequence[tuple[Place, str]]],
    hues: dict[str, str],
) -> None:
    """Labels where they cover nothing, each with a hair line to its point where it is far off."""
    figure.canvas.draw()  # only now is it known where everything lies
    scale = POINTS_PER_INCH / figure.dpi
    for axis, of_axis in zip(axes, labels, strict=True):
        if not of_axis:
            continue
        xy = np.array([(p.cost_ms.value, p.quality.value) for p, _ in of_axis])
        anchors = axis.transData.transform(xy) * scale
        notes = [
            axis.annotate(text, point, xytext=(0, 0), textcoords="offset points", ha="center",
                          va="center", fontsize=LABEL_SIZE, color=hues[_family(p)])
            for point, (p, text) in zip(xy, of_axis, strict=True)
        ]  # fmt: skip
        renderer = figure.canvas.get_renderer()
        extents = [note.get_window_extent(renderer) for note in notes]
        sizes = np.array([(e.width, e.height) for e in extents]) * scale
        area = np.array(axis.bbox.extents) * scale
        centres = place_labels(anchors, sizes, _obstacles(axis) * scale, area)
        for note, offset, size in zip(notes, centres - anchors, sizes, strict=True):
            note.set_position(offset)
            note.set_in_layout(False)
            if np.linalg.norm(np.clip(np.abs(offset) - size / 2, 0, None)) > FAR_OFF:
                axis.annotate(
                    "", note.xy, xytext=offset, textcoords="offset points", zorder=1,
                    arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": "0.5",
                                "shrinkA": size[1] / 2, "shrinkB": 2},
                ).set_in_layout(False)  # fmt: skip


def _obstacles(axis: Any) -> Floats:
    """Small boxes along all lines of an axis, as far as they are in sight, [m, 4] in pixels."""
    boxes = []
    corners = axis.bbox.get_points()
    for line in axis.lines:
        # An interval down to 0 has no end on a logarithmic axis.
        path = np.clip(line.get_transform().transform(line.get_xydata()), *corners)
        reach = 2.0 + line.get_markersize() * (line.get_marker() not in ("None", None, "", " "))
        for start, end in pairwise(path):
            count = max(int(np.linalg.norm(end - start) // 4), 1)
            along = start + (end - start) * np.linspace(0, 1, count + 1)[:, None]
            boxes.append(np.concatenate([along - reach / 2, along + reach / 2], axis=1))
        boxes.append(np.concatenate([path - reach, path + reach], axis=1))
    return np.concatenate([box for box in boxes if np.isfinite(box).all()])


AREA = (54.0, 14.0, 466.0, 312.0)
WIDE_AREA = (54.0, 14.0, 866.0, 432.0)
FEW = 12  # points that labels have room for in the smaller one
MARGINS = (94.0, 48.0)  # right of the area, where floors are named, and below it
LETTER = (7.8, 14.0)  # pixels of a letter of a label: width, height
NEAR = 14.0  # pixels from a point within which its label needs no line


def cost_plots(
    comparisons: Sequence[Comparison],
    metrics: Sequence[str],
    views: int,
    styles: Mapping[str, Style],
) -> tuple[Plot, ...]:
    """A plot for each metric, condition and class; the ceiling is left out, floors are lines.

    All plots of a metric have the same axes, so that they can be compared. Methods without a time
    or a value have no point.
    """
    plots = []
    for metric in metrics:
        cells = {
            (c.condition, c.class_name): [p for p in places(c, (metric,), views) if _drawn_svg(p)]
            for c in comparisons
        }
        every = [p for of_cell in cells.values() for p in of_cell]
        points = [p for p in every if not role(p.method)]
        if not points:
            continue
        crowded = max(sum(not role(p.method) for p in of) for of in cells.values()) > FEW
        left, top, right, bottom = WIDE_AREA if crowded else AREA
        times = [v for p in points for v in (p.cost_ms.value, p.cost_ms.low, p.cost_ms.high)]
        across = axis_of(times, left, right, True)
        ends = [v for p in points for v in (p.quality.value, p.quality.low, p.quality.high)]
        levels = [p.quality.value for p in every if role(p.method) == "floor"]
        values = [p.quality.value for p in points]
        upright = axis_with_room(values, [*ends, *levels], bottom, top)
        plots += [
            _plot(metric, cell, of_cell, (across, upright), views, styles)
            for cell, of_cell in cells.items()
        ]
    return tuple(plots)


def _of_views(views: int) -> str:
    return "1 view" if views == 1 else f"its {views} views"


def _drawn_svg(place: Place) -> bool:
    """Whether it has a place on the axes, of which that of cost is logarithmic."""
    if role(place.method) == "ceiling" or not math.isfinite(place.quality.value):
        return False
    return role(place.method) == "floor" or place.cost_ms.value > 0


def _plot(
    metric: str,
    cell: tuple[str, str],
    of_cell: Sequence[Place],
    axes: tuple[Axis, Axis],
    views: int,
    styles: Mapping[str, Style],
) -> Plot:
    across, upright = axes
    left, top, right, bottom = area = _area(axes)
    condition, class_name = cell
    points = [p for p in of_cell if not role(p.method)]
    families: dict[str, list[Place]] = {}
    for place in points:
        families.setdefault(family(place.method), []).append(place)
    steps = sorted((p.cost_ms.value, p.quality.value) for p in points if p.verdict == "frontier")
    pixels = [(across.at(cost), upright.at(quality)) for cost, quality in steps]
    words = _words(points, axes, pixels)
    series = [
        _series(name, members, axes, styles[members[0].method], words)
        for name, members in families.items()
    ]
    floors = [p for p in of_cell if role(p.method) == "floor"]
    levels = [upright.at(p.quality.value) for p in floors]
    heights = spread(levels, LETTER[1], top, bottom)
    for floor, y, height in zip(floors, levels, heights, strict=True):
        told = f"{floor.method}: {floor.quality.value:.{decimals(metric)}f}, looks at no cloud"
        path = f"M{left:.1f} {y:.1f}H{right:.1f}"
        leader = f"M{right:.1f} {y:.1f}L{right + 10:.1f} {height:.1f}"
        word = Word(right + 14, height, floor.method, leader=leader)
        marks = (Mark(left, y, told),)
        tags = Tags(method=floor.method)
        series.append(Series(floor.method, styles[floor.method], path, marks, (word,), tags))
    better = f"{'higher' if higher_is_better(metric) else 'lower'} is better"
    by_cost = sorted(points, key=lambda p: p.cost_ms.value)
    return Plot(
        title=f"{condition}, {class_name}",
        told=f"{metric}, {better}, by rising cost: " + "; ".join(map(_told, by_cost)) + ".",
        width=int(right + MARGINS[0]),
        height=int(bottom + MARGINS[1]),
        area=area,
        x_title=f"milliseconds for a cloud with {_of_views(views)} (logarithmic)",
        y_title=f"{metric} ({better})",
        x_ticks=tuple(across.ticks()),
        y_ticks=tuple(upright.ticks()),
        series=tuple(series),
        wide=area == WIDE_AREA,
        frontier=_staircase(pixels, right),
        tags=Tags(condition=condition, class_name=class_name),
    )


def _area(axes: tuple[Axis, Axis]) -> tuple[float, float, float, float]:
    """Left, top, right, bottom."""
    across, upright = axes
    return across.start, upright.end, across.end, upright.start


def _series(
    name: str,
    members: Sequence[Place],
    axes: tuple[Axis, Axis],
    style: Style,
    words: Mapping[str, Word],
) -> Series:
    across, upright = axes
    marks = tuple(
        Mark(
            across.at(p.cost_ms.value),
            upright.at(p.quality.value),
            _told(p),
            Tags(method=p.method),
            _ends(across, p.cost_ms),
            _ends(upright, p.quality),
        )
        for p in members
    )
    joined = "M" + "L".join(f"{m.x:.1f} {m.y:.1f}" for m in marks) if len(marks) > 1 else ""
    of_members = tuple(words[p.method] for p in members if p.method in words)
    tags = Tags(method=name) if len(members) == 1 else Tags()
    return Series(name, style, joined, marks, of_members, tags)


def _told(place: Place) -> str:
    value = f"{place.quality.value:.{decimals(place.metric)}f}"
    ahead = ", on the frontier" if place.verdict == "frontier" else ""
    return f"{place.method}: {milliseconds(place.cost_ms.value)} ms, {value}{ahead}"


def _ends(axis: Axis, estimate: Estimate) -> tuple[float, float] | None:
    if not math.isfinite(estimate.low):
        return None
    low = estimate.low if estimate.low > 0 or not axis.logarithmic else axis.low
    return axis.at(low), axis.at(estimate.high)


def _staircase(pixels: Sequence[tuple[float, float]], right: float) -> str:
    """At each cost the best quality that it buys, up to the right end."""
    if not pixels:
        return ""
    start, *rest = pixels
    steps = "".join(f"H{x:.1f}V{y:.1f}" for x, y in rest)
    return f"M{start[0]:.1f} {start[1]:.1f}{steps}H{right:.1f}"


def _words(
    points: Sequence[Place], axes: tuple[Axis, Axis], steps: Sequence[tuple[float, float]]
) -> dict[str, Word]:
    """A label for each point, where it covers nothing; a setting of a knob is named by its value.

    Of a knob with many settings the first and the last are named, and the method itself.
    """
    across, upright = axes
    texts: dict[str, str] = {}
    for name in dict.fromkeys(family(p.method) for p in points):
        members = [p.method for p in points if family(p.method) == name]
        for method in members:
            setting = find_setting(method)
            if setting is None:
                texts[method] = method if len(method) <= 24 else f"…{method[-23:]}"
            elif method in (members[0], members[-1]):
                texts[method] = f"{setting.knob.name} {setting.value:g}"
            if name not in members and method == members[0]:
                texts[method] = method
    named = [p for p in points if p.method in texts]
    if not named:
        return {}
    xy = np.array([(across.at(p.cost_ms.value), upright.at(p.quality.value)) for p in points])
    anchors = xy[[p.method in texts for p in points]]
    sizes = np.array([(LETTER[0] * len(texts[p.method]) + 6, LETTER[1]) for p in named])
    marks = np.concatenate([xy - 6, xy + 6], axis=1)
    intervals = [
        box
        for p, (x, y) in zip(points, xy, strict=True)
        for ends, flat in ((_ends(across, p.cost_ms), True), (_ends(upright, p.quality), False))
        if ends is not None
        for box in [
            (min(ends), y - 1, max(ends), y + 1) if flat else (x - 1, min(ends), x + 1, max(ends))
        ]
    ]
    corners = [(x0, y0, x1, y1) for (x0, y0), (x1, y1) in pairwise(steps)]
    flat = [(min(x0, x1), y0 - 1, max(x0, x1), y0 + 1) for x0, y0, x1, _ in corners]
    flat += [(x, y - 1, across.end, y + 1) for x, y in steps[-1:]]
    steep = [(x1 - 1, min(y0, y1), x1 + 1, max(y0, y1)) for _, y0, x1, y1 in corners]
    obstacles = np.array([*marks.tolist(), *intervals, *flat, *steep], np.float64)
    centres = place_labels(anchors, sizes, obstacles, np.array(_area(axes)))
    words = {}
    for p, anchor, centre, size in zip(named, anchors, centres, sizes, strict=True):
        beyond = np.linalg.norm(np.clip(np.abs(centre - anchor) - size / 2, 0, None))
        nearest = np.clip(anchor, centre - size / 2, centre + size / 2)
        far = f"M{anchor[0]:.1f} {anchor[1]:.1f}L{nearest[0]:.1f} {nearest[1]:.1f}"
        leader = far if beyond > NEAR else ""
        words[p.method] = Word(centre[0], centre[1], texts[p.method], "middle", leader)
    return words
