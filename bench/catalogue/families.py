"""Families of conditions: one property of a cloud that is varied step by step.

A literal table. What the networks were trained on stands beside it, so that figures and tables can
say where they are beyond it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Family:
    """Conditions along a numeric axis, in the order in which clouds get worse.

    axis         what is varied, with its unit
    steps        (value on the axis, condition), values rising or falling
    trained      by network, the least and the most that it was shown in training
    logarithmic  whether equal factors are equal steps
    """

    id: str
    axis: str
    steps: tuple[tuple[float, str], ...]
    trained: tuple[tuple[str, float, float], ...]
    logarithmic: bool = False

    @property
    def values(self) -> tuple[float, ...]:
        """Return the values on the axis."""
        return tuple(value for value, _ in self.steps)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the conditions in the order of the axis."""
        return tuple(condition for _, condition in self.steps)

    def unseen_by(self, value: float) -> tuple[str, ...]:
        """Return the networks whose training had no cloud with this value on the axis."""
        return tuple(name for name, least, most in self.trained if not least <= value <= most)


# Of `splat-net@chair` the constants of learning/clouds.py; of `pc2pix` its bundled weights
# (pc2pix/weights/chair.md): it was shown at most 1,024 points, and of more it sees 1,024 at a time.
FAMILIES = (
    Family(
        "points",
        "points",
        ((2048, "2048"), (1024, "1024"), (512, "512"), (256, "256"), (128, "128")),
        trained=(("splat-net@chair", 512, 2048), ("pc2pix", 256, 2048)),
        logarithmic=True,
    ),
    Family(
        "noise",
        "noise: standard deviation, in radii of the unit sphere",
        (
            (0.0, "2048"),
            *((0.05, "noise-0.05"), (0.10, "noise-0.10")),
            *((0.15, "noise-0.15"), (0.20, "noise-0.20")),
        ),
        trained=(("splat-net@chair", 0.0, 0.12), ("pc2pix", 0.0, 0.10)),
    ),
    Family(
        "outliers",
        "outliers: share of the points",
        (
            (0.0, "2048"),
            *((0.01, "outliers-0.01"), (0.05, "outliers-0.05"), (0.10, "outliers-0.10")),
        ),
        trained=(("splat-net@chair", 0.0, 0.0), ("pc2pix", 0.0, 0.0)),
    ),
    Family(
        "missing",
        "missing on one side: share of the points",
        ((0.0, "2048"), (0.25, "missing-0.25"), (0.50, "missing-0.50")),
        trained=(("splat-net@chair", 0.0, 0.0), ("pc2pix", 0.0, 0.0)),
    ),
    Family(  # of 1,024 points all: beside them stands the stride
        "density",
        "density: densest end to sparsest, of 1,024 points",
        ((1.0, "1024"), (3.0, "density-3"), (10.0, "density-10")),
        trained=(("splat-net@chair", 1.0, 1.0), ("pc2pix", 1.0, 1.0)),
        logarithmic=True,
    ),
)


def families_of(conditions: Iterable[str]) -> tuple[Family, ...]:
    """Return the families with at least two of these conditions, reduced to them."""
    wanted = set(conditions)
    reduced = (
        replace(family, steps=tuple(step for step in family.steps if step[1] in wanted))
        for family in FAMILIES
    )
    return tuple(family for family in reduced if len(family.steps) > 1)
