"""Detection of a training that diverges: losses that are not finite, or explode."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from statistics import median

FACTOR = 100.0
WINDOW = 100  # logged steps
FIRST = 20  # logged steps that tell what a loss is like at the start


class TrainingDiverged(RuntimeError):
    """The failure of a training: a loss or weight is not finite, or a loss exploded."""


class DivergenceDetector:
    """A detector of exploding losses, fed with the losses that are logged.

    A loss explodes when it is more than FACTOR times what it was at the start (median of the FIRST
    logged values) *and* FACTOR times what it was of late (median of the last WINDOW). The recent
    past alone would not do: a cross entropy falls to 1e-5 while the discriminator wins and is back
    at 1 a step later, in health. Nor would the start alone: a loss may grow slowly. Zeros do not
    count, for they stand for terms that are left out; before FIRST values nothing is said.
    """

    def __init__(self, history: Mapping[str, Iterable[float]] | None = None) -> None:
        """Start from `history`, the losses logged before a resume, oldest first."""
        sizes = {name: _sizes(values) for name, values in (history or {}).items()}
        self._first = {name: some[:FIRST] for name, some in sizes.items()}
        self._recent = {name: deque(some, maxlen=WINDOW) for name, some in sizes.items()}

    def add(self, losses: Mapping[str, float]) -> str | None:
        """Take the losses of a logged step and return the first that is wrong, and how; or None."""
        problems = [self._add(name, value) for name, value in losses.items()]
        return next(filter(None, problems), None)

    def _add(self, name: str, value: float) -> str | None:
        first = self._first.setdefault(name, [])
        recent = self._recent.setdefault(name, deque(maxlen=WINDOW))
        usual = max(median(first), median(recent)) if len(first) == FIRST else math.inf
        for size in _sizes([value]):
            recent.append(size)
            if len(first) < FIRST:
                first.append(size)
        if abs(value) > FACTOR * usual:
            return f"{name} is {value:.3g}, {abs(value) / usual:.0f} times what it was"
        return None


def _sizes(values: Iterable[float]) -> list[float]:
    return [abs(float(value)) for value in values if value != 0]
