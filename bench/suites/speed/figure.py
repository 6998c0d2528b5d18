"""The figure of the suite `speed`: an image's cost against the number of views of a cloud."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from bench.report.plots import SweepPanel, grouped, sweep_figure
from bench.report.styles import method_styles
from bench.tables.grid import ordered

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def amortised_figure(rows: pd.DataFrame) -> Figure:
    """Return a panel for each condition (down) and number of threads (across), log-log."""
    rows = rows.rename(columns={"views": "x", "wall_ms": "value"})
    shown = [
        SweepPanel(
            of_cell,
            title=f"{condition}, {threads} thread{'s' if threads > 1 else ''}",
            x_label="images of one cloud",
            y_label="milliseconds an image (lower is better)",
            ticks={views: f"{views}" for views in ordered(rows["x"])},
            x_scale="log",
            y_scale="log",
        )
        for (condition, threads), of_cell in grouped(rows, ["condition", "threads"])
    ]
    styles, columns = method_styles(ordered(rows["method"])), rows["threads"].nunique()
    return sweep_figure(shown, styles, columns=columns, panel_in=3.5, sharex=True, sharey=True)
