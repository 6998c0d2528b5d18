"""The plots of a site's index: quality against cost, and quality along the conditions.

They are narrow, so that their text has eleven pixels on a phone too, and name their lines directly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from bench.analysis.comparison import Comparison, milliseconds
from bench.analysis.frontier import FrontierPoint, places
from bench.catalogue.condition_names import condition_name, condition_words
from bench.catalogue.families import families_of
from bench.catalogue.methods import FLOOR, role
from bench.report.blank_region import shade_worse
from bench.report.inline import MarkedFigure, inline
from bench.report.page import Plot
from bench.report.pareto import place_labels
from bench.report.robustness import (
    Point,
    axis_title,
    draw_curve,
    in_words,
    make_hollow,
    point_style,
    shortened,
)
from bench.report.site.site_run import SiteRun
from bench.report.styles import INK, RULE, MethodStyle, method_styles
from bench.tables.figure import drawing, name_lines, panels
from bench.tables.grid import Tags, measured
from bench.tables.markdown import visible
from data_prep.arrays import Floats

SIZE_IN = (4.5, 3.5)  # 324 points wide: a phone shows a point as a pixel
TEXT = 11  # points
MOST_CURVES = 8  # methods that names have room for
MOST_STEPS = 6  # conditions beside each other, else a plot for each family of conditions
LONGEST = 17  # letters of a name
GAP = 0.5  # of a step, between kinds of conditions
NAMES_AT = 1.04  # of the width of an axis
APART = 0.075  # of the height of an axis
RIGHT = 0.68  # where the axis ends and the names begin, of the width of a plot
REACH = 6.0  # half the side of a point, in points of 1/72 inch
POINTS_PER_INCH = 72


def run_plots(run: SiteRun, methods: Sequence[str]) -> tuple[Plot, ...]:
    """Return the frontier of a run and a curve for each metric, of these methods (ids) and blank.

    Of many conditions each family has curves of its own. A run with one condition has no curves,
    one without times no frontier.
    """
    chosen = [m for m in methods if not role(m) and m in run.overall.images][:MOST_CURVES]
    styles = method_styles([*chosen, FLOOR, *run.overall.images])
    name = f"plot-{run.slug}"
    plots = []
    metric = run.metrics[0]
    # A variant on the frontier is drawn too, else the line would be that of worse methods.
    points = [
        point
        for point in places(run.overall, (metric,), 1)
        if math.isfinite(point.quality.value)
        and (point.method in (*chosen, FLOOR) or point.verdict == "frontier")
    ]
    if any(point.cost_ms.value > 0 and not role(point.method) for point in points):
        plots.append(
            Plot(
                title=f"{metric} against cost",
                axis=f"{axis_title(metric)}; milliseconds for a cloud and one view, logarithmic; "
                "the line joins what nothing cheaper beats",
                description="; ".join(_in_words(p) for p in points if not role(p.method)) + ".",
                svg=inline(frontier_figure(points, styles), f"{name}-cost"),
            )
        )
    for metric in run.metrics:
        for number, (title, conditions) in enumerate(_axes(run)):
            compared = sorted(
                (c for c in run.compared if c.condition in conditions),
                key=lambda c: conditions.index(c.condition),
            )
            plots.append(
                Plot(
                    title=f"{metric} {title}",
                    axis=f"{axis_title(metric)}; shaded: worse than a white image",
                    description=in_words(
                        (m, condition_words(c.condition), quality.estimate.value, quality.precision)
                        for m in chosen
                        for c in compared
                        for quality in [c.qualities[metric][m]]
                    ),
                    svg=inline(
                        curve_figure(compared, metric, chosen, styles), f"{name}-{metric}-{number}"
                    ),
                )
            )
    return tuple(plots)


def _axes(run: SiteRun) -> list[tuple[str, tuple[str, ...]]]:
    """Return the titles and conditions of the curves of each metric."""
    conditions = tuple(c.condition for c in run.compared)
    if len(conditions) < 2:
        return []
    families = families_of(conditions)
    if len(conditions) <= MOST_STEPS or not families:
        return [("along the conditions", conditions)]
    return [(f"along {family.id}", family.conditions) for family in families]


@drawing()
def curve_figure(
    compared: Sequence[Comparison],
    metric: str,
    methods: Sequence[str],
    styles: Mapping[str, MethodStyle],
) -> MarkedFigure:
    """Draw a line for each method, broken between kinds of conditions."""
    drawn, axis = _figure()
    steps = _steps([c.condition for c in compared])
    labelled = []
    for method in methods:
        points = [
            Point(x, c.condition, c.class_name, quality.estimate, quality.precision)
            for (x, _), c in zip(steps, compared, strict=True)
            for quality in [c.qualities[metric][method]]
        ]
        of_kinds = groupby(zip(steps, points, strict=True), key=lambda pair: pair[0][1])
        segments = [[point for _, point in of_kind] for _, of_kind in of_kinds]
        lines = [draw_curve(drawn, axis, method, s, styles[method]) for s in segments]
        for line in lines:
            drawn.mark(line, Tags(method=method))
        lines[-1].set_label(shortened(visible(method), LONGEST))
        labelled.append(lines[-1])
    axis.set_xticks(
        [x for x, _ in steps],
        [_tick(c.condition, len(steps)) for c in compared],
        fontsize=TEXT,
        linespacing=0.95,
    )
    axis.set_xlim(steps[0][0] - 0.3, steps[-1][0] + 0.3)
    blanks = [c.qualities[metric][FLOOR].estimate.value for c in compared]
    shade_worse(axis, metric, [(*axis.get_xlim(), float(np.mean(blanks)))], TEXT, named=False)
    names = name_lines(axis, labelled, NAMES_AT, apart=APART, fontsize=TEXT)
    for method, name in zip(methods, names, strict=True):
        name.set_color(INK)  # hues of markers are too light for text
        drawn.mark(name, Tags(method=method), series=True)
    return drawn


@drawing()
def frontier_figure(
    points: Sequence[FrontierPoint], styles: Mapping[str, MethodStyle]
) -> MarkedFigure:
    """Draw quality against the cost of one view, with names at the points."""
    drawn, axis = _figure(whole=True)
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter("{x:g}")
    rivals = [p for p in points if p.cost_ms.value > 0 and not role(p.method)]
    for p in rivals:
        (point,) = axis.plot(p.cost_ms.value, p.quality.value, **point_style(styles[p.method], 7))
        if p.verdict == "below a white image":
            make_hollow(point, styles[p.method], 1.2)
        drawn.mark(point, Tags(method=p.method), _in_words(p), series=True)
    axis.margins(x=0.12, y=0.12)
    left, right = axis.get_xlim()
    steps = sorted((p.cost_ms.value, p.quality.value) for p in rivals if p.verdict == "frontier")
    if steps:
        cost, quality = zip(*steps, strict=True)
        axis.step((*cost, right), (*quality, quality[-1]), where="post", color=INK, linewidth=1.2,
                  alpha=0.75, zorder=1.5)  # fmt: skip
    axis.set_xlim(left, right)
    axis.tick_params(axis="x", which="minor", labelbottom=False)
    axis.set_xlabel("ms a view", fontsize=TEXT)
    drawn.figure.subplots_adjust(bottom=0.185)
    for blank in (p.quality.value for p in points if p.method == FLOOR):
        shade_worse(axis, points[0].metric, [(left, right, blank)], TEXT, named=False)
    _name_points(drawn, axis, rivals, steps)
    return drawn


def _figure(whole: bool = False) -> tuple[MarkedFigure, Any]:
    """Return an empty plot; without `whole` there is room for names at the right."""
    figure, axes = panels(1, 1, SIZE_IN, layout=None)
    figure.subplots_adjust(left=0.125, right=0.985 if whole else RIGHT, bottom=0.135, top=0.975)
    axis = axes[0][0]
    axis.grid(axis="y", color=RULE, linewidth=0.7)
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=TEXT)
    axis.spines[["top", "right"]].set_visible(False)
    axis.yaxis.set_major_formatter(lambda y, _: f"{y:.2f}".replace("0.", ".").replace("-", "−"))
    return MarkedFigure(figure), axis


def _steps(conditions: Sequence[str]) -> list[tuple[float, str]]:
    """Return the place of each condition on the axis, and its kind: kinds stand apart.

    Conditions of one family are all of one kind, with the full cloud as its beginning.
    """
    if any(set(conditions) == set(family.conditions) for family in families_of(conditions)):
        return [(float(i), "") for i in range(len(conditions))]
    steps: list[tuple[float, str]] = []
    for condition in conditions:
        kind = condition_name(condition).kind
        x = steps[-1][0] + 1 + GAP * (kind != steps[-1][1]) if steps else 0.0
        steps.append((x, kind))
    return steps


def _tick(condition: str, steps: int) -> str:
    """Return a condition as the label of a tick: short, on two lines where its kind is named."""
    name = condition_name(condition)
    if name.kind == "noise":
        return f"noise\n{name.short}" if steps > 3 else f"noise {name.short}"
    if name.kind in ("outliers", "missing"):
        return f"{name.short}\n{name.kind}"
    return name.short


def _name_points(
    drawn: MarkedFigure,
    axis: Any,
    points: Sequence[FrontierPoint],
    steps: Sequence[tuple[float, float]],
) -> None:
    """Write the names of points where they cover no point and no step of the frontier."""
    drawn.figure.draw_without_rendering()  # before it nothing has a place
    scale = POINTS_PER_INCH / drawn.figure.dpi
    xy = np.array([(p.cost_ms.value, p.quality.value) for p in points])
    anchors: Floats = axis.transData.transform(xy) * scale
    notes = [
        axis.annotate(shortened(visible(p.method), LONGEST), at, xytext=(0, 0), va="center",
                      textcoords="offset points", ha="center", fontsize=TEXT,
                      color=INK)
        for at, p in zip(xy, points, strict=True)
    ]  # fmt: skip
    extents = [note.get_window_extent() for note in notes]
    sizes = np.array([(e.width, e.height) for e in extents]) * scale
    corners = [corner for (_, y), (x, up) in pairwise(steps) for corner in ((x, y), (x, up))]
    ends = [(axis.get_xlim()[1], steps[-1][1])] if steps else []
    path = [*steps[:1], *corners, *ends]
    at = [anchors]
    for start, end in pairwise(axis.transData.transform(path) * scale if path else ()):
        at.append(start + (end - start) * np.linspace(0, 1, 25)[:, None])
    every = np.concatenate(at)
    obstacles = np.concatenate([every - REACH, every + REACH], axis=1)
    centres = place_labels(anchors, sizes, obstacles, np.array(axis.bbox.extents) * scale)
    for note, p, offset in zip(notes, points, centres - anchors, strict=True):
        note.set_position(offset)
        drawn.mark(note, Tags(method=p.method))


def _in_words(point: FrontierPoint) -> str:
    value = measured(point.quality, point.precision).text
    verdict = {
        "frontier": ", on the frontier",
        "below a white image": ", worse than a white image",
        "claimed": ", cost as claimed",
    }.get(point.verdict, "")
    return f"{point.method}: {milliseconds(point.cost_ms.value)} ms, {value}{verdict}"
