"""The figures of the result pages, drawn from `results/docs`.

    python -m studies.figures [NAME ...] [-o docs] [--format png]

All are 800 pixels wide, with text of at least 8 points, and better is up or to the right. What a
white image would have scored, or less, is shaded. Colours and markers are those of every plot.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.catalogue.conditions import FAMILIES
from bench.catalogue.methods import known_method
from bench.catalogue.metrics import higher_is_better
from bench.report.figure import drawing, name_lines, panels, save
from bench.report.styles import RULE, SOFT, MethodStyle, method_styles
from studies.documents import read_lines
from studies.plot_parts import (
    DPI,
    FLOOR,
    SHADE,
    SMALL_PT,
    TEXT_PT,
    WIDTH_IN,
    label_of,
    legend,
    number,
    point,
    tidy,
    title_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DODGE = 0.09  # of a step, between neighbouring methods
# The gap between points and noise: the two are no steps of one axis.
CONDITION_PLACES = {"2048": 0.0, "1024": 1.0, "512": 2.0, "noise-0.05": 3.6, "noise-0.10": 4.6}
CONDITION_TICKS = ("2,048", "1,024\npoints", "512", "5 %", "10 %")
NOISE_MIDDLE = 4.1
CHAIR = "splat-net@chair"
SHARES = ("outliers", "noise", "missing")
CLASSES = (
    *("airplane", "bench", "cabinet", "car", "chair", "display", "lamp", "loudspeaker", "rifle"),
    *("sofa", "table", "telephone", "vessel"),
)

Series = Mapping[str, Sequence[tuple[float, float, float, float]]]  # by method: x, value, low, high


def draw_series(axis: Any, series: Series, styles: Mapping[str, MethodStyle], metric: str) -> None:
    """Draw a line for each method, with intervals, so that up is better; shade what is below blank.

    A floor is a dashed line without intervals. Lines do not cross the gap of the axis.
    """
    for place, (method, points) in enumerate(series.items()):
        style = styles[method]
        shift = DODGE * (place - (len(series) - 1) / 2) if style.marker else 0.0
        for start, end in _without_gaps([x for x, *_ in points]):
            part = points[start:end]
            x = [at + shift for at, *_ in part]
            first = {"label": label_of(method)} if start == 0 else {}
            values = [value for _, value, *_ in part]
            axis.plot(x, values, linestyle=style.dashes, linewidth=1.3, **point(style), **first)
            if style.marker:
                lows, highs = [low for *_, low, _ in part], [high for *_, high in part]
                axis.vlines(x, lows, highs, color=style.colour, linewidth=0.9)
    _shade_floor(axis, series, metric)
    axis.set_title(title_of(metric), fontsize=TEXT_PT + 1)
    tidy(axis)


def _without_gaps(places: Sequence[float]) -> list[tuple[int, int]]:
    """Return the ranges of neighbours that are at most one step apart."""
    cuts = [i for i, (left, right) in enumerate(pairwise(places), 1) if 1 < right - left < 2]
    ends = [0, *cuts, len(places)]
    return list(pairwise(ends))


def _shade_floor(axis: Any, series: Series, metric: str) -> None:
    """Turn the axis so that up is better, and shade what is worse than a white image."""
    if not higher_is_better(metric):
        axis.invert_yaxis()
    worst, _ = axis.get_ylim()
    blank = [value for _, value, *_ in series.get(FLOOR, ())]
    if blank:
        axis.axhspan(worst, blank[0], **SHADE)
        axis.set_ylim(bottom=worst)


def condition_series(
    files: Iterable[str], methods: Iterable[str], metric: str, class_name: str
) -> Series:
    """Return the values of methods at the conditions that the files have."""
    lines = read_lines(files, {"metric": metric, "class": class_name})
    series = {}
    for method in methods:
        of_method = {line["condition"]: line for line in lines if line["method"] == method}
        series[method] = [
            (place, *(number(of_method[condition][end]) for end in ("value", "ci_low", "ci_high")))
            for condition, place in CONDITION_PLACES.items()
            if condition in of_method
        ]
    return series


@drawing()
def draw_conditions(
    files: Sequence[str],
    methods: Sequence[str],
    metrics: Sequence[str] = ("ssim-object", "lpips"),
    class_name: str = "chair",
) -> Figure:
    """Draw two metrics against the conditions, with a gap between points and noise."""
    figure, axes = panels(1, len(metrics), (WIDTH_IN, 3.6))
    styles = method_styles(methods)
    for axis, metric in zip(axes[0], metrics, strict=True):
        series = condition_series(files, methods, metric, class_name)
        draw_series(axis, series, styles, metric)
        axis.set_xticks(list(CONDITION_PLACES.values()), CONDITION_TICKS)
        axis.set_xticks([NOISE_MIDDLE], ["\nnoise (of the radius)"], minor=True)
        axis.tick_params(which="minor", labelsize=SMALL_PT, length=0)
        axis.set_xlim(-0.45, 5.05)
    legend(figure, axes[0][0])
    return figure


@drawing()
def draw_classes(
    file: str,
    methods: Sequence[str],
    condition: str,
    metrics: Sequence[str] = ("ssim-object", "lpips"),
) -> Figure:
    """Draw differences of methods to the best reconstruction by class, so that right is better.

    `file` has their comparisons. A hollow point is not decided.
    """
    figure, axes = panels(1, len(metrics), (WIDTH_IN, 5.2), sharey=True)
    styles = method_styles(methods)
    rows = {name: float(place) for place, name in enumerate((*CLASSES, "all"))}
    rows["all"] += 0.5  # beyond a line
    for axis, metric in zip(axes[0], metrics, strict=True):
        for number_of, method in enumerate(methods):
            shift = 0.3 * (number_of - (len(methods) - 1) / 2)
            wanted = {"metric": metric, "condition": condition, "method_b": method}
            _draw_class_points(axis, read_lines([file], wanted), rows, shift, styles[method])
            axis.plot([], [], linestyle="none", label=method, **point(styles[method]))
        axis.axvline(0, color=SOFT, linewidth=1)
        axis.axhline(len(CLASSES) - 0.25, color=RULE, linewidth=0.8)
        if not higher_is_better(metric):
            axis.invert_xaxis()
        worst, best = axis.get_xlim()
        axis.axvspan(worst, 0, **SHADE)
        axis.set_xlim(worst, best)
        axis.set_title(title_of(metric), fontsize=TEXT_PT + 1)
        below = {"fontsize": TEXT_PT, "va": "top", "transform": axis.get_xaxis_transform()}
        axis.text(0, -0.06, "\N{LEFTWARDS ARROW} behind ", ha="right", **below)
        axis.text(0, -0.06, " ahead \N{RIGHTWARDS ARROW}", ha="left", **below)
        tidy(axis, "x")
    axes[0][0].set_yticks(list(rows.values()), list(rows))
    axes[0][0].set_ylim(rows["all"] + 0.6, -0.6)
    figure.supxlabel("difference to the best reconstruction", fontsize=TEXT_PT)
    legend(figure, axes[0][0])
    return figure


def _draw_class_points(
    axis: Any,
    lines: Iterable[Mapping[str, str]],
    rows: Mapping[str, float],
    shift: float,
    style: MethodStyle,
) -> None:
    for line in lines:
        y, value = rows[line["class"]] + shift, number(line["difference"])
        low, high = number(line["ci_low"]), number(line["ci_high"])
        if not math.isnan(low):
            axis.plot([low, high], [y, y], color=style.colour, linewidth=0.9)
        hollow = line["ahead"] not in ("a", "b")
        axis.plot(value, y, linestyle="none", **point(style, hollow=hollow))


@drawing()
def draw_paper_classes(file: str, ours: str, methods: Sequence[str]) -> Figure:
    """Draw a distance by class beside the FID of the paper, so that right is better."""
    figure, axes = panels(1, 2, (WIDTH_IN, 4.8), sharey=True)
    styles = method_styles(methods)
    rows = {name: float(place) for place, name in enumerate((*CLASSES, "average"))}
    rows["average"] += 0.5
    of_panels = ((axes[0][0], ours, "value"), (axes[0][1], "fid", "paper"))
    for axis, metric, shown in of_panels:
        values = {
            (line["method"], line["class"]): number(line[shown])
            for line in read_lines([file], {"metric": metric})
        }
        places = list(rows.values())
        drawn = [[values[method, name] for name in rows] for method in methods]
        axis.hlines(places, *drawn, color=RULE, linewidth=3, zorder=1)
        for method, x in zip(methods, drawn, strict=True):
            axis.plot(x, places, linestyle="none", label=method, **point(styles[method]))
        axis.axhline(len(CLASSES) - 0.25, color=RULE, linewidth=0.8)
        axis.set_xlim(left=0)
        axis.invert_xaxis()
        tidy(axis, "both")
    axes[0][0].set_title(f"here: {title_of(ours)}", fontsize=TEXT_PT + 1)
    axes[0][1].set_title("the paper, on ShapeNet: FID (less is better)", fontsize=TEXT_PT + 1)
    axes[0][0].set_yticks(list(rows.values()), list(rows))
    axes[0][0].set_ylim(rows["average"] + 0.6, -0.6)
    legend(figure, axes[0][0])
    return figure


@drawing()
def draw_frontier(methods: Sequence[str], metrics: Sequence[str] = ("lpips", "ssim")) -> Figure:
    """Draw quality against cost at three conditions; steps are the frontier, small dots settings.

    The frontier is that of all settings of the methods that there are.
    """
    conditions = {"2048": "2,048 points", "512": "512 points", "noise-0.05": "noise 5 %"}
    figure, axes = panels(len(metrics), len(conditions), (WIDTH_IN, 5.2), sharex=True, sharey="row")
    for axis_row, metric in zip(axes, metrics, strict=True):
        for axis, (condition, title) in zip(axis_row, conditions.items(), strict=True):
            wanted = {"metric": metric, "condition": condition, "views": "20"}
            lines = read_lines(["frontier.csv"], wanted)
            known = [line for line in lines if known_method(line["method"])]
            _draw_costs(axis, known, methods, higher_is_better(metric))
            if metric == metrics[0]:
                axis.set_title(title, fontsize=TEXT_PT + 1)
        if not higher_is_better(metric):
            axis_row[0].invert_yaxis()
        for axis in axis_row:
            worst = axis_row[0].get_ylim()[0]
            axis.axhspan(worst, axis.get_lines()[0].get_ydata()[0], **SHADE)
            axis.set_ylim(bottom=worst)
        axis_row[0].set_ylabel(title_of(metric), fontsize=TEXT_PT)
    for axis in axes[-1]:
        axis.set_xlabel("milliseconds for 20 views", fontsize=TEXT_PT)
    legend(figure, axes[0][0])
    return figure


def _draw_costs(
    axis: Any, lines: Sequence[Mapping[str, str]], methods: Sequence[str], higher: bool
) -> None:
    (blank,) = (number(line["value"]) for line in lines if line["method"] == FLOOR)
    axis.axhline(blank, color=SOFT, linestyle="--", linewidth=1, label=label_of(FLOOR))
    competing = [line for line in lines if line["verdict"] != "reference"]
    cost, value = (np.array([number(line[n]) for line in competing]) for n in ("cost_ms", "value"))
    quality = value - blank if higher else blank - value
    # Of those that are shown, which are not all of whom the run had.
    beaten = (cost[:, None] <= cost) & (quality[:, None] >= quality)
    beaten &= (cost[:, None] < cost) | (quality[:, None] > quality)
    best = sorted(np.flatnonzero(~beaten.any(axis=0) & (quality >= 0)), key=lambda i: cost[i])
    axis.step(cost[best], value[best], where="post", color=SOFT, linewidth=1)
    styles = method_styles(line["method"] for line in competing)
    for line in sorted(competing, key=lambda line: line["method"] in methods):
        named = line["method"] in methods
        x, y = number(line["cost_ms"]), number(line["value"])
        axis.plot(x, y, linestyle="none", **point(styles[line["method"]], 6.0 if named else 2.2))
    for method in methods:
        axis.plot([], [], linestyle="none", label=method, **point(styles[method], 6.0))
    axis.set_xscale("log")
    axis.set_xticks([10, 100, 1000], ["10", "100", "1,000"])
    axis.minorticks_off()
    tidy(axis, "both")


@drawing()
def draw_families(
    file: str, methods: Sequence[str], metrics: Sequence[str] = ("ssim-object", "lpips")
) -> Figure:
    """Draw metrics along each family of conditions, worse clouds to the right."""
    figure, axes = panels(len(metrics), len(FAMILIES), (WIDTH_IN, 4.6), sharex="col", sharey="row")
    styles = method_styles(methods)
    for axis_row, metric in zip(axes, metrics, strict=True):
        lines = read_lines([file], {"metric": metric})
        values = {(line["method"], line["condition"]): line for line in lines}
        for axis, family in zip(axis_row, FAMILIES, strict=True):
            for method in methods:
                y = [number(values[method, c]["value"]) for c in family.conditions]
                style = styles[method]
                line_style = {
                    "linestyle": style.dashes,
                    "linewidth": 1.3,
                    "label": label_of(method),
                }
                axis.plot(range(len(y)), y, **point(style, 4.5), **line_style)
            ticks = [
                f"{100 * value:g}" if family.id in SHARES else f"{value:,g}"
                for value in family.values
            ]
            axis.set_xticks(range(len(ticks)), ticks)
            tidy(axis)
            axis.tick_params(axis="x", labelrotation=60 if len(ticks) > 4 else 0)
        if not higher_is_better(metric):
            axis_row[0].invert_yaxis()
        worst = axis_row[0].get_ylim()[0]
        blank = number(values[FLOOR, "2048"]["value"])
        for axis in axis_row:
            axis.axhspan(worst, blank, **SHADE)
            axis.set_ylim(bottom=worst)
        axis_row[0].set_ylabel(title_of(metric), fontsize=SMALL_PT)
    titles = ("points", "noise, %", "outliers, %", "missing, %", "density, n : 1")
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=TEXT_PT + 1)
    legend(figure, axes[0][0])
    return figure


@drawing()
def draw_view_costs(methods: Sequence[str]) -> Figure:
    """Draw the time of an image by the number of views of its cloud; here down is better."""
    figure, ((axis,),) = panels(1, 1, (WIDTH_IN, 3.4))
    lines = read_lines(["amortised.csv"], {"threads": "1"})
    styles, drawn = method_styles(methods), []
    for method in methods:
        of_method = [line for line in lines if line["method"] == method]
        x, y = ([number(line[name]) for line in of_method] for name in ("views", "wall_ms"))
        style = styles[method]
        drawn += axis.plot(
            x, y, linestyle=style.dashes, linewidth=1.3, label=method, **point(style)
        )
    axis.set(xscale="log", yscale="log")
    axis.set_xticks([1, 2, 5, 10, 20, 50, 100, 500], [*"125", "10", "20", "50", "100", "500"])
    axis.minorticks_off()
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_xlabel("views of a cloud", fontsize=TEXT_PT)
    axis.set_ylabel("milliseconds an image (less is better)", fontsize=TEXT_PT)
    tidy(axis, "both")
    name_lines(axis, drawn, 1.02, apart=0.075, fontsize=TEXT_PT)
    return figure


OTHERS = ("best-reconstruction", "pc2pix", "surface-apss", FLOOR)
CHAIR_METHODS = (CHAIR, "splat-net", "fused-net", *OTHERS)
NOVEL_METHODS = (CHAIR, *OTHERS)
REAL_METHODS = ("fused-net@grey", "splat-net@grey", "occupancy-net", *OTHERS)
FIGURES: Mapping[str, Callable[[], Figure]] = {
    "known-chairs": partial(draw_conditions, ["sealed.csv"], CHAIR_METHODS),
    "novel-families-curves": partial(draw_conditions, ["novel-families.csv"], NOVEL_METHODS),
    "real-chairs-curves": partial(draw_conditions, ["real-meshes-grey.csv"], REAL_METHODS),
    "real-meshes": partial(
        draw_classes,
        "real-meshes-grey-differences.csv",
        ["fused-net@grey", "splat-net@grey"],
        "2048",
    ),
    "thirteen-classes": partial(
        draw_classes,
        "thirteen-classes-differences.csv",
        ["fused-net@grey", "splat-net@grey"],
        "2048",
    ),
    "table5": partial(
        draw_paper_classes, "thirteen-classes.csv", "fd-views", ["surface-apss", "pc2pix@all"]
    ),
    "frontier": partial(
        draw_frontier,
        [
            *(CHAIR, "pc2pix", "surface-bpa"),
            *("surface-fit", "surface-apss", "splat"),
        ],
    ),
    "beyond": partial(
        draw_families, "beyond-networks.csv", [CHAIR, "pc2pix", "surface-apss", FLOOR]
    ),
    "amortised": partial(
        draw_view_costs, ["surface-apss", "surface-fit", "pc2pix", "pc2pix@paper", CHAIR]
    ),
}


def main() -> None:
    """Draw all figures, or those that are named."""
    parser = argparse.ArgumentParser(description="Figures of the result pages.")
    parser.add_argument("names", nargs="*", choices=[[], *FIGURES], metavar="NAME")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"))
    parser.add_argument("--format", choices=["png", "svg", "pdf"], default="png")
    options = parser.parse_args()
    for name in options.names or FIGURES:
        save(FIGURES[name](), options.out / f"{name}.{options.format}", dpi=DPI)


if __name__ == "__main__":
    main()
