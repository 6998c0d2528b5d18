"""Rows of the tables that are another method at each condition: the best of a group.

A network should not be compared with a weak rival, and which rival is strong depends on the cloud.
So the tables have a row that is, at each condition, the method of a group that had the best images
on validation objects; no test object has a part in the choice.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

BEST_RECONSTRUCTION = "best-reconstruction"
BEST_LEARNED_3D = "best-learned-3d"
# By condition, the best first (docs/reconstruction.md).
_RECONSTRUCTIONS = {
    "2048": (
        "denoised-alpha alpha-shape pgr surface-fit surface-bpa poisson denoised-bpa "
        "surface-apss denoised-poisson"
    ),
    "1024": (
        "alpha-shape denoised-alpha pgr surface-bpa denoised-bpa poisson denoised-poisson "
        "surface-fit surface-apss"
    ),
    "512": (
        "denoised-alpha alpha-shape surface-bpa denoised-bpa pgr poisson denoised-poisson "
        "surface-fit surface-apss"
    ),
    "256": (
        "denoised-alpha denoised-bpa surface-bpa alpha-shape poisson denoised-poisson pgr "
        "surface-fit surface-apss"
    ),
    "128": (
        "denoised-bpa surface-bpa denoised-alpha alpha-shape denoised-poisson poisson pgr "
        "surface-fit surface-apss"
    ),
    "noise-0.05": (
        "denoised-alpha denoised-bpa denoised-poisson pgr poisson surface-bpa alpha-shape "
        "surface-fit surface-apss"
    ),
    "noise-0.10": (
        "denoised-alpha denoised-bpa denoised-poisson pgr surface-bpa poisson surface-fit "
        "alpha-shape surface-apss"
    ),
    "noise-0.15": (
        "denoised-alpha denoised-bpa denoised-poisson pgr surface-bpa poisson surface-fit "
        "alpha-shape surface-apss"
    ),
    "noise-0.20": (
        "denoised-alpha denoised-bpa denoised-poisson pgr surface-bpa poisson alpha-shape "
        "surface-fit surface-apss"
    ),
    "outliers-0.01": (
        "denoised-alpha alpha-shape surface-fit surface-bpa denoised-bpa surface-apss poisson "
        "denoised-poisson pgr"
    ),
    "outliers-0.05": (
        "denoised-alpha denoised-bpa surface-bpa denoised-poisson surface-fit poisson "
        "surface-apss alpha-shape pgr"
    ),
    "outliers-0.10": (
        "denoised-bpa surface-bpa denoised-poisson poisson denoised-alpha surface-fit "
        "surface-apss alpha-shape pgr"
    ),
    "missing-0.25": (
        "alpha-shape denoised-alpha pgr surface-fit poisson surface-bpa surface-apss "
        "denoised-bpa denoised-poisson"
    ),
    "missing-0.50": (
        "denoised-alpha alpha-shape pgr denoised-bpa surface-bpa surface-fit poisson "
        "denoised-poisson surface-apss"
    ),
    "density-3": (
        "alpha-shape denoised-alpha pgr surface-bpa denoised-bpa poisson denoised-poisson "
        "surface-fit surface-apss"
    ),
    "density-10": (
        "denoised-alpha alpha-shape pgr surface-bpa denoised-bpa poisson denoised-poisson "
        "surface-fit surface-apss"
    ),
}
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


_ROWS = (
    ChosenRow(
        BEST_RECONSTRUCTION,
        {condition: tuple(ranked.split()) for condition, ranked in _RECONSTRUCTIONS.items()},
        fewest=2,
    ),
    # One network that learned in 3D is enough: readers look for the best of them by this name.
    ChosenRow(BEST_LEARNED_3D, dict.fromkeys(_RECONSTRUCTIONS, _LEARNED_3D), fewest=1),
)
CHOSEN = {row.id: row for row in _ROWS}
