"""The figures of a run: the rows of its tables as frames, and the files that are drawn of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bench.analysis.compare import VALUE, milliseconds
from bench.analysis.pairs import Differences
from bench.analysis.paper import PAPER_METRIC, PAPER_NETWORK, SURFACE, Published, network_of
from bench.analysis.sweeps import FAMILY_BY_ID, axis_position
from bench.catalogue.conditions import Family, axis_positions, condition_name, condition_words
from bench.catalogue.methods import COST_VARIANTS, find_setting, role
from bench.catalogue.metrics import FURTHER_METRICS, IMAGE_METRICS, higher_is_better, is_mean
from bench.records.frames import Artifact
from bench.records.job import GROUND_TRUTH, JobName
from bench.report.answer import counted, objects_in_words
from bench.report.plots import (
    FIGURES,
    TEXT,
    Styles,
    SweepPanel,
    axis_title,
    dots_figure,
    frontier_figure,
    grouped,
    save,
    sweep_figure,
)
from bench.report.sheets import write_classes, write_images, write_thin_parts
from bench.report.styles import HUES, SOFT, MethodStyle, method_styles
from bench.tables.grid import Cell, metric_cell, ordered, row_mappings, scored_as_blank
from bench.tables.markdown import visible
from bench.tables.quality import quality_cell
from bench.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The metrics that have a panel, those of the headline first. The paper's SSIM stands further below:
# it is high for a white image.
PLOTTED_METRICS = (
    "ssim-object",
    "lpips",
    "silhouette-iou",
    "fd-views",
    "structure",
    "ssim",
    "fd-alexnet",
    "fid",
    *FURTHER_METRICS,
)
_MOST_STEPS = 8  # conditions or classes in a panel of half the width; more take the whole width
_DODGE = 0.44  # part of a step over which the methods of one condition stand side by side
_PAD = 0.03  # part of an axis by which a band reaches beyond the first and the last step
_OBJECTS_BEYOND = 2  # objects on the sheet of `beyond-training`, which has many conditions
AHEAD = {  # words and style of a difference, by who is ahead
    "b": ("better", MethodStyle(HUES[0], "o", "-")),
    "a": ("worse", MethodStyle(HUES[1], "s", "-")),
    "tie": ("not decided", MethodStyle(SOFT, "D", "-")),
    "unknown": ("too few objects", MethodStyle(SOFT, "X", "-")),
}


def quality_frame(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of quality, with a `title` that says all of a value."""
    titles = []
    for row in row_mappings(rows):
        cell = quality_cell(row)
        text = cell.text
        if row["failed"]:
            text += f" ({row['n_ok']} of {row['n']} images)"
        objects = objects_in_words(row["objects"], row["class"])
        titles.append(_title(row, cell, f"{text}, {objects}"))
    names = {"ci_low": "low", "ci_high": "high", "failures_as_blank": "as_blank"}
    return rows.drop(columns="per_object").rename(columns=names).assign(title=titles)


def _title(row: Mapping[str, Any], cell: Cell, text: str) -> str:
    """Return whose value it is and at which condition, the value as `text`, and its interval."""
    interval = f", 95 % interval {cell.beside}" if cell.interval else ""
    return f"{row['method']}, {condition_words(row['condition'])}: {text}{interval}"


def quality_panels(tables: Sequence[Table]) -> dict[tuple[str, str], SweepPanel]:
    """Return a panel for each metric with values and each class, by metric and class.

    Where a table has several classes there is a panel for each metric and condition. The ceiling,
    settings of a parameter, and methods measured for their cost alone are left out.
    """
    shown = {}
    for metric in PLOTTED_METRICS:
        by_table = (table.frame[table.frame["metric"] == metric] for table in tables)
        rows = quality_frame(max(by_table, key=len))
        rows = rows[np.isfinite(rows["value"].astype(float))]
        left_out = rows["method"].map(_is_left_out)
        rows = rows[~left_out.astype(bool)].assign(hollow=rows["failed"])
        by_class = rows["class"].nunique() > 1
        for name, of_name in grouped(rows, "condition" if by_class else "class"):
            shown[metric, name] = quality_panel(metric, of_name, by_class)
    return shown


def _is_left_out(method: str) -> bool:
    """Return whether panels of quality do not draw a method."""
    if role(method) in ("ceiling", "chosen") or find_setting(method) is not None:
        return True
    return method in [variant.id for variant in COST_VARIANTS]


