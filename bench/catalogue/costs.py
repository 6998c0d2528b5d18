"""The cost of a view by method, and the choice of a method by it, from a table in the package.

`results/costs.csv` has a line for each method that was measured: the milliseconds of one view of a
new cloud of 2,048 points, its preparation included, on one thread (`bench run --suite
speed-accuracy`; an Intel Xeon at 996995d and e3aee2a; `poisson`, `true-mesh` and `constant` an AMD
EPYC at 2fdd148), and, for methods in grey that know objects of any kind, the mean of `ssim` and
1 - `lpips` over 107 real meshes of 13 classes at 2,048 points, truth in grey
(`results/docs/real-meshes-grey.csv`); more is better.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.catalogue.lookup import family_of
from data_prep.failures import BadInput

COSTS = Path(__file__).resolve().parents[2] / "results" / "costs.csv"
UNITS_MS = {"ms": 1.0, "s": 1000.0}


@dataclass(frozen=True)
class MeasuredMethod:
    """A method with the milliseconds of one view of a new cloud, and its score or None."""

    method: str
    cost_ms: float
    score: float | None


def measured_methods() -> tuple[MeasuredMethod, ...]:
    """Return the lines of the table."""
    with COSTS.open(encoding="utf-8", newline="") as file:
        return tuple(
            MeasuredMethod(
                row["method"], float(row["cost_ms"]), float(row["score"]) if row["score"] else None
            )
            for row in csv.DictReader(file)
        )


def view_costs_ms() -> dict[str, float]:
    """Return the milliseconds of one view of a new cloud by method."""
    return {measured.method: measured.cost_ms for measured in measured_methods()}


def cost_of(method_id: str, costs: Mapping[str, float]) -> float | None:
    """Return the cost of a method, or for one that was not measured that of its family."""
    return costs.get(method_id, costs.get(family_of(method_id)))


def best_within(budget_ms: float) -> MeasuredMethod:
    """Return the method with the best score that draws a view of a new cloud within a budget.

    Raises BadInput for a budget below the cheapest, which it names with its cost.
    """
    scored = {m: m.score for m in measured_methods() if m.score is not None}
    within = [m for m in scored if m.cost_ms <= budget_ms]
    if not within:
        cheapest = min(scored, key=lambda m: m.cost_ms)
        least = math.ceil(10 * cheapest.cost_ms) / 10  # rounded up, so that giving it is enough
        raise BadInput(
            f"budget {budget_ms:g}ms: the cheapest method is {cheapest.method} with {least:g} ms "
            f"for one image; give at least {least:g}ms"
        )
    return max(within, key=lambda m: scored[m])


def budget_ms_of(text: str) -> float:
    """Return the milliseconds of a budget like "50ms" or "0.2s". Raises BadInput for other text."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(ms|s)", text.strip())
    budget = float(match[1]) * UNITS_MS[match[2]] if match else 0.0
    if not budget:
        raise BadInput(f"budget {text}: give a time over 0 with its unit, as in 50ms or 0.2s")
    return budget
