"""Figures of a run of Table 5: the paper's Figure 4, and SR against pc2pix class by class."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.analysis.paper import (
    AVERAGE,
    PAPER_METRIC,
    PAPER_NETWORK,
    SURFACE,
    Published,
    network_of,
)
from bench.analysis.scores import QualityRow
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import role
from bench.catalogue.metrics import higher_is_better
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.artifacts import JobName
from bench.records.record import GROUND_TRUTH
from bench.records.stored_artifacts import Artifact
from bench.report.figure import (
    FIGURES,
    MOST_HIGH_IN,
    TEXT,
    WIDTH_IN,
    drawing,
    panels,
    save,
    show,
)
from bench.report.image_sheets import wrapped
from bench.report.styles import method_styles
from bench.tables.grid import ordered
from bench.tables.markdown import visible
from bench.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_ACROSS = 8  # images in a row: with so few, two blocks of classes stand side by side
DISTANCES = (PAPER_METRIC, "fd-views")  # the first that has a value is shown
SPLAT_NET = "splat-net"
NAMES = {SURFACE: "SR"}


def write_class_figures(
    directory: Path,
    table: Table[QualityRow],
    headline: Table[QualityRow],
    published: Published,
    artifacts: Mapping[JobName, Artifact],
) -> None:
    """Write `classes.png` (the paper's Figure 4) and `table5.png`.

    `classes.png` shows one method of each approach, and the best by each metric of the headline.
    `artifacts` are all images, ground truths included. Without pc2pix or without SR there is no
    second figure; where all methods have failed, none.
    """
    cells = [name for name in artifacts if name.condition]
    if not cells:
        return
    folder = directory / FIGURES
    methods, condition = ordered(item.method for item in cells), cells[0].condition
    network = network_of(methods)
    splat_net = next((m for m in methods if family_of(m) == SPLAT_NET), None)
    best = best_methods(headline.rows, condition)
    wanted = ordered([SURFACE, network, *best.values(), splat_net, "splat"])
    shown = [method for method in wanted if method in methods]
    save(images_figure(shown, condition, best, artifacts), folder / "classes.png")
    if network is not None and SURFACE in methods:
        dots = dots_figure(table.rows, network, published)
        if dots is not None:
            for kind in ("png", "svg"):
                save(dots, folder / f"table5.{kind}")


def best_methods(headline: Sequence[QualityRow], condition: str) -> dict[str, str]:
    """Return the best of the methods that compete by each metric, in the mean over classes.

    Failed images are scored as blank ones, so that no method is best by failing.
    """
    best: dict[str, QualityRow] = {}
    for row in headline:
        if row.condition != condition or role(row.method) or math.isnan(row.failures_as_blank):
            continue
        gain = row.failures_as_blank - best.setdefault(row.metric, row).failures_as_blank
        if gain * (1 if higher_is_better(row.metric) else -1) > 0:
            best[row.metric] = row
    return {metric: row.method for metric, row in best.items()}


@drawing()
def images_figure(
    shown: Sequence[str],
    condition: str,
    best: Mapping[str, str],
    artifacts: Mapping[JobName, Artifact],
) -> Figure:
    """Draw the first view of the first object of each class, which nobody has chosen.

    The truth is followed by the images of the methods at a condition, each above its SSIM with the
    truth. `best` has the best method by metric.
    """
    first: dict[str, JobName] = {}
    for name in artifacts:
        if name.method == GROUND_TRUTH:
            first.setdefault(name.class_name, name)
    width = 1 + len(shown)
    blocks = max(min(MOST_ACROSS // width, 2), 1)
    rows = math.ceil(len(first) / blocks)
    cell_in = min((WIDTH_IN - 0.3) / (blocks * width) + 0.15, (MOST_HIGH_IN - 0.8) / rows)
    figure, axes = panels(rows, blocks * width, (WIDTH_IN, cell_in * rows + 0.8))
    for axis in axes.ravel():
        axis.set_axis_off()
    for number, (class_name, truth) in enumerate(first.items()):
        block, row = divmod(number, rows)
        line = axes[row, block * width : (block + 1) * width]
        true = artifacts[truth].read()[:1]
        show(line[0], true[0])
        line[0].set_axis_on()
        line[0].set_ylabel(visible(class_name), fontsize=TEXT)
        for axis, method in zip(line[1:], shown, strict=True):
            axis.set_axis_on()
            drawn = artifacts.get(JobName(method, condition, *truth.object))
            image = None if drawn is None else drawn.read()[:1]
            show(axis, None if image is None else image[0])
            if image is not None:
                axis.set_xlabel(f"{ssim_per_image(true, image).ssim[0]:.2f}", fontsize=TEXT)
        if row == 0:
            for axis, title in zip(line, ["truth", *shown], strict=True):
                axis.set_title(wrapped(visible(title)), fontsize=TEXT)
    caption = f"{condition}: the first object of each class in its first view; SSIM below"
    winners = (
        f"{visible(winner)} by {' and '.join(m for m, method in best.items() if method == winner)}"
        for winner in ordered(best.values())
    )
    lines = [caption, f"best of all methods: {', '.join(winners)}"] if best else [caption]
    figure.supxlabel("\n".join(lines), fontsize=TEXT)
    return figure


@drawing()
def dots_figure(rows: Sequence[QualityRow], network: str, published: Published) -> Figure | None:
    """Draw the distances of SR and the network by class: ours with intervals, and the paper's.

    Return None where no distance was measured.
    """
    condition = rows[0].condition
    finite = {row.metric for row in rows if math.isfinite(row.value)}
    metric = next((m for m in DISTANCES if m in finite), None)
    if metric is None:
        return None
    ours = {
        (row.class_name, row.method): (row.value, row.ci_low, row.ci_high)
        for row in rows
        if row.metric == metric and row.condition == condition
    }
    classes = ordered(row.class_name for row in rows)
    paper = {
        (name, method): (published[name, PAPER_METRIC, "2048", method],) * 3
        for name in classes
        for method in (SURFACE, PAPER_NETWORK)
        if (name, PAPER_METRIC, "2048", method) in published
    }
    figure, (axes,) = panels(1, 2, (WIDTH_IN, 0.32 * len(classes) + 1.4), sharey=True)
    _panel(axes[0], f"ours: {metric} (lower is better)", classes, ours, network)
    _panel(axes[1], "as published: FID on ShapeNet", classes, paper, PAPER_NETWORK)
    axes[0].set_yticks(range(len(classes)), classes)
    axes[0].invert_yaxis()
    axes[0].legend(loc="best", fontsize=TEXT)
    return figure


def _panel(
    axis: Any,
    title: str,
    classes: Sequence[str],
    values: Mapping[tuple[str, str], Sequence[float]],
    network: str,
) -> None:
    """Draw two dots for a class and a line between them; a missing value has no dot."""
    styles = method_styles((SURFACE, network))
    for place, name in enumerate(classes):
        ends = [values[name, m][0] for m in (SURFACE, network) if (name, m) in values]
        axis.plot(ends, [place] * len(ends), color="0.75", linewidth=3, zorder=1)
    for method, shift in ((SURFACE, -0.12), (network, 0.12)):
        places = [i for i, name in enumerate(classes) if (name, method) in values]
        at = np.array([values[classes[i], method] for i in places]).reshape(-1, 3)
        axis.errorbar(
            at[:, 0],
            np.array(places) + shift,
            xerr=np.nan_to_num(np.abs(at[:, 1:] - at[:, :1])).T,
            fmt=styles[method].marker,
            color=styles[method].colour,
            capsize=2,
            label=NAMES.get(method, method),
        )
    if AVERAGE in classes:
        axis.axhline(len(classes) - 1.5, color="0.6", linewidth=0.8)
    axis.set_xlim(left=0)
    axis.set_title(title, fontsize=10)
    axis.grid(axis="x", alpha=0.3)