def quality_panel(metric: str, rows: pd.DataFrame, by_class: bool) -> SweepPanel:
    """Return the panel of a metric.

    by_class  whether rows are of several classes at one condition, and classes stand side by side;
              else rows are of one class, and conditions stand side by side
    """
    title = axis_title(metric)
    kinds: dict[float, str] = {}
    if by_class:
        title += f", {condition_words(rows['condition'].iloc[0])}"
        classes = ordered(rows["class"])
        ticks = {float(number): name for number, name in enumerate(classes)}
        x = rows["class"].map({name: position for position, name in ticks.items()})
        kind: Any = ""
    else:
        conditions = ordered(rows["condition"])
        position_of = dict(zip(conditions, axis_positions(conditions), strict=True))
        names = {condition: condition_name(condition) for condition in conditions}
        ticks = {position_of[condition]: names[condition].short for condition in conditions}
        by_kind: dict[str, list[float]] = {}
        for condition in conditions:
            by_kind.setdefault(names[condition].kind, []).append(position_of[condition])
        # The name of a kind stands in the middle of its conditions.
        kinds = {sum(of_kind) / len(of_kind): name for name, of_kind in by_kind.items()}
        x = rows["condition"].map(position_of)
        kind = rows["condition"].map(lambda condition: names[condition].kind)
    return SweepPanel(
        rows.assign(x=x, kind=kind),
        title=title,
        x_label="hollow: failed images are left out" if rows["hollow"].any() else "",
        ticks=ticks,
        kinds=kinds,
        turned=not higher_is_better(metric),
        joined=not by_class,
        y_scale="linear" if is_mean(metric) else "distance",
    )


def quality_figure(shown: Sequence[SweepPanel], styles: Styles, **size: Any) -> Figure:
    """Return the panels of qualities; those with many steps take the whole width."""
    if any(len(panel.ticks or ()) > _MOST_STEPS for panel in shown):
        size |= {"columns": 1}
    figure = sweep_figure(shown, styles, dodge=_DODGE, **size)
    for axis, panel in zip(figure.axes, shown, strict=True):
        axis.set_xlim(-0.5, max(panel.ticks or (0,)) + 0.5)
        if len(panel.ticks or ()) > _MOST_STEPS:
            axis.tick_params(axis="x", labelrotation=38)
    return figure


def family_panels(curves: pd.DataFrame) -> list[SweepPanel]:
    """Return a panel for each metric and class (down) and family of conditions (across).

    `curves` are as `bench.analysis.sweeps.condition_curves` returns them.
    """
    curves = curves[[role(method) != "ceiling" for method in curves["method"]]]
    several, names = curves["class"].nunique() > 1, ordered(curves["family"])
    shown = []
    by_row = curves.groupby(["class", "metric"], sort=False)
    for row, ((class_name, metric), of_row) in enumerate(by_row):
        metric_title = axis_title(str(metric))
        if several:
            metric_title += f", {class_name}"
        for name in names:
            family = FAMILY_BY_ID[name]
            values = curves.loc[curves["family"] == name, "at"].unique()
            at = [axis_position(value, family) for value in values]
            shown.append(
                SweepPanel(
                    _curve_frame(of_row[of_row["family"] == name], family),
                    title=family.axis.partition(":")[0] if row == 0 else "",
                    y_label=metric_title.replace(" (", "\n(") if name == names[0] else "",
                    ticks={x: f"{value:g}" for x, value in zip(at, values, strict=True)},
                    turned=not higher_is_better(str(metric)),
                    y_scale="linear" if is_mean(str(metric)) else "distance",
                    trained=_bands(family, at),
                )
            )
    return shown


def _curve_frame(rows: pd.DataFrame, family: Family) -> pd.DataFrame:
    """Return the points of a panel, with `title`, what is said of each."""
    cells = [(row, _value_cell(row)) for row in row_mappings(rows)]
    titles = [_title(row, cell, cell.text) for row, cell in cells]
    x = [axis_position(value, family) for value in rows["at"]]
    return rows.rename(columns={"ci_low": "low", "ci_high": "high"}).assign(x=x, title=titles)


def _value_cell(row: Mapping[str, Any]) -> Cell:
    return metric_cell(tuple(row[name] for name in VALUE), row["metric"], row["method"])


def _bands(family: Family, at: Sequence[float]) -> list[tuple[str, float, float]]:
    """Return the band (method, left, right) of the values that each network was trained on.

    A band of a single value has some width, and one up to an end of the axis reaches beyond it.
    """
    pad, bands = _PAD * abs(at[-1] - at[0]), []
    for method, *ends in family.trained:
        low, high = sorted(axis_position(end, family) for end in ends)
        single = low == high
        left = low - pad if single or low <= min(at) else low
        right = high + pad if single or high >= max(at) else high
        bands.append((method, left, right))
    return bands


