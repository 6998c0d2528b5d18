"""Paired differences in a figure: an interval for each cell, on an axis for each metric."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from bench.analysis.paired import PairedDifference
from bench.catalogue.metrics import is_similarity

COLOURS = {"a": "tab:orange", "b": "tab:blue", "tie": "0.5", "unknown": "0.8"}


def write_differences(path: Path, cells: Sequence[PairedDifference], a: str, b: str) -> None:
    """Write the figure, `path` with the suffixes .png and .svg; its folder is there.

    A panel for each metric, a line for each condition, class and method: b - a with its interval.
    Cells without a difference are left out.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    known = [cell for cell in cells if math.isfinite(cell.difference.value)]
    metrics = list(dict.fromkeys(cell.metric for cell in known))
    if not metrics:
        return
    labels = list(dict.fromkeys(map(_label, known)))
    height = 1.2 + 0.28 * len(labels)
    with mpl.rc_context({"svg.hashsalt": "differences"}):
        figure, axes = plt.subplots(
            1,
            len(metrics),
            figsize=(2.5 + 3.5 * len(metrics), height),
            sharey=True,
            squeeze=False,
            layout="constrained",
        )
        for axis, metric in zip(axes[0], metrics, strict=True):
            for cell in (one for one in known if one.metric == metric):
                low, value, high = cell.difference.low, cell.difference.value, cell.difference.high
                reach = [[value - low], [high - value]] if math.isfinite(low) else None
                axis.errorbar(
                    [value],
                    [labels.index(_label(cell))],
                    xerr=reach,
                    marker="o",
                    markersize=4,
                    capsize=2,
                    color=COLOURS[cell.ahead],
                )
            axis.axvline(0.0, color="0.3", linewidth=0.8)
            better = "right" if is_similarity(metric) else "left"
            axis.set_title(f"{metric}: b is better to the {better}", fontsize=9)
            axis.set_xlabel("b - a", fontsize=8)
            axis.tick_params(labelsize=8)
            axis.grid(axis="x", alpha=0.3)
        axes[0][0].set_yticks(range(len(labels)), labels)
        axes[0][0].invert_yaxis()
        figure.suptitle(
            f"a: {a}\nb: {b}\ncoloured where they differ, grey where it is a tie", fontsize=9
        )
        figure.savefig(path.with_suffix(".png"), dpi=120)
        figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
        plt.close(figure)


def _label(cell: PairedDifference) -> str:
    named = [cell.condition, cell.class_name]
    if cell.a.method == cell.b.method:
        named.insert(0, cell.b.method)
    return ", ".join(named)
