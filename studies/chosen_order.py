"""The order of the methods that learn nothing by metric and condition: `results/chosen.csv`.

    bench run --suite thirteen-classes --dataset procedural:validation --limit 2 --views 4 \
        --conditions 2048,1024,512,noise-0.05,noise-0.10 --out DIR --methods \
        surface-apss,surface-fit,surface-bpa,poisson,alpha-wrap,denoised-wrap,splat,splat-fill
    python -m studies.chosen_order DIR

By each metric the methods stand by their means over 13 classes, with a blank image for each failed
one. Those that were not measured at a condition come last, and equal ones stand, as by the other
metrics; the order by these, the lines of `*`, stays as it is, and so do conditions that the run has
not.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from bench.analysis.paper import AVERAGE
from bench.analysis.scored_run import read_run
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN, OTHER_METRICS, RANKINGS
from bench.catalogue.metrics import higher_is_better
from bench.tables.table import csv_text
from data_prep.files.atomic_write import write_whole
from studies.measurements import FIRST, values


def in_order(means: Mapping[str, float], higher: bool, otherwise: Sequence[str]) -> list[str]:
    """Return the methods of one condition by their means, the best first.

    Equal ones, and at the end those without a mean, are in their order otherwise; what is not
    among these is left out.
    """
    measured = [method for method in otherwise if method in means]
    measured.sort(key=lambda method: -means[method] if higher else means[method])
    return [*measured, *(method for method in otherwise if method not in means)]


def rankings(rows: Iterable[Mapping[str, str]]) -> str:
    """Return the file of rankings, made of the rows of a run's tables (`class` is the average)."""
    means: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row["class"] == AVERAGE:
            cell = means.setdefault((row["metric"], row["condition"]), {})
            cell[row["method"]] = float(row["failures_as_blank"])
    lines = []
    for (metric, condition), ranked in CHOSEN[BEST_CLASSICAL].ranking.items():
        cell = means.get((metric, condition), {})
        others = CHOSEN[BEST_CLASSICAL].ranking[OTHER_METRICS, condition]
        if cell:
            ranked = tuple(in_order(cell, higher_is_better(metric), others))
        lines.append([metric, condition, " ".join(ranked)])
    return csv_text(["metric", "condition", "best_first"], lines)


if __name__ == "__main__":
    tables = io.StringIO(values(read_run(Path(sys.argv[1])), FIRST))
    write_whole(RANKINGS, rankings(csv.DictReader(tables)).encode())
