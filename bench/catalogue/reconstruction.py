"""The best reconstruction at each condition: a row of the tables, not a method.

What a network is compared with should not be a weak rival, and which reconstruction is strong
depends on the cloud. So the tables have a row that is, at each condition, the reconstruction that
had the highest mean SSIM on validation chairs; no test object has a part in the choice.
"""

from __future__ import annotations

from collections.abc import Iterable

BEST_RECONSTRUCTION = "best-reconstruction"
# By condition, the best first: mean SSIM, failed images as blank ones, of 8 validation chairs x 4
# views (docs/reconstruction.md).
RANKING: dict[str, tuple[str, ...]] = {
    "2048": (
        *("denoised-alpha", "alpha-shape", "pgr"),
        *("surface-fit", "surface-bpa", "poisson"),
        *("denoised-bpa", "surface-apss", "denoised-poisson"),
    ),
    "1024": (
        *("alpha-shape", "denoised-alpha", "pgr"),
        *("surface-bpa", "denoised-bpa", "poisson"),
        *("denoised-poisson", "surface-fit", "surface-apss"),
    ),
    "512": (
        *("denoised-alpha", "alpha-shape", "surface-bpa"),
        *("denoised-bpa", "pgr", "poisson"),
        *("denoised-poisson", "surface-fit", "surface-apss"),
    ),
    "256": (
        *("denoised-alpha", "denoised-bpa", "surface-bpa"),
        *("alpha-shape", "poisson", "denoised-poisson"),
        *("pgr", "surface-fit", "surface-apss"),
    ),
    "128": (
        *("denoised-bpa", "surface-bpa", "denoised-alpha"),
        *("alpha-shape", "denoised-poisson", "poisson"),
        *("pgr", "surface-fit", "surface-apss"),
    ),
    "noise-0.05": (
        *("denoised-alpha", "denoised-bpa", "denoised-poisson"),
        *("pgr", "poisson", "surface-bpa"),
        *("alpha-shape", "surface-fit", "surface-apss"),
    ),
    "noise-0.10": (
        *("denoised-alpha", "denoised-bpa", "denoised-poisson"),
        *("pgr", "surface-bpa", "poisson"),
        *("surface-fit", "alpha-shape", "surface-apss"),
    ),
    "noise-0.15": (
        *("denoised-alpha", "denoised-bpa", "denoised-poisson"),
        *("pgr", "surface-bpa", "poisson"),
        *("surface-fit", "alpha-shape", "surface-apss"),
    ),
    "noise-0.20": (
        *("denoised-alpha", "denoised-bpa", "denoised-poisson"),
        *("pgr", "surface-bpa", "poisson"),
        *("alpha-shape", "surface-fit", "surface-apss"),
    ),
    "outliers-0.01": (
        *("denoised-alpha", "alpha-shape", "surface-fit"),
        *("surface-bpa", "denoised-bpa", "surface-apss"),
        *("poisson", "denoised-poisson", "pgr"),
    ),
    "outliers-0.05": (
        *("denoised-alpha", "denoised-bpa", "surface-bpa"),
        *("denoised-poisson", "surface-fit", "poisson"),
        *("surface-apss", "alpha-shape", "pgr"),
    ),
    "outliers-0.10": (
        *("denoised-bpa", "surface-bpa", "denoised-poisson"),
        *("poisson", "denoised-alpha", "surface-fit"),
        *("surface-apss", "alpha-shape", "pgr"),
    ),
    "missing-0.25": (
        *("alpha-shape", "denoised-alpha", "pgr"),
        *("surface-fit", "poisson", "surface-bpa"),
        *("surface-apss", "denoised-bpa", "denoised-poisson"),
    ),
    "missing-0.50": (
        *("denoised-alpha", "alpha-shape", "pgr"),
        *("denoised-bpa", "surface-bpa", "surface-fit"),
        *("poisson", "denoised-poisson", "surface-apss"),
    ),
    "density-3": (
        *("alpha-shape", "denoised-alpha", "pgr"),
        *("surface-bpa", "denoised-bpa", "poisson"),
        *("denoised-poisson", "surface-fit", "surface-apss"),
    ),
    "density-10": (
        *("denoised-alpha", "alpha-shape", "pgr"),
        *("surface-bpa", "denoised-bpa", "poisson"),
        *("denoised-poisson", "surface-fit", "surface-apss"),
    ),
}


def best_reconstruction(condition: str, methods: Iterable[str]) -> str | None:
    """Return the best reconstruction among the methods at a condition.

    Return None without two reconstructions to choose from, and for a condition without a ranking.
    """
    available = set(methods)
    ranked = [method for method in RANKING.get(condition, ()) if method in available]
    return ranked[0] if len(ranked) > 1 else None


def best_by_condition(conditions: Iterable[str], methods: Iterable[str]) -> dict[str, str]:
    """Return the best reconstruction of each condition that has one."""
    available = set(methods)
    best = {condition: best_reconstruction(condition, available) for condition in conditions}
    return {condition: method for condition, method in best.items() if method}
