"""The best reconstruction at each condition: a row of the tables, not a method.

What a network is compared with should not be a weak rival, and which reconstruction is strong
depends on the cloud. So the tables have a row that is, at each condition, the reconstruction that
had the highest mean SSIM on validation chairs; no test object has a part in the choice.
"""

from __future__ import annotations

from collections.abc import Iterable

BEST_RECONSTRUCTION = "best-reconstruction"
# By condition, the best first: `python -m studies.best_reconstruction`.
RANKING: dict[str, tuple[str, ...]] = {
    "2048": ("alpha-shape", "surface-bpa", "surface-fit", "surface-apss"),
}


def best_reconstruction(condition: str, methods: Iterable[str]) -> str | None:
    """Which of the methods is the best reconstruction at a condition.

    None where there are not two reconstructions to choose from, and for conditions that no choice
    was made for.
    """
    there = set(methods)
    ranked = [method for method in RANKING.get(condition, ()) if method in there]
    return ranked[0] if len(ranked) > 1 else None
