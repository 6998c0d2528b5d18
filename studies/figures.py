"""The images of the pages: figures of the numbers in `results/docs`, and sheets of objects.

    python -m studies.figures [NAME ...] [--meshes PATH [--scan FILE]] [-o docs]

Figures are drawn as those of a run; better is up or to the right. Sheets show what methods draw of
objects. The sheets `real-objects`, `dense-and-scanned` and `scans` need the folder of real meshes
PATH (docs/datasets.md has its checksum), and are left out without it. `answer` needs a scan as
well: FILE is potree/potree@1f37cd39:pointclouds/lion_takanawa.copc.laz. All images are 1,600 pixels
wide, twice the width of a page, and can be read at a quarter of that.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from bench.analysis.paper import AVERAGE
from bench.analysis.sweeps import condition_curves
from bench.catalogue.chosen import CHOSEN, cost_of, measured_methods
from bench.catalogue.methods import FLOOR, role
from bench.catalogue.metrics import higher_is_better
from bench.report.plots import axis_title, dots_figure, frontier_figure, save
from bench.report.run_figures import family_figure, family_panels, quality_figure, quality_panel
from bench.report.styles import method_styles
from studies.documents import NUMBERS
from studies.sheets import (
    ANSWER,
    COLOURED,
    FURTHER,
    OF_FURTHER,
    REAL,
    SCANNED,
    draw_answer,
    draw_coloured,
    draw_objects,
    draw_path,
    draw_scans,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 440  # pixels in an inch
_WIDTH_IN = 1600 / DPI  # width of all images, in inches
_SMALL = 6.0  # size of the text, in points
METRIC, OTHER_METRIC = "lpips", "ssim-object"  # the metrics that figures show
CONDITIONS = ("2048", "1024", "512", "noise-0.05", "noise-0.10")  # from left to right


def read(file: str, methods: Sequence[str] = (), **wanted: object) -> pd.DataFrame:
    """Return rows of a file in `results/docs`.

    methods  only these, sorted in their order, whose number is the column "place"; all and unsorted
             if there are none
    wanted   values that the rows must have, by column
    """
    rows = pd.read_csv(NUMBERS / file, dtype={"condition": str})
    rows = rows.rename(columns={"ci_low": "low", "ci_high": "high", "method_b": "method"})
    for name, value in wanted.items():
        rows = rows[rows[name] == value]
    if not methods:
        return rows
    places = rows["method"].map({method: place for place, method in enumerate(methods)})
    return rows[places.notna()].assign(place=places).sort_values("place", kind="stable")


def _draw_conditions(file: str, methods: Sequence[str]) -> Figure:
    """Return a figure of two metrics of methods on chairs, at each of CONDITIONS."""
    shown = []
    for metric in (METRIC, OTHER_METRIC):
        rows = read(file, methods, metric=metric)
        rows = rows[(rows["class"] == "chair") & rows["condition"].isin(CONDITIONS)]
        # By method, and each method's rows in the order of the conditions.
        rows = rows.sort_values("condition", key=lambda c: c.map(CONDITIONS.index), kind="stable")
        rows = rows.sort_values("place", kind="stable")
        shown.append(quality_panel(metric, rows.assign(hollow=False), by_class=False))
    size = {"columns": 1, "width_in": _WIDTH_IN, "panel_in": 1.9, "fontsize": _SMALL}
    return quality_figure(shown, method_styles(methods), **size)


def _draw_classes(file: str, methods: Sequence[str]) -> Figure:
    """Return a figure of the differences of methods from the best classical method, by class.

    Right is better. A point is hollow where the comparison is not decided.

    file  of the comparisons
    """
    dots = read(file, methods, metric=METRIC, condition="2048")
    dots = dots.assign(
        panel=axis_title(METRIC),
        row=dots["class"],
        value=dots["difference"],
        hollow=~dots["ahead"].isin(["a", "b"]),
        turned=not higher_is_better(METRIC),
    )
    size = {"width_in": _WIDTH_IN, "fontsize": _SMALL}
    figure = dots_figure(dots, method_styles(methods), zero=True, **size)
    figure.supxlabel("difference to the best classical method", fontsize=_SMALL)
    return figure


def _draw_paper_classes(file: str, metric: str, methods: Sequence[str]) -> Figure:
    """Return a figure of a distance by class, and of the paper's FID; right is better."""
    ours = read(file, methods, metric=metric)
    paper = read(file, methods, metric="fid")
    panels = [
        ours.assign(panel=f"here: {metric}"),
        paper.assign(panel="the paper: FID", value=paper["paper"]),
    ]
    dots = pd.concat(panels)
    dots = dots.drop(columns=["low", "high"]).assign(row=dots["class"], turned=True)
    return dots_figure(dots, method_styles(methods), width_in=_WIDTH_IN, fontsize=_SMALL)


