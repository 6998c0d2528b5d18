"""Rows of the tables that are another method at each condition: the best of a group.

A network should not be compared with a weak rival, and which rival is strong depends on the cloud.
So the tables have a row that is, at each condition, the method of a group that had the best images
on validation objects; no test object has a part in the choice.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

BEST_RECONSTRUCTION = "best-reconstruction"
BEST_LEARNED_3D = "best-learned-3d"
# By condition, the best first: the mean of the ranks by ssim-object and lpips on validation
# objects of 13 classes (docs/reconstruction.md). 2048, 1024, 512 and noise up to 0.10 were measured
# with all methods; elsewhere the last ones stand as in an earlier measurement.
RANKINGS = Path(__file__).resolve().parents[2] / "results" / "chosen.csv"
_LEARNED_3D = ("occupancy-net",)


@dataclass(frozen=True)
class ChosenRow:
    """A row that is, at each condition, the best method of a group.

    Attributes
    ----------
    id : str
        Its name in tables and comparisons.
    ranking : mapping of str to tuple of str
        The methods of the group by condition, the best first.
    fewest : int
        Methods of the group that a run must have for the row to be a choice.
    """

    id: str
    ranking: Mapping[str, tuple[str, ...]]
    fewest: int

    def method(self, condition: str, methods: Iterable[str]) -> str | None:
        """Return the best of the methods at a condition.

        Return None with fewer than `fewest` of the group, and for a condition without a ranking.
        """
        available = set(methods)
        ranked = [method for method in self.ranking.get(condition, ()) if method in available]
        return ranked[0] if len(ranked) >= self.fewest else None

    def by_condition(self, conditions: Iterable[str], methods: Iterable[str]) -> dict[str, str]:
        """Return the best of the methods at each condition that has one."""
        available = set(methods)
        best = {condition: self.method(condition, available) for condition in conditions}
        return {condition: method for condition, method in best.items() if method}


def _rankings() -> dict[str, tuple[str, ...]]:
    with RANKINGS.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return {row["condition"]: tuple(row["best_first"].split()) for row in rows}


_RECONSTRUCTIONS = _rankings()
_ROWS = (
    ChosenRow(BEST_RECONSTRUCTION, _RECONSTRUCTIONS, fewest=2),
    # One network that learned in 3D is enough: readers look for the best of them by this name.
    ChosenRow(BEST_LEARNED_3D, dict.fromkeys(_RECONSTRUCTIONS, _LEARNED_3D), fewest=1),
)
CHOSEN = {row.id: row for row in _ROWS}
