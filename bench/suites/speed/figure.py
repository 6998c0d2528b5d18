"""The figure of the suite `speed`: an image's cost against the number of views of a cloud."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.report.figure import WIDTH_IN, drawing, name_lines, panels
from bench.suites.speed.suite import SpeedSuite
from bench.suites.speed.summary import MS, Summary, beside, break_even

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 200  # of a line
APART = 0.05  # of a panel's height: labels closer than this would touch
ROOM = 11.0  # to the right of the lines, as a factor on the last number of views
LABELS_AT = 0.785  # of the width


@drawing()
def amortised_figure(summaries: Sequence[Summary], suite: SpeedSuite) -> Figure | None:
    """Return a panel for each condition (down) and number of threads (across), log-log.

    Dots are as measured, rings are break-evens with the first baseline of the suite. None where no
    method has a cost.
    """
    drawn = [summary for summary in summaries if summary.wall]
    if not drawn:
        return None
    measurements = [summary.measurement for summary in drawn]
    conditions, threads, methods = (
        list(dict.fromkeys(getattr(m, name) for m in measurements))
        for name in ("condition", "threads", "method")
    )
    figure, axes = panels(
        len(conditions),
        len(threads),
        (WIDTH_IN, (5 if len(threads) == 1 else 3.5) * len(conditions)),
        sharex=True,
        sharey=True,
    )
    by_cell = dict(zip(product(conditions, threads), axes.flat, strict=True))
    for (condition, count), axis in by_cell.items():
        axis.set_title(f"{condition}, {count} thread{'s' if count > 1 else ''}")
        axis.grid(alpha=0.3)
    for summary, m in zip(drawn, measurements, strict=True):
        rival = beside(drawn, summary, suite.baselines[0])
        colour = f"C{methods.index(m.method) % 10}"
        _line(by_cell[m.condition, m.threads], summary, rival, colour, suite.amortised[-1])
    first = axes[0, 0]  # the axes are shared
    first.set(xscale="log", yscale="log", xlim=(0.9, ROOM * suite.amortised[-1]))
    first.set_xticks(suite.amortised, map(str, suite.amortised))
    first.minorticks_off()
    first.yaxis.set_major_formatter("{x:g}")  # a power would be written as a formula
    for axis in axes[-1]:
        axis.set_xlabel(f"images of one cloud (ring: costs as much as {suite.baselines[0]})")
    for axis in axes[:, 0]:
        axis.set_ylabel("milliseconds an image (lower is better)")
    for axis in axes.flat:
        named = [line for line in axis.get_lines() if not line.get_label().startswith("_")]
        name_lines(axis, named, LABELS_AT, apart=APART)
    return figure


def _line(axis: Any, summary: Summary, rival: Summary | None, colour: str, last: int) -> None:
    cost = summary.wall
    assert cost is not None  # summaries without a cost have no line
    views = np.geomspace(1, last, POINTS)
    line = [MS * cost.per_image(v) for v in views]
    axis.plot(views, line, color=colour, label=summary.measurement.method)
    measured = [v for v in (1, cost.batch) if v <= last]
    axis.plot(measured, [MS * cost.per_image(v) for v in measured], "o", color=colour, ms=4)
    if rival is None or rival is summary or rival.wall is None:
        return
    for equal in break_even(cost, rival.wall).views:
        if equal <= last:
            height = MS * cost.per_image(equal)
            axis.plot(equal, height, "o", color=colour, ms=9, mfc="none")
