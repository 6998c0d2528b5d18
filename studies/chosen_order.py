"""The order of the methods that learn nothing by metric and condition: `results/chosen.csv`.

    python -m studies.chosen_order

By each metric that `results/docs/opponents-validation.csv` has, on validation objects of 13 classes
with a blank image for each failed one (docs/reconstruction.md has its command), the methods stand
by their means. Those that were not measured at a condition come last, and equal ones stand, as by
the other metrics; the order by these, the lines of `*`, stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from bench.catalogue.chosen import BEST_CLASSICAL, CHOSEN, OTHER_METRICS, RANKINGS
from bench.catalogue.metrics import higher_is_better
from bench.tables.table import csv_text
from data_prep.files.atomic_write import write_whole
from studies.documents import NUMBERS

VALIDATION = NUMBERS / "opponents-validation.csv"


def in_order(values: Mapping[str, float], higher: bool, otherwise: Sequence[str]) -> list[str]:
    """Return the methods of one condition by their values, the best first.

    Equal ones, and at the end those without a value, are in their order otherwise; what is not
    among these is left out.
    """
    measured = [method for method in otherwise if method in values]
    measured.sort(key=lambda method: -values[method] if higher else values[method])
    return [*measured, *(method for method in otherwise if method not in values)]


def rankings() -> str:
    """Return the file of rankings, made of the measurement."""
    others = {
        condition: ranked
        for (metric, condition), ranked in CHOSEN[BEST_CLASSICAL].ranking.items()
        if metric == OTHER_METRICS
    }
    rows = pd.read_csv(VALIDATION, dtype={"condition": str})
    lines = []
    for metric in ("ssim", "ssim-object", "lpips"):
        of_metric = rows[rows["metric"] == metric]
        for condition, otherwise in others.items():
            cell = of_metric[of_metric["condition"] == condition]
            values = dict(zip(cell["method"], cell["failures_as_blank"], strict=True))
            ranked = in_order(values, higher_is_better(metric), otherwise)
            lines.append([metric, condition, " ".join(ranked)])
    lines += [[OTHER_METRICS, condition, " ".join(r)] for condition, r in others.items()]
    return csv_text(["metric", "condition", "best_first"], lines)


if __name__ == "__main__":
    write_whole(RANKINGS, rankings().encode())
