"""The cost of a view by method, as the documentation prints it.

It is read from `results/docs/frontier.csv`, which a checkout has and the wheel does not.
"""

from __future__ import annotations

import csv
from pathlib import Path

FRONTIER = Path(__file__).resolve().parents[2] / "results" / "docs" / "frontier.csv"
CLEAN = "2048"


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
