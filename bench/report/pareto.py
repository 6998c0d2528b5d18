"""Quality against cost, in figures: a panel for each condition."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.frontier import Place
from bench.catalogue.methods import FLOORS
from bench.catalogue.metrics import IMAGE_METRICS
from bench.catalogue.parameters import find_setting
from bench.report.label_places import Floats, place_labels

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
    for family, hue in hues.items():
        members = [p for p in rivals if _family(p) == family]
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
            label=family + (f" ({knob})" if knob else ""),
        )
        for p in members:
            _draw_intervals(axis, p, hue)
            if p.method == family:
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
