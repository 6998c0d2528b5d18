"""The classes of a run that has several: values and ranks in each."""

from __future__ import annotations

from collections.abc import Sequence

from bench.analysis.comparison import Comparison
from bench.analysis.leaderboard import over_conditions
from bench.analysis.ranks import ranking
from bench.report.site.methods import under_site_names
from bench.report.site.site_run import (
    FIRST,
    SiteRun,
    caption_of,
    headers,
    letters_remark,
    method_file,
)
from bench.report.site.words import letter_range
from bench.tables.grid import NOTHING, Cell, Grid, TableRow, marked, ordered


def class_grids(run: SiteRun, methods: Sequence[str]) -> tuple[Grid, ...]:
    """Return a grid for each metric: these methods by class, the mean over conditions."""
    by_class: dict[str, list[Comparison]] = {}
    for comparison in run.by_class:
        by_class.setdefault(comparison.class_name, []).append(comparison)
    overall = {name: over_conditions(compared) for name, compared in by_class.items()}
    shown = ordered(name for name in methods if name in run.methods)
    grids = []
    for metric in run.metrics:
        rankings = {
            name: under_site_names(
                ranking(of_class, metric), {m.id: m for m in run.methods.values()}
            )
            for name, of_class in overall.items()
        }
        lines = []
        for method in shown:
            cells = []
            for of_class in rankings.values():
                rank = of_class.of(method)
                if rank is None:
                    cells.append(NOTHING)
                    continue
                value = rank.estimate.value
                text = f"{value:.{rank.precision.decimals}f} {letter_range(rank.letters)}".rstrip()
                cell = Cell(text, value, special=FIRST if rank.first else None)
                cells.append(marked(cell, rank.precision))
            lines.append(TableRow(method, tuple(cells), link=method_file(method)))
        grids.append(
            Grid(
                "method",
                headers(rankings),
                tuple(lines),
                caption=f"{run.name}: {caption_of(metric)}",
                remark=letters_remark(rankings.values()),
            )
        )
    return tuple(grids)