def family_figure(shown: Sequence[SweepPanel], styles: Styles, **size: Any) -> Figure:
    """Return the panels of families of conditions: worse clouds are to the right."""
    columns = sum(bool(panel.title) for panel in shown)
    size = {"columns": columns, "panel_in": 1.9, "sharey": "row"} | size
    figure = sweep_figure(shown, styles, **size)
    for axis, panel in zip(figure.axes, shown, strict=True):
        at = list(panel.ticks or ())
        pad = 2 * _PAD * (at[-1] - at[0])
        # The steps of a family may fall, as numbers of points do: the axis then runs to the left.
        axis.set_xlim(at[0] - pad, at[-1] + pad)
        if len(at) > 3:
            axis.tick_params(axis="x", labelrotation=60)
    return figure


def _frontier_frame(points: pd.DataFrame) -> pd.DataFrame:
    """Return the points that are drawn, with `panel`, its title, and `title`, what they say.

    points  as `bench.analysis.frontier.frontier_verdicts` returns them

    Axes may be logarithmic: costs and distances that are not over 0 are left out, and so is the
    ceiling. A floor has no cost and is drawn as a line.
    """
    several = points["class"].nunique() > 1
    drawn = []
    for point in row_mappings(points):
        if not _is_drawn(point):
            continue
        title = condition_words(point["condition"])
        if several:
            title += f", {point['class']}"
        drawn.append(
            point | {"panel": title, "title": _title(point, _value_cell(point), _text(point))}
        )
    names = {
        "cost_ms": "cost",
        "cost_ci_low": "cost_low",
        "cost_ci_high": "cost_high",
        "ci_low": "low",
        "ci_high": "high",
    }
    return pd.DataFrame(drawn, columns=[*points, "panel", "title"]).rename(columns=names)


def _is_drawn(point: Mapping[str, Any]) -> bool:
    """Return whether a point can stand on the axes of quality and cost."""
    if not math.isfinite(point["value"]):
        return False
    if point["metric"] not in IMAGE_METRICS and point["value"] <= 0:
        return False  # the axis of distances is logarithmic
    if role(point["method"]) == "floor":
        return True
    has_cost = math.isfinite(point["cost_ms"]) and point["cost_ms"] > 0
    return has_cost and role(point["method"]) != "ceiling"


def _text(point: Mapping[str, Any]) -> str:
    """Return the cost and the value of a point in words."""
    value = _value_cell(point).text
    images = scored_as_blank(point["n_ok"], point["n"]) or counted(point["n"], "image")
    if role(point["method"]) == "floor":
        return f"{value}, looks at no cloud, {images}"
    verdicts = {
        "frontier": ", on the frontier",
        "below a white image": ", below a white image",
        "claimed": ", cost as claimed",
    }
    verdict = verdicts.get(point["verdict"], "")
    return f"{milliseconds(point['cost_ms'])} ms, {value}{verdict}, {images}"


def cost_figures(points: pd.DataFrame, styles: Styles) -> dict[str, Figure]:
    """Return by metric the figure of quality against cost.

    A metric has no figure where no method that competes has a cost and a value.
    """
    figures = {}
    for metric, of_metric in _frontier_frame(points).groupby("metric", sort=False):
        rivals = of_metric[[not role(method) for method in of_metric["method"]]]
        if not rivals.empty:
            views = int(rivals["views"].iloc[0])
            x_label = f"ms for a cloud with {counted(views, 'view')}"
            figures[metric] = frontier_figure(of_metric, styles, x_label)
    return figures


