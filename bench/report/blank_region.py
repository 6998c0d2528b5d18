"""The part of a plot that is worse than a white image, shaded and named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from bench.catalogue.metrics import higher_is_better
from bench.report.styles import SHADE, SOFT

WORSE = "worse than a white image"
ROOM = 0.1  # of the height of an axis, which the region has at least, for its name

Span = tuple[float, float, float]  # left, right, value of a white image


def shade_worse(
    axis: Any, metric: str, spans: Sequence[Span], fontsize: float, named: bool = True
) -> None:
    """Shade what is worse than a white image, span by span, and name it there or for a legend.

    All that decides the limits of the axis is drawn before. One value for all spans is shaded
    across the axis.
    """
    spans = [span for span in spans if math.isfinite(span[2])]
    if not spans:
        return
    higher = higher_is_better(metric)
    levels = [level for *_, level in spans]
    end = _make_room(axis, min(levels) if higher else max(levels), higher)
    left, right = axis.get_xlim()
    style: dict[str, Any] = {
        "color": SHADE,
        "linewidth": 0,
        "zorder": 0.4,
    }  # below the lines of the grid
    if not named:
        style["label"] = WORSE
    if len(set(levels)) == 1:
        axis.axhspan(levels[0], end, **style)
    else:
        for start, stop, level in spans:
            axis.fill_between([start, stop], level, end, **style)
    axis.set_xlim(left, right)
    if not named:
        return
    axis.annotate(
        WORSE, (0.012, spans[0][2]), (0, -2 if higher else 2), ("axes fraction", "data"),
        "offset points", va="top" if higher else "bottom", fontsize=fontsize, color=SOFT,
    ).set_in_layout(False)  # fmt: skip


def _make_room(axis: Any, level: float, higher: bool) -> float:
    """Move the worse end of an axis so that there is room beyond a level; return that end."""
    low, high = axis.get_ylim()
    transform = axis.yaxis.get_transform()
    (bad,), (good,), (at,) = (
        transform.transform([y]) for y in ((low, high, level) if higher else (high, low, level))
    )
    wanted = (at - ROOM * good) / (1 - ROOM)
    bad = min(bad, wanted) if higher else max(bad, wanted)
    (end,) = transform.inverted().transform([bad])
    axis.set_ylim((end, high) if higher else (low, end))
    return float(end)
