"""Methods along families of conditions: a plot for each family, and who is ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.comparison import candidates
from bench.analysis.crossings import Course, place_of
from bench.catalogue.families import Family
from bench.catalogue.methods import FLOORS
from bench.catalogue.metrics import is_similarity
from bench.records.artifacts import Artifact, Item
from bench.records.record import GROUND_TRUTH
from bench.report.page import Plot, Style
from bench.report.pareto import FLOOR_STYLES, HUES
from bench.report.robustness import FIGURES, curves, show
from bench.tables.quality import Row
from bench.tables.table import Table, ordered

PANEL_IN = (3.1, 2.5)
LEGEND_IN = 0.7
MARKERS = "osD^vP*X"
SHOWN = 0.13  # opacity of a band
PAD = 0.06  # of the axis, beyond its first and last step
LINEAR = 10  # below it an axis of distances is linear, above it logarithmic
SUBDIVIDED = (1, 2, 5)
OBJECTS_SHOWN = 2


def write_beyond_figures(
    directory: Path, courses: Sequence[Course], artifacts: Sequence[Artifact]
) -> None:
    """`beyond` (PNG and SVG) and `beyond-pictures.png`.

    `artifacts` are all that there are, ground truths included.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    folder = directory / FIGURES
    folder.mkdir(exist_ok=True)
    figure = beyond_figure(courses)
    for kind in ("png", "svg"):
        figure.savefig(folder / f"beyond.{kind}", dpi=110)
    plt.close(figure)
    _pictures(folder / "beyond-pictures.png", courses, artifacts)


