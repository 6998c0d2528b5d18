"""The figure of the suite `speed`: what a picture costs against the number of views of a cloud."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.catalogue.suites import SpeedSuite
from bench.suites.speed.summary import MS, Summary, beside, break_even

POINTS = 200  # of a line
APART = 0.05  # of a panel's height: labels closer than this would touch
ROOM = 11.0  # to the right of the lines, as a factor on the last number of views
LABELS_AT = 0.785  # of the width


def write_amortised(path: Path, summaries: Sequence[Summary], suite: SpeedSuite) -> None:
    """A PNG with a panel for each condition (down) and number of threads (across), log-log.

    Dots: as measured. Rings: break-even with the first of the suite's rivals. Where no method has
    a cost there is nothing to draw.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    drawn = [summary for summary in summaries if summary.wall]
    if not drawn:
        return
    of = [summary.measurement for summary in drawn]
    conditions, threads, methods = (
        list(dict.fromkeys(getattr(m, name) for m in of))
        for name in ("condition", "threads", "method")
    )
    figure, axes = plt.subplots(
        len(conditions),
        len(threads),
        figsize=(6.5 * len(threads), 5 * len(conditions)),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    panels = {
        (condition, count): axis
        for condition, axis_row in zip(conditions, axes, strict=True)
        for count, axis in zip(threads, axis_row, strict=True)
    }
    for (condition, count), axis in panels.items():
        axis.set_title(f"{condition}, {count} thread{'s' if count > 1 else ''}")
        axis.grid(alpha=0.3)
    for summary, m in zip(drawn, of, strict=True):
        rival = beside(drawn, summary, suite.rivals[0])
        colour = f"C{methods.index(m.method) % 10}"
        _line(panels[m.condition, m.threads], summary, rival, colour, suite.amortised[-1])
    first = axes[0, 0]  # the axes are shared
    first.set(xscale="log", yscale="log", xlim=(0.9, ROOM * suite.amortised[-1]))
    first.set_xticks(suite.amortised, map(str, suite.amortised))
    first.minorticks_off()
    for axis in axes[-1]:
        axis.set_xlabel(f"pictures of one cloud (ring: as dear as {suite.rivals[0]})")
    for axis in axes[:, 0]:
        axis.set_ylabel("milliseconds a picture (lower is better)")
    for axis in axes.flat:
        _label_lines(axis)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _line(axis: Any, summary: Summary, rival: Summary | None, colour: str, last: int) -> None:
    cost = summary.wall
    assert cost is not None  # the others have been left out
    views = np.geomspace(1, last, POINTS)
    line = [MS * cost.per_picture(v) for v in views]
    axis.plot(views, line, color=colour, label=summary.measurement.method)
    measured = [v for v in (1, cost.batch) if v <= last]
    axis.plot(measured, [MS * cost.per_picture(v) for v in measured], "o", color=colour, ms=4)
    if rival is None or rival is summary or rival.wall is None:
        return
    for equal in break_even(cost, rival.wall).views:
        if equal <= last:
            height = MS * cost.per_picture(equal)
            axis.plot(equal, height, "o", color=colour, ms=9, mfc="none")


def _label_lines(axis: Any) -> None:
    """Each line's name at its right end, moved apart where names would touch."""
    lines = [line for line in axis.get_lines() if not line.get_label().startswith("_")]
    if not lines:
        return
    bottom, top = map(math.log10, axis.get_ylim())
    ends = [float(line.get_ydata()[-1]) for line in lines]
    at = [(math.log10(end) - bottom) / (top - bottom) for end in ends]
    for line, end, height in zip(lines, ends, spread(at, APART), strict=True):
        axis.annotate(
            line.get_label(),
            xy=(line.get_xdata()[-1], end),
            xytext=(LABELS_AT, height),
            textcoords="axes fraction",
            color=line.get_color(),
            fontsize=8,
            va="center",
            arrowprops={"arrowstyle": "-", "color": line.get_color(), "lw": 0.5},
        )


def spread(places: Sequence[float], apart: float) -> list[float]:
    """Places moved as little as their order and the distance `apart` between neighbours allow.

    Least squares (isotonic regression): those that would touch stand evenly about their mean.
    """
    order = sorted(range(len(places)), key=lambda i: places[i])
    # Less its share of the distance, a place must not be lower than the one before: pool those
    # that are (Barlow 1972, pool adjacent violators).
    blocks: list[list[float]] = []
    for rank, index in enumerate(order):
        blocks.append([places[index] - rank * apart])
        while len(blocks) > 1 and _mean(blocks[-2]) > _mean(blocks[-1]):
            blocks[-2:] = [blocks[-2] + blocks[-1]]
    levels = [_mean(block) for block in blocks for _ in block]
    moved = dict(zip(order, (level + r * apart for r, level in enumerate(levels)), strict=True))
    return [moved[i] for i in range(len(places))]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
