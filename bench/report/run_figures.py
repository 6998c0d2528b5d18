"""The figures of a run: the rows of its tables as frames, and the files that are drawn of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bench.analysis.comparison import COST, VALUE, milliseconds
from bench.analysis.condition_sweep import FAMILY, place_of
from bench.analysis.paper import PAPER_METRIC, PAPER_NETWORK, SURFACE, Published, network_of
from bench.analysis.run_pairs import Differences
from bench.catalogue.conditions import Family, axis_positions, condition_name, condition_words
from bench.catalogue.methods import COST_VARIANTS, find_setting, role
from bench.catalogue.metrics import FURTHER_METRICS, IMAGE_METRICS, higher_is_better, is_mean
from bench.records.frames import Artifact
from bench.records.job import JobName
from bench.records.record import GROUND_TRUTH
from bench.report.figure import FIGURES, TEXT, save
from bench.report.plots import (
    Styles,
    SweepPanel,
    axis_title,
    dots_figure,
    frontier_figure,
    grouped,
    sweep_figure,
)
from bench.report.sheets import write_classes, write_images, write_thin_parts
from bench.report.styles import HUES, SOFT, MethodStyle, method_styles
from bench.tables.grid import measured, ordered, records, scored_as_blank
from bench.tables.markdown import visible
from bench.tables.quality import quality_cell
from bench.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The headline first; SSIM as the paper has it, which likes a white image, is one among the others.
METRICS = (
    *("ssim-object", "lpips", "silhouette-iou", "fd-views"),
    *("structure", "ssim", "fd-alexnet", "fid"),
    *FURTHER_METRICS,
)
_MOST_STEPS = 8  # conditions or classes beside each other in a panel of half the width
_DODGE = 0.44  # of a step, that the methods of one condition take side by side
_PAD = 0.03  # of an axis: the room of a band beyond its first and last step
_OBJECTS_BEYOND = 2
AHEAD = {  # styles of differences
    "b": ("better", MethodStyle(HUES[0], "o", "-")),
    "a": ("worse", MethodStyle(HUES[1], "s", "-")),
    "tie": ("not decided", MethodStyle(SOFT, "o", "-", "left")),
    "unknown": ("too few objects", MethodStyle(SOFT, "X", "-")),
}


def quality_frame(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of quality, with `text`, the value and its interval as printed."""
    texts = [
        quality_cell(row).text + " ({n_ok} of {n} images)".format(**row) * row["failed"]
        for row in records(rows)
    ]
    names = {"ci_low": "low", "ci_high": "high", "failures_as_blank": "as_blank"}
    return rows.drop(columns="per_object").rename(columns=names).assign(text=texts)


def quality_panels(tables: Sequence[Table]) -> dict[tuple[str, str], SweepPanel]:
    """Return a panel for each metric with values, and for each class, or condition of several.

    The ceiling, settings of a parameter, and methods measured for their cost alone are left out.
    """
    shown = {}
    undrawn = [method.id for method in COST_VARIANTS]
    for metric in METRICS:
        by_table = (table.frame[table.frame["metric"] == metric] for table in tables)
        rows = quality_frame(max(by_table, key=len))
        rows = rows[np.isfinite(rows["value"].astype(float))]
        drawn = [
            role(m) not in ("ceiling", "chosen") and find_setting(m) is None and m not in undrawn
            for m in rows["method"]
        ]
        rows = rows[np.array(drawn, bool)].assign(hollow=rows["failed"])
        by_class = rows["class"].nunique() > 1
        for place, of_place in grouped(rows, "condition" if by_class else "class"):
            shown[metric, place] = quality_panel(metric, of_place, by_class)
    return shown