def beyond_figure(courses: Sequence[Course]) -> Any:
    """A column for each family, a row for each metric (and class), a line for each method.

    The bands are what the networks of the run were shown in training. Floors are level lines but
    for the chance of their views; the ceiling is left out.
    """
    from matplotlib import pyplot as plt
    from matplotlib.ticker import SymmetricalLogLocator

    families = list(dict.fromkeys(c.family for c in courses))
    lines = list(dict.fromkeys((c.class_name, c.metric) for c in courses))
    rivals = candidates(ordered(c.method for c in courses))
    looks = {m: (HUES[i % len(HUES)], MARKERS[i % len(MARKERS)]) for i, m in enumerate(rivals)}
    figure, axes = plt.subplots(
        len(lines),
        len(families),
        figsize=(PANEL_IN[0] * len(families), PANEL_IN[1] * len(lines) + LEGEND_IN),
        sharex="col",
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    several = len({class_name for class_name, _ in lines}) > 1
    for axis_row, (class_name, metric) in zip(axes, lines, strict=True):
        higher = is_similarity(metric)
        if not higher:
            axis_row[0].set_yscale("symlog", linthresh=LINEAR)
            axis_row[0].yaxis.set_major_locator(
                SymmetricalLogLocator(base=10, linthresh=LINEAR, subs=SUBDIVIDED)
            )
            axis_row[0].yaxis.set_major_formatter("{x:g}")
        for axis, family in zip(axis_row, families, strict=True):
            _panel(
                axis,
                [c for c in courses if (c.class_name, c.metric) == (class_name, metric)
                 and c.family == family],
                looks,
            )  # fmt: skip
        name = f"{class_name}: {metric}" if several else metric
        axis_row[0].set_ylabel(f"{name}\n({'higher' if higher else 'lower'} is better)")
    for axis, family in zip(axes[-1], families, strict=True):
        axis.set_xlabel(family.axis, fontsize=8)
    for axis, family in zip(axes[0], families, strict=True):
        axis.set_title(family.id, fontsize=11)
    handles = {h.get_label(): h for a in axes.ravel() for h in _handles(a)}
    figure.legend(
        handles=list(handles.values()), loc="outside lower center", ncols=6, fontsize=9,
        frameon=False,
    )  # fmt: skip
    return figure


def _handles(axis: Any) -> list[Any]:
    return axis.get_legend_handles_labels()[0]


def _panel(axis: Any, courses: Sequence[Course], looks: Mapping[str, tuple[str, str]]) -> None:
    family = courses[0].family
    places = [place_of(value, family) for value in family.values]
    _bands(axis, family, places, looks)
    floors = [c for c in courses if c.method in FLOORS]
    for c, style in zip(floors, FLOOR_STYLES, strict=False):
        values = [e.value for e in c.estimates]
        axis.plot(places, values, color="0.45", linewidth=0.9, linestyle=style, label=c.method)
    for c in courses:
        if c.method not in looks:
            continue
        hue, marker = looks[c.method]
        values, lows, highs = np.array(c.estimates).T
        axis.errorbar(
            places,
            values,
            yerr=np.nan_to_num([values - lows, highs - values]).clip(0),
            color=hue,
            marker=marker,
            markersize=4,
            linewidth=1.3,
            elinewidth=0.7,
            capsize=2,
            label=c.method,
        )
    axis.set_xticks(places, [f"{value:g}" for value in family.values], fontsize=8)
    pad = PAD * (places[-1] - places[0])
    axis.set_xlim(places[0] - pad, places[-1] + pad)
    axis.grid(alpha=0.25)


def _bands(
    axis: Any, family: Family, places: Sequence[float], looks: Mapping[str, tuple[str, str]]
) -> None:
    """What each network was shown; what is a single value, or reaches the first step or the last,
    goes on to half of the room beyond it."""
    pad = PAD / 2 * abs(places[-1] - places[0])
    least, most = min(places), max(places)
    for name, *ends in family.trained:
        if name not in looks:
            continue
        low, high = (place_of(end, family) for end in ends)
        single = low == high
        axis.axvspan(
            low - pad * (single or low <= least),
            high + pad * (single or high >= most),
            color=looks[name][0],
            alpha=SHOWN,
            linewidth=0,
            label=f"{name} was trained here",
        )


def _pictures(path: Path, courses: Sequence[Course], artifacts: Sequence[Artifact]) -> None:
    """The first view of the first objects, nobody has chosen: a row for each method, a column for
    each condition, family after family. No picture of ceiling and floors."""
    from matplotlib import pyplot as plt

    by_item = {artifact.item: artifact for artifact in artifacts}
    objects = ordered_objects(artifacts)[:OBJECTS_SHOWN]
    methods = candidates(ordered(item.method for item in by_item if item.condition))
    columns = ordered(c for course in courses for c in course.family.conditions)
    rows = [(obj, method) for obj in objects for method in methods]
    if not rows:
        return
    figure, axes = plt.subplots(
        len(rows),
        1 + len(columns),
        figsize=(1.2 * (1 + len(columns)) + 1, 1.2 * len(rows) + 0.2),
        squeeze=False,
    )
    for axis_row, (obj, method) in zip(axes, rows, strict=True):
        cells = [(GROUND_TRUTH, ""), *((method, condition) for condition in columns)]
        for axis, cell in zip(axis_row, cells, strict=True):
            artifact = by_item.get(Item(*cell, *obj))
            show(axis, None if artifact is None else artifact.pictures()[0])
        axis_row[0].set_ylabel(f"{obj[1][:18]}\n{method}", fontsize=7)
    for axis, title in zip(axes[0], [GROUND_TRUTH, *columns], strict=True):
        axis.set_title(title, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def ordered_objects(artifacts: Sequence[Artifact]) -> list[tuple[str, str]]:
    """The objects of artifacts by class and name, in the order of the artifacts."""
    return list(dict.fromkeys(a.item.object for a in artifacts))


def family_curves(
    tables: Sequence[Table[Row]], styles: Mapping[str, Style], courses: Sequence[Course]
) -> tuple[Plot, ...]:
    """`bench.report.robustness.curves` for each family and metric of `courses` apart."""
    plots = []
    for family, metric in dict.fromkeys((c.family, c.metric) for c in courses):
        plots += [
            replace(
                plot,
                title=f"{metric} against {family.id}, class {plot.tags.class_name}",
                x_title=family.axis,
            )
            for plot in curves([_part(table, family, metric) for table in tables], styles)
        ]
    return tuple(plots)


def _part(table: Table[Row], family: Family, metric: str) -> Table[Row]:
    """The rows of a metric at the conditions of a family, in its order."""
    rows = (
        row
        for condition in family.conditions
        for row in table.rows
        if (row.condition, row.metric) == (condition, metric)
    )
    return replace(table, rows=tuple(rows))
