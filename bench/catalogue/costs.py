"""The cost of a view by method, as the documentation prints it.

It is read from `results/docs/frontier.csv`, which a checkout has and the wheel does not.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from bench.catalogue.lookup import family_of

FRONTIER = Path(__file__).resolve().parents[2] / "results" / "docs" / "frontier.csv"
CLEAN = "2048"
MEASURED = {  # of one size: by method or family, what was measured for it
    "splat-net@tiny": "splat-net@chair-tiny",
    "splat-net@tiny-grey": "splat-net@chair-tiny",
    "splat-net": "splat-net@chair",
}


def view_costs_ms(path: Path = FRONTIER) -> dict[str, float]:
    """Return the milliseconds of one view of a new cloud by method; empty without the file.

    The cloud has all its points, and its preparation is included.
    """
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {
            row["method"]: float(row["cost_ms"])
            for row in csv.DictReader(file)
            if (row["condition"], row["views"]) == (CLEAN, "1") and row["cost_ms"]
        }


def cost_of(method_id: str, costs: Mapping[str, float]) -> float | None:
    """Return the cost of a method, or for one that was not measured that of its like or family."""
    family = family_of(method_id)
    stand_ins = (method_id, MEASURED.get(method_id, ""), family, MEASURED.get(family, ""))
    return next((costs[id_] for id_ in stand_ins if id_ in costs), None)
