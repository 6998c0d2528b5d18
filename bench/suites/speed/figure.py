"""The figure of the suite `speed`: an image's cost against the number of views of a cloud."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import pandas as pd

from bench.report.figure import WIDTH_IN, drawing, name_lines, panels
from bench.tables.grid import ordered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

APART = 0.05  # of a panel's height: labels closer than this would touch
ROOM = 11.0  # to the right of the lines, as a factor on the last number of views
LABELS_AT = 0.785  # of the width


@drawing()
def amortised_figure(rows: pd.DataFrame) -> Figure:
    """Return a panel for each condition (down) and number of threads (across), log-log."""
    conditions, threads, methods, views = (
        ordered(rows[name]) for name in ("condition", "threads", "method", "views")
    )
    size_in = (WIDTH_IN, (5 if len(threads) == 1 else 3.5) * len(conditions))
    figure, axes = panels(len(conditions), len(threads), size_in, sharex=True, sharey=True)
    first = axes[0, 0]  # the axes are shared
    first.set(xscale="log", yscale="log", xlim=(0.9, ROOM * views[-1]))
    first.set_xticks(views, map(str, views))
    first.minorticks_off()
    first.yaxis.set_major_formatter("{x:g}")  # a power would be written as a formula
    for (condition, count), axis in zip(product(conditions, threads), axes.flat, strict=True):
        axis.set_title(f"{condition}, {count} thread{'s' if count > 1 else ''}")
        axis.grid(alpha=0.3)
        chosen = rows[(rows["condition"] == condition) & (rows["threads"] == count)]
        for method, line in chosen.groupby("method", sort=False):
            colour = f"C{methods.index(str(method)) % 10}"
            axis.plot(line["views"], line["wall_ms"], "o-", color=colour, ms=4, label=method)
    for axis in axes[-1]:
        axis.set_xlabel("images of one cloud")
    for axis in axes[:, 0]:
        axis.set_ylabel("milliseconds an image (lower is better)")
    for axis in axes.flat:
        name_lines(axis, axis.get_lines(), LABELS_AT, apart=APART)
    return figure
