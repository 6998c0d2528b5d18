"""The figures of the result pages, drawn from `results/docs` as those of a run are.

    python -m studies.figures [NAME ...] [-o docs] [--format png]

All are 800 pixels wide, and better is up or to the right.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from bench.analysis.condition_sweep import condition_curves
from bench.analysis.paper import AVERAGE
from bench.catalogue.chosen import CHOSEN, cost_of, measured_methods
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import higher_is_better
from bench.report.figure import TEXT, save
from bench.report.plots import axis_title, dots_figure, frontier_figure
from bench.report.run_figures import family_figure, family_panels, quality_figure, quality_panel
from bench.report.styles import method_styles
from studies.documents import NUMBERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METRICS = ("ssim-object", "lpips")
CONDITIONS = ("2048", "1024", "512", "noise-0.05", "noise-0.10")


def read(file: str, methods: Sequence[str] = (), **wanted: object) -> pd.DataFrame:
    """Return the rows of a file of results that have the wanted values, by method if any."""
    rows = pd.read_csv(NUMBERS / file, dtype={"condition": str})
    rows = rows.rename(columns={"ci_low": "low", "ci_high": "high", "method_b": "method"})
    for name, value in wanted.items():
        rows = rows[rows[name] == value]
    if not methods:
        return rows
    places = rows["method"].map({method: place for place, method in enumerate(methods)})
    return rows[places.notna()].assign(place=places).sort_values("place", kind="stable")


def _draw_conditions(file: str, methods: Sequence[str]) -> Figure:
    """Draw two metrics against the conditions, with a gap between points and noise."""
    shown = []
    for metric in METRICS:
        rows = read(file, methods, metric=metric)
        rows = rows[(rows["class"] == "chair") & rows["condition"].isin(CONDITIONS)]
        rows = rows.sort_values("condition", key=lambda c: c.map(CONDITIONS.index), kind="stable")
        rows = rows.sort_values("place", kind="stable")
        shown.append(quality_panel(metric, rows.assign(hollow=False), by_class=False))
    return quality_figure(shown, method_styles(methods), panel_in=3.0)


def _draw_classes(file: str, methods: Sequence[str]) -> Figure:
    """Draw differences of methods to the best classical method by class, so that right is better.

    `file` has their comparisons. A hollow point is not decided.
    """
    dots = pd.concat(
        read(file, methods, metric=metric, condition="2048").assign(
            panel=axis_title(metric), turned=not higher_is_better(metric)
        )
        for metric in METRICS
    )
    hollow = ~dots["ahead"].isin(["a", "b"])
    dots = dots.assign(row=dots["class"], value=dots["difference"], hollow=hollow)
    figure = dots_figure(dots, method_styles(methods), zero=True)
    figure.supxlabel("difference to the best classical method", fontsize=TEXT)
    return figure


def _draw_paper_classes(file: str, metric: str, methods: Sequence[str]) -> Figure:
    """Draw a distance by class beside the FID of the paper, so that right is better."""
    ours, paper = read(file, methods, metric=metric), read(file, methods, metric="fid")
    dots = pd.concat(
        (
            ours.assign(panel=f"here: {axis_title(metric)}"),
            paper.assign(panel="the paper, on ShapeNet: FID", value=paper["paper"]),
        )
    )
    dots = dots.drop(columns=["low", "high"]).assign(row=dots["class"], turned=True)
    return dots_figure(dots, method_styles(methods))


def _draw_costs() -> Figure:
    """Draw quality on real meshes against the cost of one view, with the frontier."""
    costs = measured_methods()
    panels = []
    for metric in ("lpips", "ssim"):
        rows = read("real-meshes-grey.csv", metric=metric, condition="2048")
        rows = rows[(rows["class"] == AVERAGE) & ~rows["method"].isin(CHOSEN)]
        cost = [cost_of(method, costs) for method in rows["method"]]
        rows = rows.assign(cost=[c.one_view_ms if c else math.nan for c in cost], verdict="")
        rows = rows.dropna(subset="cost").sort_values("cost").assign(panel=axis_title(metric))
        usable = rows[rows["method"].map(role) == ""]
        value = usable["value"] if higher_is_better(metric) else -usable["value"]
        best = usable.index[value == value.cummax()]
        rows.loc[best, "verdict"] = "frontier"
        panels.append(rows.assign(cost_low=rows["cost"], cost_high=rows["cost"]))
    frame = pd.concat(panels)
    names = list(dict.fromkeys(frame["method"]))
    label = "milliseconds for one view of a new cloud"
    return frontier_figure(frame, method_styles(names), label, named=names)


def _draw_families(file: str, methods: Sequence[str]) -> Figure:
    """Draw metrics along each family of conditions, worse clouds to the right."""
    values = pd.concat(read(file, methods, metric=metric) for metric in METRICS)
    curves = condition_curves(values.rename(columns={"low": "ci_low", "high": "ci_high"}))
    return family_figure(family_panels(curves), method_styles(methods))


CHAIR = "splat-net@chair"
OTHERS = ("best-classical", "pc2pix", "surface-apss", FLOOR)
KNOWN = (CHAIR, "splat-net", "fused-net", *OTHERS)
REAL = ("fused-net@grey", "splat-net@grey")
_BEYOND = (CHAIR, "pc2pix", "surface-apss", FLOOR)
FIGURES: Mapping[str, Callable[[], Figure]] = {
    "known-chairs": partial(_draw_conditions, "sealed.csv", KNOWN),
    "novel-families-curves": partial(_draw_conditions, "novel-families.csv", (CHAIR, *OTHERS)),
    "real-chairs-curves": partial(
        _draw_conditions, "real-meshes-grey.csv", (*REAL, "occupancy-net", *OTHERS)
    ),
    "real-meshes": partial(_draw_classes, "real-meshes-grey-differences.csv", REAL),
    "thirteen-classes": partial(_draw_classes, "thirteen-classes-differences.csv", REAL),
    "table5": partial(
        _draw_paper_classes, "thirteen-classes.csv", "fd-views", ("surface-apss", "pc2pix@all")
    ),
    "beyond": partial(_draw_families, "beyond-networks.csv", _BEYOND),
    "trade": _draw_costs,
}


def main() -> None:
    """Draw all figures, or those that are named."""
    parser = argparse.ArgumentParser(description="Figures of the result pages.")
    parser.add_argument("names", nargs="*", choices=[[], *FIGURES], metavar="NAME")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"))
    parser.add_argument("--format", choices=["png", "svg", "pdf"], default="png")
    options = parser.parse_args()
    for name in options.names or FIGURES:
        save(FIGURES[name](), options.out / f"{name}.{options.format}")


if __name__ == "__main__":
    main()
