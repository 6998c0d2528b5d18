"""Paired differences in a figure: an interval for each cell, on an axis for each metric."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from bench.analysis.run_pairs import Differences
from bench.catalogue.conditions import condition_name
from bench.catalogue.metrics import higher_is_better
from bench.report.figure import TEXT, WIDTH_IN, drawing, panels, save
from bench.tables.grid import records
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"a": "tab:orange", "b": "tab:blue", "tie": "0.5", "unknown": "0.8"}


def write_differences(path: Path, differences: Differences) -> None:
    """Write the figure as PNG and SVG beside each other; `path` is without suffix.

    Raises OSError. Nothing is written where no cell has a difference.
    """
    figure = differences_figure(differences)
    if figure is not None:
        for suffix in (".png", ".svg"):
            save(figure, path.with_name(path.name + suffix))


@drawing()
def differences_figure(differences: Differences) -> Figure | None:
    """Draw b - a with its interval, better to the right: a panel for each metric.

    A line is a cell: a method, condition and class. Cells without a difference are left out; return
    None where no cell is left.
    """
    known = differences.cells[differences.cells["difference"].notna()]
    if known.empty:
        return None
    known = known.assign(label=_labels(known))
    labels = known["label"].unique().tolist()
    size_in = WIDTH_IN, 1.6 + 0.28 * len(labels)
    figure, (axes,) = panels(1, known["metric"].nunique(), size_in, sharey=True)
    for axis, (metric, of_metric) in zip(axes, known.groupby("metric", sort=False), strict=True):
        for row in records(of_metric):
            low, value, high = row["ci_low"], row["difference"], row["ci_high"]
            axis.errorbar(
                [value],
                [labels.index(row["label"])],
                xerr=[[value - low], [high - value]] if math.isfinite(low) else None,
                marker="o",
                markersize=4,
                capsize=2,
                color=COLOURS[row["ahead"]],
            )
        axis.axvline(0.0, color="0.3", linewidth=0.8)
        lower = not higher_is_better(str(metric))
        axis.set_title(metric, fontsize=TEXT)
        axis.set_xlabel(f"difference{', lower is better' * lower}", fontsize=TEXT)
        if lower:
            axis.invert_xaxis()
        axis.tick_params(labelsize=TEXT)
        axis.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(range(len(labels)), labels)
    axes[0].invert_yaxis()
    colours = "blue: better, orange: worse, grey: not decided, light grey: too few objects"
    sides = f"{visible(differences.b)} against {visible(differences.a)}"
    figure.suptitle(f"{sides}: better to the right\n{colours}", fontsize=TEXT)
    return figure


def _labels(cells: pd.DataFrame) -> list[str]:
    several_classes = cells["class"].nunique() > 1
    return [
        visible(
            ", ".join(
                [
                    *[row["method_b"]] * (row["method_a"] == row["method_b"]),
                    condition_name(row["condition"]).brief,
                    *[row["class"]] * several_classes,
                ]
            )
        )
        for row in records(cells)
    ]
