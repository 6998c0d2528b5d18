"""Pictures of `losses.csv`: one panel a loss, a smoothed line over the faint values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data_prep.whole_files import whole_file
from learning import loss_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 3
SMOOTHED_SHARE = 0.05  # of the rows, in one point of the smoothed line
LOG_RATIO = 20.0  # between the largest and the smallest smoothed value


@dataclass(frozen=True, eq=False)
class Panel:
    """One loss against the steps [N]; NaN where the loss was left out."""

    name: str
    steps: NDArray[np.int64]
    raw: NDArray[np.float64]
    smooth: NDArray[np.float64]
    log_scale: bool


def write_loss_curves(csv: Path, png: Path, last_step: int) -> None:
    """Draw the rows of `csv` up to `last_step`. Nothing where there are none."""
    panels = make_panels(*loss_log.read_losses(csv, last_step))
    if panels:
        with whole_file(png) as new:
            draw(panels).savefig(new, format="png", dpi=80)


def make_panels(
    steps: NDArray[np.int64], losses: dict[str, NDArray[np.float64]]
) -> tuple[Panel, ...]:
    """A panel for every loss that has a value; an exact zero stands for none."""
    panels = []
    for name, values in losses.items():
        raw = np.where(values == 0, np.nan, values)
        known = ~np.isnan(raw)
        if known.any():
            smooth = np.full_like(raw, np.nan)
            smooth[known] = _running_mean(raw[known])
            panels.append(Panel(name, steps, raw, smooth, _spans_decades(smooth[known])))
    return tuple(panels)


def _running_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean of a window around each value [N]; at the ends, of what there is of it."""
    half = math.ceil(SMOOTHED_SHARE * len(values) / 2)
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    start, end = np.maximum(at - half, 0), np.minimum(at + half + 1, len(values))
    return (total[end] - total[start]) / (end - start)


def _spans_decades(values: NDArray[np.float64]) -> bool:
    return bool(values.min() > 0 and values.max() > LOG_RATIO * values.min())


def draw(panels: tuple[Panel, ...]) -> Figure:
    """The figure; one set of axes a panel, in rows of COLUMNS. At least one panel."""
    from matplotlib.figure import Figure

    columns = min(COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(4.5 * columns, 2.8 * rows), layout="constrained")
    for index, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, index + 1)
        axes.plot(panel.steps, panel.raw, color="tab:blue", alpha=0.25, linewidth=0.8)
        # a dot where a line would need two points
        marker = "." if np.isfinite(panel.smooth).sum() == 1 else ""
        axes.plot(panel.steps, panel.smooth, color="tab:blue", linewidth=1.5, marker=marker)
        if panel.log_scale:
            axes.set_yscale("log", nonpositive="mask")
        axes.set_title(panel.name, fontsize=10)
        axes.grid(alpha=0.3)
    figure.supxlabel("step", fontsize=10)
    return figure
