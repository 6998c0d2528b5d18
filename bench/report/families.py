"""Methods along families of conditions: a plot for each family, and which method is ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.analysis.condition_sweep import ConditionCurve, place_of
from bench.catalogue.families import Family
from bench.catalogue.methods import role
from bench.catalogue.metrics import is_mean
from bench.records.artifacts import JobName
from bench.report.inline import MarkedFigure, inline
from bench.report.page import Plot
from bench.report.robustness import (
    Point,
    axis_title,
    draw_curve,
    in_words,
    scale_distances,
    write_images,
)
from bench.report.styles import RULE, MethodStyle, method_styles
from bench.tables.figure import FIGURES, drawing, panels, save
from bench.tables.grid import Tags, ordered
from bench.tables.markdown import visible

PANEL_IN = (3.1, 2.5)
WIDE_IN = (5.2, 3.4)  # of a plot of the page
LEGEND_IN = 0.7
SHOWN = 0.13  # opacity of a band
PAD = 0.06  # of the axis, beyond its first and last step
OBJECTS_SHOWN = 2


def write_beyond_figures(
    directory: Path, curves: Sequence[ConditionCurve], artifacts: Mapping[JobName, Path]
) -> None:
    """Write `beyond` (PNG and SVG) and `beyond-pictures.png`.

    The latter has the first view of the first objects, whatever they are, and a column for each
    condition, family after family. `artifacts` are all of the run, ground truths included. Ceiling
    and floors have no image.
    """
    folder = directory / FIGURES
    figure = beyond_figure(curves, method_styles(ordered(c.method for c in curves))).figure
    for kind in ("png", "svg"):
        save(figure, folder / f"beyond.{kind}")
    conditions = ordered(c for curve in curves for c in curve.family.conditions)
    path = folder / "beyond-pictures.png"
    write_images(path, artifacts, conditions, OBJECTS_SHOWN, cell_in=1.2, titles_in=0.2, dpi=80)


@drawing()
def beyond_figure(
    curves: Sequence[ConditionCurve],
    styles: Mapping[str, MethodStyle],
    *,
    panel_in: tuple[float, float] = PANEL_IN,
    legend_columns: int = 6,
) -> MarkedFigure:
    """Draw a column for each family, a row for each metric (and class), a line for each method.

    Bands show the range of the training of each network of the run. Floors are level lines but
    for the chance of their views; the ceiling is left out.
    """
    curves = [c for c in curves if role(c.method) != "ceiling"]
    families = list(dict.fromkeys(c.family for c in curves))
    lines = list(dict.fromkeys((c.class_name, c.metric) for c in curves))
    size_in = (panel_in[0] * len(families), panel_in[1] * len(lines) + LEGEND_IN)
    figure, axes = panels(len(lines), len(families), size_in, sharex="col", sharey="row")
    drawn = MarkedFigure(figure)
    several = len({class_name for class_name, _ in lines}) > 1
    for axis_row, (class_name, metric) in zip(axes, lines, strict=True):
        if not is_mean(metric):
            scale_distances(axis_row[0])
        for axis, family in zip(axis_row, families, strict=True):
            cell = (class_name, metric, family)
            of_cell = [c for c in curves if (c.class_name, c.metric, c.family) == cell]
            _draw_panel(drawn, axis, of_cell, styles)
        title = axis_title(metric).replace(" (", "\n(")
        name = f"{visible(class_name)}: {title}" if several else title
        axis_row[0].set_ylabel(name, fontsize=9)
    for axis, family in zip(axes[-1], families, strict=True):
        axis.set_xlabel(family.axis, fontsize=8)
    for axis, family in zip(axes[0], families, strict=True):
        axis.set_title(family.id, fontsize=11)
    drawn.legend(legend_columns, fontsize=9)
    return drawn


def _draw_panel(
    drawn: MarkedFigure,
    axis: Any,
    curves: Sequence[ConditionCurve],
    styles: Mapping[str, MethodStyle],
) -> None:
    family = curves[0].family
    places = [place_of(value, family) for value in family.values]
    _draw_bands(drawn, axis, family, places, {c.method: styles[c.method].colour for c in curves})
    for c in curves:
        points = [
            Point(x, condition, c.class_name, estimate)
            for x, condition, estimate in zip(places, family.conditions, c.estimates, strict=True)
        ]
        line = draw_curve(drawn, axis, c.metric, c.method, points, styles[c.method])
        drawn.mark(line, Tags(method=c.method), series=True)
    axis.set_xticks(places, [f"{value:g}" for value in family.values], fontsize=8)
    axis.tick_params(axis="y", labelsize=8)
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
    """Return a plot of the page for each class, family and metric."""
    plots = []
    curves = [c for c in curves if role(c.method) != "ceiling"]
    for cell in dict.fromkeys((c.class_name, c.family, c.metric) for c in curves):
        class_name, family, metric = cell
        of_cell = [c for c in curves if (c.class_name, c.family, c.metric) == cell]
        figure = beyond_figure(of_cell, styles, panel_in=WIDE_IN, legend_columns=3)
        description = in_words(
            metric,
            (
                (c.method, condition, estimate.value)
                for c in of_cell
                for condition, estimate in zip(family.conditions, c.estimates, strict=True)
            ),
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
