"""The digits that values are printed with: those of their metric, or fewer of some methods.

Of some methods rounding alone moves the last digits. `results/decimals.csv` has the decimals that a
mean over 24 objects keeps, at each condition of `chair-robustness`, by method and metric; variants
of a method (`alpha-wrap@cell=2`) have the decimals of the method. What it does not list keeps all
decimals of its metric.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from bench.catalogue.lookup import family_of
from bench.catalogue.metrics import higher_is_better, metric_facts

DECIMALS_FILE = Path(__file__).resolve().parents[2] / "results" / "decimals.csv"


def decimals(metric: str, *methods: str) -> int:
    """Return how many digits after the point a value of these methods is printed with.

    They are the digits of the metric, or fewer where `results/decimals.csv` says so of a method; a
    difference of two methods has the fewer digits of the two.
    """
    every = metric_facts(metric).decimals
    of_methods = [_kept().get((family_of(method), metric), every) for method in methods]
    return min([every, *of_methods])


def prints_better(metric: str, value: float, other: float, *methods: str) -> bool:
    """Return whether a value is better than another in the digits that both are printed with.

    methods  the methods that the two values are of
    """
    # Also where no method has fewer digits: values of the same images differ by 1e-6 where sums
    # were taken in another order.
    digits = decimals(metric, *methods)
    gain = round(value, digits) - round(other, digits)
    return gain > 0 if higher_is_better(metric) else gain < 0


def is_coarse(metric: str, *methods: str) -> bool:
    """Return whether a value of the methods has fewer digits than its metric."""
    return decimals(metric, *methods) < metric_facts(metric).decimals


@cache
def _kept() -> Mapping[tuple[str, str], int]:
    """Return by method and metric the decimals that are kept, where the metric has more."""
    with DECIMALS_FILE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {(row["method"], row["metric"]): int(row["decimals"]) for row in rows}
