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
    """Return the digits after the point that a value of a metric is printed with.

    Of a method it may have fewer; a difference of methods has those of the coarser value.
    """
    every = metric_facts(metric).decimals
    return min([every, *(_kept().get((family_of(method), metric), every) for method in methods)])


def prints_better(metric: str, value: float, other: float, *methods: str) -> bool:
    """Return whether a value is better than another of these methods, in the digits of both."""
    # Also of others: the same images drawn in another order of sums differ by 1e-6.
    digits = decimals(metric, *methods)
    gain = round(value, digits) - round(other, digits)
    return gain > 0 if higher_is_better(metric) else gain < 0


def is_coarse(metric: str, *methods: str) -> bool:
    """Return whether a value of the methods has fewer digits than its metric."""
    return decimals(metric, *methods) < metric_facts(metric).decimals


@cache
def _kept() -> Mapping[tuple[str, str], int]:
    """Return the decimals that methods keep, where these are fewer than the metric has."""
    with DECIMALS_FILE.open(encoding="utf-8", newline="") as file:
        return {(r["method"], r["metric"]): int(r["decimals"]) for r in csv.DictReader(file)}