def quality_panel(metric: str, rows: pd.DataFrame, by_class: bool) -> SweepPanel:
    """Return the panel of a metric: by condition, or of several classes at one by class."""
    step = "class" if by_class else "condition"
    steps = ordered(rows[step])
    positions = [float(i) for i in range(len(steps))] if by_class else axis_positions(steps)
    at = dict(zip(steps, positions, strict=True))
    names = {name: condition_name(name) for name in steps}
    kinds: dict[str, list[float]] = {}
    for name in () if by_class else steps:
        kinds.setdefault(names[name].kind, []).append(at[name])
    hollow = bool(rows["hollow"].any())
    return SweepPanel(
        rows.assign(
            x=rows[step].map(at),
            kind="" if by_class else rows[step].map(lambda name: names[name].kind),
        ),
        title=f"{axis_title(metric)}{f', {condition_words(rows.condition.iloc[0])}' * by_class}",
        x_label="hollow: failed images are left out" * hollow,
        ticks={x: name if by_class else names[name].short for name, x in at.items()},
        kinds={sum(of_kind) / len(of_kind): kind for kind, of_kind in kinds.items()},
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

    `curves` are as `bench.analysis.condition_sweep.condition_curves` returns them.
    """
    curves = curves[[role(method) != "ceiling" for method in curves["method"]]]
    several, names = curves["class"].nunique() > 1, ordered(curves["family"])
    shown = []
    by_row = curves.groupby(["class", "metric"], sort=False)
    for row, ((class_name, metric), of_row) in enumerate(by_row):
        title = axis_title(str(metric)) + f", {class_name}" * several
        for name in names:
            family = FAMILY[name]
            values = curves.loc[curves["family"] == name, "at"].unique()
            at = [place_of(value, family) for value in values]
            shown.append(
                SweepPanel(
                    _curve_frame(of_row[of_row["family"] == name], family),
                    title=family.axis.partition(":")[0] * (row == 0),
                    y_label=title.replace(" (", "\n(") * (name == names[0]),
                    ticks={x: f"{value:g}" for x, value in zip(at, values, strict=True)},
                    turned=not higher_is_better(str(metric)),
                    y_scale="linear" if is_mean(str(metric)) else "distance",
                    trained=_bands(family, at),
                )
            )
    return shown


def _curve_frame(rows: pd.DataFrame, family: Family) -> pd.DataFrame:
    texts = [
        measured(tuple(row[name] for name in VALUE), row["metric"], row["method"]).text
        for row in records(rows)
    ]
    x = [place_of(value, family) for value in rows["at"]]
    return rows.rename(columns={"ci_low": "low", "ci_high": "high"}).assign(x=x, text=texts)


def _bands(family: Family, at: Sequence[float]) -> list[tuple[str, float, float]]:
    """Return where each network was trained; a single value, or the first step, has some width."""
    pad, bands = _PAD * abs(at[-1] - at[0]), []
    for method, *ends in family.trained:
        low, high = sorted(place_of(end, family) for end in ends)
        single = low == high
        low, high = low - pad * (single or low <= min(at)), high + pad * (single or high >= max(at))
        bands.append((method, low, high))
    return bands


def family_figure(shown: Sequence[SweepPanel], styles: Styles, **size: Any) -> Figure:
    """Return metrics along families of conditions: worse clouds to the right."""
    columns = sum(bool(panel.title) for panel in shown)
    size = {"columns": columns, "panel_in": 1.9, "sharey": "row"} | size
    figure = sweep_figure(shown, styles, **size)
    for axis, panel in zip(figure.axes, shown, strict=True):
        at = list(panel.ticks or ())
        pad = 2 * _PAD * (at[-1] - at[0])
        axis.set_xlim(at[0] - pad, at[-1] + pad)  # a falling number of points, too
        if len(at) > 3:
            axis.tick_params(axis="x", labelrotation=60)
    return figure


def described(panel: SweepPanel) -> str:
    """Return the values of a panel in words, for readers who do not see it."""
    by_method = grouped(panel.values, "method")
    return " ".join(f"{m}: {', '.join(p['condition'] + ' ' + p['text'])}." for m, p in by_method)


def _frontier_frame(points: pd.DataFrame) -> pd.DataFrame:
    """Return the points that have a place on axes, which may be logarithmic, and `text` in words.

    The points are as `bench.analysis.frontier.places` returns them. The ceiling has no place; a
    floor has no cost and needs none.
    """
    several = points["class"].nunique() > 1
    drawn = []
    for p in records(points):
        positive = p["metric"] in IMAGE_METRICS or p["value"] > 0
        costs = math.isfinite(p["cost_ms"]) and p["cost_ms"] > 0
        seen = (costs and role(p["method"]) != "ceiling") or role(p["method"]) == "floor"
        if seen and positive and math.isfinite(p["value"]):
            words = condition_words(p["condition"]) + f", {p['class']}" * several
            drawn.append(p | {"panel": words, "text": _text(p)})
    names = dict(
        zip((*COST, *VALUE[1:]), ("cost", "cost_low", "cost_high", "low", "high"), strict=True)
    )
    return pd.DataFrame(drawn, columns=[*points, "panel", "text"]).rename(columns=names)


def _text(place: Mapping[str, Any]) -> str:
    method = place["method"]
    value = measured(tuple(place[name] for name in VALUE), place["metric"], method).text
    if role(method) == "floor":
        return f"{method}: {value}, looks at no cloud"
    verdicts = {
        "frontier": ", on the frontier",
        "below a white image": ", below a white image",
        "claimed": ", cost as claimed",
    }
    verdict = verdicts.get(place["verdict"], "")
    failures = scored_as_blank(place["n_ok"], place["n"])
    cost = f"{milliseconds(place['cost_ms'])} ms"
    return f"{method}: {cost}, {value}{verdict}{f' ({failures})' if failures else ''}"


def cost_figures(points: pd.DataFrame, styles: Styles) -> dict[str, tuple[Figure, str]]:
    """Return a figure of each metric that a method with a cost has a value of, and it in words."""
    figures = {}
    for metric, of_metric in _frontier_frame(points).groupby("metric", sort=False):
        rivals = of_metric[[not role(method) for method in of_metric["method"]]]
        if not rivals.empty:
            views = int(rivals["views"].iloc[0])
            x_label = f"ms for a cloud with {views} view{'s' * (views > 1)}"
            by_panel = grouped(rivals.sort_values("cost"), "panel")
            words = [f"{panel}: {'; '.join(rows['text'])}." for panel, rows in by_panel]
            figures[metric] = frontier_figure(of_metric, styles, x_label), " ".join(words)
    return figures


def write_figures(
    directory: Path, tables: Sequence[Table], artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write robustness curves (after Tables 3 and 4), image grids and a sheet of thin parts.

    The grids are the paper's Figures 1 and 3. `artifacts` are all of the run, ground truths
    included. Nothing is written where all methods have failed.
    """
    if all(name.method == GROUND_TRUTH for name in artifacts):
        return
    folder = directory / FIGURES
    styles = method_styles(ordered(m for table in tables for m in table.frame["method"]))
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
    for metric, (figure, _) in cost_figures(points, styles).items():
        _save_both(figure, folder / ("frontier" if metric == first else f"frontier-{metric}"))


def write_beyond_figures(
    directory: Path, curves: pd.DataFrame, artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write `beyond` (PNG and SVG) and `beyond-pictures.png`.

    The latter has the first view of the first objects, whatever they are, at each condition,
    family after family. `artifacts` are all of the run, ground truths included. Ceiling
    and floors have no image.
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
    cells = [name for name in artifacts if name.condition]
    if not cells:
        return
    folder = directory / FIGURES
    methods = ordered(name.method for name in cells)
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
    ours = f"here: {metric} (lower is better)"
    at = (frame["metric"] == metric) & (frame["condition"] == frame["condition"].iloc[0])
    shown = frame[at & frame["method"].isin([SURFACE, network])]
    values = shown[["class", "method", "value", "ci_low", "ci_high"]]
    dots = [(ours, *row) for row in values.itertuples(index=False, name=None)]
    dots += [
        ("the paper, on ShapeNet: FID", name, method, value, np.nan, np.nan)
        for name in ordered(name for _, name, *_ in dots)
        for method, of_paper in ((SURFACE, SURFACE), (network, PAPER_NETWORK))
        if (value := published.get((name, PAPER_METRIC, "2048", of_paper))) is not None
    ]
    columns = ["panel", "row", "method", "value", "low", "high"]
    return pd.DataFrame(dots, columns=columns).assign(turned=True)


def differences_figure(differences: Differences) -> Figure | None:
    """Return b - a with its interval, better to the right: a panel for each metric.

    A row is a cell: a method, condition and class. Cells without a difference are left out; return
    None where no cell is left.
    """
    cells = differences.cells[differences.cells["difference"].notna()]
    if cells.empty:
        return None
    several = cells["class"].nunique() > 1
    dots = [
        {
            "panel": axis_title(cell["metric"]),
            "turned": not higher_is_better(cell["metric"]),
            "row": ", ".join(
                [
                    *[cell["method_b"]] * (cell["method_a"] == cell["method_b"]),
                    condition_name(cell["condition"]).brief,
                    *[cell["class"]] * several,
                ]
            ),
            "method": AHEAD[cell["ahead"]][0],
            **{"value": cell["difference"], "low": cell["ci_low"], "high": cell["ci_high"]},
        }
        for cell in records(cells)
    ]
    figure = dots_figure(pd.DataFrame(dots), dict(AHEAD.values()), zero=True)
    figure.supxlabel(visible(f"{differences.b} against {differences.a}"), fontsize=TEXT)
    return figure


def write_differences(path: Path, differences: Differences) -> None:
    """Write the figure as PNG and SVG beside each other; `path` is without suffix.

    Raises OSError. Nothing is written where no cell has a difference.
    """
    figure = differences_figure(differences)
    if figure is not None:
        _save_both(figure, path)


def _save_both(figure: Figure, path: Path) -> None:
    for kind in ("png", "svg"):
        save(figure, path.with_name(f"{path.name}.{kind}"))