def _draw_costs() -> Figure:
    """Return a figure of quality on real meshes against the cost of one view, with the frontier.

    The frontier has the methods that no cheaper one is better than.
    """
    costs = measured_methods()
    panels = []
    for metric in ("lpips", "ssim"):
        rows = read("real-meshes-grey.csv", metric=metric, condition="2048")
        rows = rows[(rows["class"] == AVERAGE) & ~rows["method"].isin(CHOSEN)]
        one_view_ms = []
        for method in rows["method"]:
            cost = cost_of(method, costs)
            one_view_ms.append(cost.one_view_ms if cost else math.nan)
        rows = rows.assign(cost=one_view_ms, verdict="")
        rows = rows.dropna(subset="cost").sort_values("cost").assign(panel=axis_title(metric))
        competing = rows[rows["method"].map(role) == ""]  # others are reference methods
        value = competing["value"] if higher_is_better(metric) else -competing["value"]
        best = competing.index[value == value.cummax()]
        rows.loc[best, "verdict"] = "frontier"
        panels.append(rows.assign(cost_low=rows["cost"], cost_high=rows["cost"]))
    frame = pd.concat(panels)
    names = list(dict.fromkeys(frame["method"]))
    label = "milliseconds for one view of a new cloud"
    size = {"columns": 1, "width_in": _WIDTH_IN, "panel_in": 2.4, "fontsize": _SMALL}
    return frontier_figure(frame, method_styles(names), label, named=names, **size)


def _draw_families(file: str, methods: Sequence[str]) -> Figure:
    """Return a figure of a metric along each family of conditions, with worse clouds to the right.

    file  of the values
    """
    values = read(file, methods, metric=METRIC)
    curves = condition_curves(values.rename(columns={"low": "ci_low", "high": "ci_high"}))
    size = {"columns": 2, "width_in": _WIDTH_IN, "panel_in": 1.5, "fontsize": _SMALL}
    return family_figure(family_panels(curves), method_styles(methods), **size)


CHAIR = "splat-net@chair"
OTHERS = ("best-classical", "pc2pix", "surface-apss", FLOOR)
# What draws each image, by name: figures, sheets, and sheets that need real meshes.
FIGURES: Mapping[str, Callable[[], Figure]] = {
    "known-chairs": partial(_draw_conditions, "sealed.csv", (CHAIR, "fused-net", *OTHERS)),
    "real-meshes": partial(
        _draw_classes, "real-meshes-grey-differences.csv", ("fused-net@grey", "splat-net@grey")
    ),
    "table5": partial(
        _draw_paper_classes, "thirteen-classes.csv", "fd-views", ("surface-apss", "pc2pix@all")
    ),
    "beyond": partial(_draw_families, "beyond-training.csv", (CHAIR, "fused-net", *OTHERS)),
    "trade": _draw_costs,
}
_SHEETS = {
    "latent": partial(draw_path, "pc2pix", 4, _WIDTH_IN),
    "coloured": partial(draw_coloured, "chair", 2, COLOURED, _WIDTH_IN),
}
_OF_MESHES: Mapping[str, Callable[[Path], Figure]] = {
    "real-objects": lambda meshes: draw_objects(
        meshes, ("airplane", "cabinet", "chair", "lamp", "table"), REAL, _WIDTH_IN
    ),
    "dense-and-scanned": lambda meshes: draw_objects(
        meshes, ("chair",), OF_FURTHER, _WIDTH_IN, FURTHER
    ),
    "scans": lambda meshes: draw_scans(meshes, SCANNED, _WIDTH_IN),
}


def drawings(meshes: Path | None, scan: Path | None) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw the images, by name.

    meshes  the folder of real meshes; None leaves out the sheets of these
    scan    a coloured scan; None leaves out the sheet that shows it
    """
    every: dict[str, Callable[[], Figure]] = {**FIGURES, **_SHEETS}
    if meshes:
        for name, draw in _OF_MESHES.items():
            every[name] = partial(draw, meshes)
        if scan:
            every["answer"] = partial(draw_answer, meshes, scan, ANSWER, _WIDTH_IN)
    return every


def main() -> None:
    """Draw all images, or those that are named."""
    parser = argparse.ArgumentParser(description="Images of the pages.")
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--meshes", type=Path, help="the folder of real meshes")
    parser.add_argument("--scan", type=Path, help="a coloured scan")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"))
    options = parser.parse_args()
    draw = drawings(options.meshes, options.scan)
    if gone := [name for name in options.names if name not in draw]:
        parser.error(
            f"{gone[0]}: no image has this name; give one of {', '.join(draw)}, with --meshes PATH "
            f"one of {', '.join(_OF_MESHES)}, or with --scan FILE besides answer"
        )
    for name in options.names or draw:
        save(draw[name](), options.out / f"{name}.png", dpi=DPI)


if __name__ == "__main__":
    main()
