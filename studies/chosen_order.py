"""The order of the classical methods, by metric and condition: it writes `results/chosen.csv`.

    bench run --suite thirteen-classes --dataset procedural:validation --limit 2 --views 4 \
        --conditions 2048,1024,512,noise-0.05,noise-0.10 --out DIR --methods \
        surface-apss,surface-fit,surface-bpa,poisson,alpha-wrap,denoised-wrap,splat,splat-fill
    python -m studies.chosen_order DIR

For each metric and condition that the run has, methods are sorted by their means over 13 classes,
where a failed image counts as a blank one. Methods with equal means, and those that were not
measured at a condition, which come last, keep the order of the line whose metric is `*`. That line
is used for all metrics without one of their own. It does not change, and neither do the lines of
conditions that the run does not have.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from bench.analysis.paper import AVERAGE
from bench.analysis.run import read_run
from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN, OTHER_METRICS, RANKINGS
from bench.catalogue.metrics import higher_is_better
from bench.tables.table import csv_text
from data_prep.files.atomic_write import write_whole
from studies.measurements import FIRST, values


def in_order(means: Mapping[str, float], higher: bool, otherwise: Sequence[str]) -> list[str]:
    """Return methods sorted by their means, the best first.

    means      of a metric at a condition, by method
    higher     whether higher means are better
    otherwise  the methods in the order that decides between equal means; those without a mean come
               last, in this order. Methods that are not in it are left out
    """
    measured = [method for method in otherwise if method in means]
    unmeasured = [method for method in otherwise if method not in means]
    # `sort` keeps the order of equal ones, also where the highest comes first.
    measured.sort(key=lambda method: means[method], reverse=higher)
    return [*measured, *unmeasured]


def rankings(rows: Iterable[Mapping[str, str]]) -> str:
    """Return the text of `results/chosen.csv`, made of the rows of a run's tables of quality.

    Of these rows only the averages over classes are used.
    """
    means: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row["class"] == AVERAGE:
            by_method = means.setdefault((row["metric"], row["condition"]), {})
            by_method[row["method"]] = float(row["failures_as_blank"])
    ranking = CHOSEN[BEST_CLASSICAL].ranking
    lines = []
    for (metric, condition), before in ranking.items():
        by_method = means.get((metric, condition))
        ranked = before
        if by_method:
            others = ranking[OTHER_METRICS, condition]
            ranked = tuple(in_order(by_method, higher_is_better(metric), others))
        lines.append([metric, condition, " ".join(ranked)])
    return csv_text(["metric", "condition", "best_first"], lines)


if __name__ == "__main__":
    tables = io.StringIO(values(read_run(Path(sys.argv[1])), FIRST))
    write_whole(RANKINGS, rankings(csv.DictReader(tables)).encode())
