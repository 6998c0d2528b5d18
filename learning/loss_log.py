"""The losses of a training run as `losses.csv`, a step in every row, and its plot.

The image has one panel a loss, a smoothed line over the faint values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data_prep.files.atomic_write import atomic_write, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILE_NAME = "losses.csv"
COLUMNS = 3
_SMOOTHED_SHARE = 0.05  # of the rows, in one point of the smoothed line
_LOG_RATIO = 20.0  # between the largest and the smallest smoothed value


class LossLog:
    """A writer that appends rows to `losses.csv`.

    path  of the file
    step  of the checkpoint that training continues from. Rows of later steps are dropped: they were
          written before the training was interrupted, and these steps are taken again
    """

    def __init__(self, path: Path, step: int) -> None:
        self.path = path
        kept = _rows(path, step)
        write_whole(path, "".join(f"{line}\n" for line in kept).encode())
        self.has_header = bool(kept)

    def add(self, step: int, losses: Mapping[str, float]) -> None:
        """Write the losses of a step as a row, and before the first row the header."""
        numbers = [f"{value:.6g}" for value in losses.values()]
        with self.path.open("a") as file:
            if not self.has_header:
                file.write(",".join(["step", *losses]) + "\n")
                self.has_header = True
            file.write(",".join([str(step), *numbers]) + "\n")


def read_losses(
    path: Path, last_step: int
) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]:
    """Return steps [N] up to `last_step`, and each loss [N] by name; empty without a file."""
    header, *rows = _rows(path, last_step) or ["step"]
    values = np.array([row.split(",") for row in rows], dtype=np.float64)
    values = values.reshape(-1, header.count(",") + 1)
    names = header.split(",")[1:]
    return values[:, 0].astype(np.int64), dict(zip(names, values[:, 1:].T, strict=True))


def _rows(path: Path, last_step: int) -> list[str]:
    """Return the header and rows up to `last_step`; nothing without file or step."""
    lines = path.read_text().splitlines() if path.is_file() and last_step > 0 else []
    # a row that was cut short is later than the checkpoint, for rows are written before it
    whole = [line for line in lines[1:] if line.count(",") == lines[0].count(",")]
    return lines[:1] + [line for line in whole if int(line.partition(",")[0]) <= last_step]


@dataclass(frozen=True, eq=False)
class _Panel:
    """One loss against the steps [N]; NaN where it was left out."""

    name: str
    steps: NDArray[np.int64]
    raw: NDArray[np.float64]
    smooth: NDArray[np.float64]
    log_scale: bool


def write_loss_curves(csv: Path, png: Path, last_step: int) -> None:
    """Draw the rows of `csv` up to `last_step`; nothing where there are none."""
    panels = _make_panels(*read_losses(csv, last_step))
    if panels:
        with atomic_write(png) as new:
            draw(panels).savefig(new, format="png", dpi=80)


def _make_panels(
    steps: NDArray[np.int64], losses: dict[str, NDArray[np.float64]]
) -> tuple[_Panel, ...]:
    """Return a panel for every loss that has a value; an exact zero stands for none."""
    panels = []
    for name, values in losses.items():
        raw = np.where(values == 0, np.nan, values)
        known = ~np.isnan(raw)
        if known.any():
            smooth = np.full_like(raw, np.nan)
            smooth[known] = means = _running_mean(raw[known])
            log_scale = bool(means.min() > 0 and means.max() > _LOG_RATIO * means.min())
            panels.append(_Panel(name, steps, raw, smooth, log_scale))
    return tuple(panels)


def _running_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of a window around each value [N], which is cut at the ends."""
    half = math.ceil(_SMOOTHED_SHARE * len(values) / 2)
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    start, end = np.maximum(at - half, 0), np.minimum(at + half + 1, len(values))
    return (total[end] - total[start]) / (end - start)


def draw(panels: tuple[_Panel, ...]) -> Figure:
    """Return the figure with a set of axes for each panel, in rows of COLUMNS.

    There is at least one panel.
    """
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