def write_figures(
    directory: Path, tables: Sequence[Table], artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write robustness curves (after Tables 3 and 4), image grids and a sheet of thin parts.

    The grids are after the paper's Figures 1 and 3. `artifacts` are all images of the run, the true
    ones included. Nothing is written where all methods have failed.
    """
    if all(name.method == GROUND_TRUTH for name in artifacts):
        return
    folder = directory / FIGURES
    methods = pd.concat([table.frame["method"] for table in tables])
    styles = method_styles(ordered(methods))
    if shown := list(quality_panels(tables).values()):
        _save_both(quality_figure(shown, styles), folder / "robustness")
    conditions = ordered(name.condition for name in artifacts if name.condition)
    write_images(folder / "pictures.png", artifacts, conditions)
    write_thin_parts(folder / "thin-parts.png", artifacts)


def write_frontier(folder: Path, points: pd.DataFrame) -> None:
    """Write a figure for each metric, as PNG and SVG.

    The files of the first metric are named `frontier`, others `frontier-METRIC`. A metric without
    a value of any candidate gets no figure.
    """
    styles = method_styles(ordered(points["method"]))
    first = next(iter(points["metric"]), "")
    for metric, figure in cost_figures(points, styles).items():
        _save_both(figure, folder / ("frontier" if metric == first else f"frontier-{metric}"))


def write_beyond_figures(
    directory: Path, curves: pd.DataFrame, artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write `beyond` (PNG and SVG) and `beyond-pictures.png`.

    The latter has the first view of the first objects, whatever they are, at each condition,
    family after family, drawn by all methods that compete. `artifacts` are all images of the run,
    the true ones included.
    """
    folder = directory / FIGURES
    styles = method_styles(ordered(curves["method"]))
    _save_both(family_figure(family_panels(curves), styles), folder / "beyond")
    conditions = ordered(curves["condition"])
    write_images(folder / "beyond-pictures.png", artifacts, conditions, _OBJECTS_BEYOND)


def write_class_figures(
    directory: Path,
    table: Table,
    headline: Table,
    published: Published,
    artifacts: Mapping[JobName, Artifact],
) -> None:
    """Write `classes.png` (the paper's Figure 4) and `table5`, SR against pc2pix class by class.

    `artifacts` are all images, ground truths included. Without pc2pix or without SR there is no
    second figure; where all methods have failed, none.
    """
    drawn = [name for name in artifacts if name.condition]  # ground truths have no condition
    if not drawn:
        return
    folder = directory / FIGURES
    methods = ordered(name.method for name in drawn)
    write_classes(folder / "classes.png", headline.frame, artifacts)
    network = network_of(methods)
    if network is not None and SURFACE in methods:
        dots = _paper_dots(table.frame, network, published)
        if not dots.empty:
            figure = dots_figure(dots, method_styles((SURFACE, network)))
            _save_both(figure, folder / "table5")


def _paper_dots(frame: pd.DataFrame, network: str, published: Published) -> pd.DataFrame:
    """Return the distances of SR and the network by class: ours with intervals, and the paper's."""
    finite = {*frame.loc[np.isfinite(frame["value"]), "metric"]}
    metric = next((m for m in (PAPER_METRIC, "fd-views") if m in finite), None)
    is_shown = (frame["metric"] == metric) & (frame["condition"] == frame["condition"].iloc[0])
    shown = frame[is_shown & frame["method"].isin([SURFACE, network])]
    ours = shown[["class", "method", "value", "ci_low", "ci_high"]].rename(
        columns={"class": "row", "ci_low": "low", "ci_high": "high"}
    )
    ours.insert(0, "panel", f"here: {metric} (lower is better)")
    of_paper = []
    for class_name in ordered(ours["row"]):
        for method, published_as in ((SURFACE, SURFACE), (network, PAPER_NETWORK)):
            value = published.get((class_name, PAPER_METRIC, "2048", published_as))
            if value is not None:
                of_paper.append(
                    {
                        "panel": "the paper, on ShapeNet: FID",
                        "row": class_name,
                        "method": method,
                        "value": value,
                        "low": np.nan,
                        "high": np.nan,
                    }
                )
    dots = [*row_mappings(ours), *of_paper]
    return pd.DataFrame(dots, columns=[*ours.columns]).assign(turned=True)


def differences_figure(differences: Differences) -> Figure | None:
    """Return b - a with its interval, better to the right: a panel for each metric.

    A row is a condition, with the class where there are several, and the method where it is the
    same on both sides. Rows without a difference are left out; None where no row is left.
    """
    rows = differences.rows[differences.rows["difference"].notna()]
    if rows.empty:
        return None
    several = rows["class"].nunique() > 1
    dots = []
    for row in row_mappings(rows):
        name = [condition_name(row["condition"]).brief]
        if row["method_a"] == row["method_b"]:
            name.insert(0, row["method_b"])
        if several:
            name.append(row["class"])
        words, _ = AHEAD[row["ahead"]]
        dots.append(
            {
                "panel": axis_title(row["metric"]),
                "turned": not higher_is_better(row["metric"]),
                "row": ", ".join(name),
                "method": words,
                "value": row["difference"],
                "low": row["ci_low"],
                "high": row["ci_high"],
            }
        )
    figure = dots_figure(pd.DataFrame(dots), dict(AHEAD.values()), zero=True)
    figure.supxlabel(visible(f"{differences.b} against {differences.a}"), fontsize=TEXT)
    return figure


def write_differences(path: Path, differences: Differences) -> None:
    """Write the figure as PNG and SVG beside each other; `path` is without suffix.

    Raises OSError. Nothing is written where no row has a difference.
    """
    figure = differences_figure(differences)
    if figure is not None:
        _save_both(figure, path)


def _save_both(figure: Figure, path: Path) -> None:
    for kind in ("png", "svg"):
        save(figure, path.with_name(f"{path.name}.{kind}"))
