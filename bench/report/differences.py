"""Paired differences in a figure: an interval for each cell, on an axis for each metric."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench.analysis.paired import ComparedPair, PairedDifference
from bench.catalogue.conditions import condition_name
from bench.catalogue.metrics import higher_is_better
from bench.report.figure import TEXT, WIDTH_IN, drawing, panels, save
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"a": "tab:orange", "b": "tab:blue", "tie": "0.5", "unknown": "0.8"}


def write_differences(path: Path, cells: Sequence[PairedDifference], a: str, b: str) -> None:
    """Write the figure as PNG and SVG beside each other; `path` is without suffix.

    Raises OSError. Nothing is written where no cell has a difference.
    """
    figure = differences_figure(cells, a, b)
    if figure is not None:
        for suffix in (".png", ".svg"):
            save(figure, path.with_name(path.name + suffix))


@drawing()
def differences_figure(cells: Sequence[PairedDifference], a: str, b: str) -> Figure | None:
    """Draw b - a with its interval, better to the right: a panel for each metric.

    A line is a cell: a method, condition and class. Cells without a difference are left out; return
    None where no cell is left.
    """
    known = [cell for cell in cells if math.isfinite(cell.difference.value)]
    metrics = list(dict.fromkeys(cell.pair.metric for cell in known))
    several = len({cell.pair.class_name for cell in known}) > 1
    labels = list(dict.fromkeys(_label(cell.pair, several) for cell in known))
    if not metrics:
        return None
    size_in = WIDTH_IN, 1.6 + 0.28 * len(labels)
    figure, (axes,) = panels(1, len(metrics), size_in, sharey=True)
    for axis, metric in zip(axes, metrics, strict=True):
        for cell in (cell for cell in known if cell.pair.metric == metric):
            low, value, high = cell.difference.low, cell.difference.value, cell.difference.high
            axis.errorbar(
                [value],
                [labels.index(_label(cell.pair, several))],
                xerr=[[value - low], [high - value]] if math.isfinite(low) else None,
                marker="o",
                markersize=4,
                capsize=2,
                color=COLOURS[cell.ahead],
            )
        axis.axvline(0.0, color="0.3", linewidth=0.8)
        lower = not higher_is_better(metric)
        axis.set_title(metric, fontsize=TEXT)
        axis.set_xlabel(f"difference{', lower is better' * lower}", fontsize=TEXT)
        if lower:
            axis.invert_xaxis()
        axis.tick_params(labelsize=TEXT)
        axis.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(range(len(labels)), labels)
    axes[0].invert_yaxis()
    colours = "blue: better, orange: worse, grey: not decided, light grey: too few objects"
    title = f"{visible(b)} against {visible(a)}: better to the right\n{colours}"
    figure.suptitle(title, fontsize=TEXT)
    return figure


def _label(pair: ComparedPair, several_classes: bool) -> str:
    named = [condition_name(pair.condition).brief, *[pair.class_name] * several_classes]
    if pair.a.method == pair.b.method:
        named.insert(0, pair.b.method)
    return visible(", ".join(named))
