"""The legend of a group of plots: the line and marker of each method, which the page names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bench.report.figure import drawing, panels
from bench.report.inline import MarkedFigure, inline
from bench.report.page import LegendEntry
from bench.report.robustness import point_style
from bench.report.styles import MethodStyle

SYMBOL_IN = (0.5, 0.2)


def legend(
    methods: Iterable[str], styles: Mapping[str, MethodStyle], name: str
) -> tuple[LegendEntry, ...]:
    """Return an entry for each method; `name`, unlike any other, begins the ids of its symbols."""
    return tuple(
        LegendEntry(method, inline(_symbol(styles[method]), f"{name}-{number}"))
        for number, method in enumerate(methods)
    )


@drawing()
def _symbol(style: MethodStyle) -> MarkedFigure:
    figure, ((axis,),) = panels(1, 1, SYMBOL_IN, layout=None)
    axis.set_position((0, 0, 1, 1))
    axis.set_axis_off()
    axis.set(xlim=(0, 1), ylim=(0, 1))
    axis.plot([0.02, 0.98], [0.5, 0.5], color=style.colour, linestyle=style.dashes, linewidth=1.2)
    if style.marker:
        axis.plot(0.5, 0.5, **point_style(style, 7))
    return MarkedFigure(figure)
