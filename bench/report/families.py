"""Methods along families of conditions: a plot for each family, and which method is ahead."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.condition_sweep import ConditionCurve, place_of
from bench.catalogue.conditions import Family
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import is_mean
from bench.records.artifacts import JobName
from bench.records.stored_artifacts import Artifact
from bench.report.blank_region import shade_worse
from bench.report.figure import FIGURES, TEXT, WIDTH_IN, drawing, panels, save
from bench.report.inline import MarkedFigure, inline
from bench.report.page import Plot
from bench.report.robustness import (
    PLOT_IN,
    PLOT_TEXT,
    Point,
    axis_title,
    draw_curve,
    in_words,
    scale_distances,
    write_images,
)
from bench.report.styles import RULE, MethodStyle, method_styles
from bench.tables.grid import Tags, measured, ordered
from bench.tables.markdown import visible

HEIGHT_IN, LEGEND_IN, LEGEND_COLUMNS = 1.9, 0.8, 4
LETTERS_IN_LINE = 27  # of a name below a narrow panel
MOST_TICKS = 3  # level labels that a narrow panel has room for
SHOWN = 0.13  # opacity of a band
PAD = 0.06  # of the axis, beyond its first and last step
OBJECTS_SHOWN = 2


def write_beyond_figures(
    directory: Path, curves: Sequence[ConditionCurve], artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write `beyond` (PNG and SVG) and `beyond-pictures.png`.

    The latter has the first view of the first objects, whatever they are, at each condition,
    family after family. `artifacts` are all of the run, ground truths included. Ceiling
    and floors have no image.
    """
    folder = directory / FIGURES
    figure = beyond_figure(curves, method_styles(ordered(c.method for c in curves))).figure
    for kind in ("png", "svg"):
        save(figure, folder / f"beyond.{kind}")
    conditions = ordered(c for curve in curves for c in curve.family.conditions)
    path = folder / "beyond-pictures.png"
    write_images(path, artifacts, conditions, OBJECTS_SHOWN)


@drawing()
def beyond_figure(
    curves: Sequence[ConditionCurve],
    styles: Mapping[str, MethodStyle],
    *,
    plot_in: tuple[float, float] | None = None,
    fontsize: float = TEXT,
) -> MarkedFigure:
    """Draw a row for each family, a column for each metric (and class), a line for each method.

    Without `plot_in` the figure is that of a file, with a legend. Bands show the range of the
    training of each network of the run. Floors are level lines but for the chance of their views;
    the ceiling is left out.
    """
    curves = [c for c in curves if role(c.method) != "ceiling"]
    families = list(dict.fromkeys(c.family for c in curves))
    columns = list(dict.fromkeys((c.class_name, c.metric) for c in curves))
    size_in = plot_in or (WIDTH_IN, HEIGHT_IN * len(families) + LEGEND_IN)
    figure, axes = panels(len(families), len(columns), size_in, sharex="row", sharey="col")
    drawn = MarkedFigure(figure)
    several = len({class_name for class_name, _ in columns}) > 1
    for column, (class_name, metric) in zip(axes.T, columns, strict=True):
        if not is_mean(metric):
            scale_distances(column[0])
        blanks = []
        for axis, family in zip(column, families, strict=True):
            cell = (class_name, metric, family)
            of_cell = [c for c in curves if (c.class_name, c.metric, c.family) == cell]
            _draw_panel(drawn, axis, of_cell, styles, fontsize)
            axis.set_xlabel(family.axis, fontsize=fontsize)
            if plot_in is None:
                axis.set_xlabel(textwrap.fill(family.axis, LETTERS_IN_LINE), fontsize=fontsize)
                axis.tick_params(axis="x", labelrotation=60 * (len(family.values) > MOST_TICKS))
            blanks += [e.value for c in of_cell if c.method == FLOOR for e in c.estimates]
        blank = float(np.nanmean(blanks)) if np.isfinite(blanks).any() else math.nan
        for axis in column:  # with the limits that they share
            shade_worse(axis, metric, [(*axis.get_xlim(), blank)], fontsize, plot_in is not None)
        title = axis_title(metric).replace(" (", "\n(")
        name = f"{visible(class_name)}: {title}" if several else title
        column[0].set_title(name, fontsize=fontsize)
    for line, family in zip(axes, families, strict=True):
        line[0].set_ylabel(family.id, fontsize=fontsize)
    if plot_in is None:
        drawn.legend(LEGEND_COLUMNS, fontsize)
    return drawn


def _draw_panel(
    drawn: MarkedFigure,
    axis: Any,
    curves: Sequence[ConditionCurve],
    styles: Mapping[str, MethodStyle],
    fontsize: float,
) -> None:
    family = curves[0].family
    places = [place_of(value, family) for value in family.values]
    _draw_bands(drawn, axis, family, places, {c.method: styles[c.method].colour for c in curves})
    for c in curves:
        points = [
            Point(x, condition, c.class_name, estimate, measured(estimate, c.metric, c.method))
            for x, condition, estimate in zip(places, family.conditions, c.estimates, strict=True)
        ]
        line = draw_curve(drawn, axis, c.method, points, styles[c.method])
        drawn.mark(line, Tags(method=c.method), series=not styles[c.method].marker)
    axis.set_xticks(places, [f"{value:g}" for value in family.values])
    axis.tick_params(labelsize=fontsize)
    pad = PAD * (places[-1] - places[0])
    axis.set_xlim(places[0] - pad, places[-1] + pad)
    axis.grid(color=RULE, linewidth=0.6)
    axis.set_axisbelow(True)


def _draw_bands(
    drawn: MarkedFigure, axis: Any, family: Family, places: Sequence[float], hues: Mapping[str, str]
) -> None:
    """Draw a band where each network was trained.

    A band of a single value, or one that reaches the first step or the last, goes on to half of
    the room beyond it.
    """
    pad = PAD / 2 * abs(places[-1] - places[0])
    least, most = min(places), max(places)
    for name, *ends in family.trained:
        if name not in hues:
            continue
        low, high = (place_of(end, family) for end in ends)
        single = low == high
        band = axis.axvspan(
            low - pad * (single or low <= least),
            high + pad * (single or high >= most),
            color=hues[name],
            alpha=SHOWN,
            linewidth=0,
            label=f"{name} was trained here",
        )
        drawn.mark(band, Tags(method=name))


def family_curves(
    curves: Sequence[ConditionCurve], styles: Mapping[str, MethodStyle]
) -> tuple[Plot, ...]:
    """Return a plot of the page for each class, family and metric; their legend stands beside."""
    plots = []
    curves = [c for c in curves if role(c.method) != "ceiling"]
    for cell in dict.fromkeys((c.class_name, c.family, c.metric) for c in curves):
        class_name, family, metric = cell
        of_cell = [c for c in curves if (c.class_name, c.family, c.metric) == cell]
        figure = beyond_figure(of_cell, styles, plot_in=PLOT_IN, fontsize=PLOT_TEXT)
        description = in_words(
            (c.method, condition, measured(estimate, metric, c.method).text)
            for c in of_cell
            for condition, estimate in zip(family.conditions, c.estimates, strict=True)
        )
        plots.append(
            Plot(
                title=f"{metric} against {family.id}, class {class_name}",
                axis=axis_title(metric),
                description=f"{axis_title(metric)}, against {family.axis}. {description}",
                svg=inline(figure, f"family-{len(plots)}"),
                tags=Tags(class_name=class_name),
            )
        )
    return tuple(plots)
