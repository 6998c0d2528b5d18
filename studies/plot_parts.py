"""Parts that the figures of the result pages share: sizes, markers, titles, the legend."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bench.catalogue.metrics import higher_is_better
from bench.report.styles import PAPER, RULE, MethodStyle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
WIDTH_IN = 8.0
TEXT_PT, SMALL_PT = 9.0, 8.0
LINE_LETTERS, ENTRY_LETTERS = 112, 9  # of a legend 800 pixels wide, and beside each name
FLOOR = "blank"
SHADE: Mapping[str, Any] = {"color": "#e8e6e1", "zorder": 0, "linewidth": 0}


def number(text: str) -> float:
    """Return a number of a CSV file; an empty one is NaN."""
    return float(text) if text else math.nan


def title_of(metric: str) -> str:
    """Return a metric and which way it is better."""
    return f"{metric} ({'more' if higher_is_better(metric) else 'less'} is better)"


def point(style: MethodStyle, size: float = 5.5, *, hollow: bool = False) -> dict[str, Any]:
    """Return matplotlib's settings for a marker of a method."""
    return {
        "color": style.colour,
        "marker": style.marker or "None",
        "markersize": size,
        "fillstyle": style.fill,
        "markerfacecolor": PAPER if hollow else style.colour,
        "markerfacecoloralt": PAPER,
        "markeredgewidth": 1.0,
    }


def tidy(axis: Any, grid: str = "y") -> None:
    """Give an axis a quiet grid and letters that can be read."""
    axis.grid(axis=grid, color=RULE, linewidth=0.7)
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=SMALL_PT, length=3)
    axis.spines[["top", "right"]].set_visible(False)


def legend(figure: Figure, axis: Any) -> None:
    """Write one legend above all panels, in the order in which methods were drawn."""
    lines, names = axis.get_legend_handles_labels()
    rows = math.ceil(sum(len(name) + ENTRY_LETTERS for name in names) / LINE_LETTERS)
    figure.legend(
        *(lines, names),
        loc="outside upper center",
        ncols=math.ceil(len(names) / rows),
        fontsize=TEXT_PT,
        frameon=False,
        handlelength=2.6,
        columnspacing=1.4,
    )


def label_of(method: str) -> str:
    """Return the name of a method in a legend."""
    return "blank: a white image" if method == FLOOR else method
