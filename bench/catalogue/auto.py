"""The choice of a method for a cloud by measured scores and costs, within a budget.

`auto` is the method that chooses, `auto@50ms` chooses among those that draw one image of a new
cloud in that time. A cloud is clean or noisy and has a number of points;
`bench.catalogue.auto_table` has the score and the cost of each method on such clouds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from data_prep.failures import BadInput

AUTO = "auto"
UNITS_MS = {"ms": 1.0, "s": 1000.0}


@dataclass(frozen=True)
class CloudEstimate:
    """The number of points of a cloud, and estimates of its noise and its spacing."""

    points: int
    noise: float
    spacing: float

    def note(self) -> str:
        """Return the estimate in words."""
        return f"{self.points} points, noise {self.noise:.3f}, spacing {self.spacing:.3f}"


@dataclass(frozen=True)
class Candidate:
    """A method with its score, more is better, and the milliseconds of one view of a new cloud."""

    method: str
    score: float
    cost_ms: float


@dataclass(frozen=True)
class AutoTable:
    """The measured scores and costs of methods on clouds of different kinds.

    Attributes
    ----------
    noisy_from : float
        Noise in spacings, beyond which a cloud is noisy.
    clean : mapping
        Candidates on clean clouds by the number of their points; a cloud has those of the nearest
        number, by ratio.
    noisy : mapping
        Candidates on noisy clouds, likewise.
    """

    noisy_from: float
    clean: Mapping[int, tuple[Candidate, ...]]
    noisy: Mapping[int, tuple[Candidate, ...]]

    def candidates(self, cloud: CloudEstimate) -> list[Candidate]:
        """Return the candidates for a cloud, the best first, with what they cost there.

        With more points than in that cell a method is taken to cost more in proportion.
        """
        is_noisy = cloud.noise > self.noisy_from * cloud.spacing
        cells = self.noisy if is_noisy else self.clean
        count = max(cloud.points, 1)
        measured = min(cells, key=lambda n: max(n / count, count / n))
        growth = max(cloud.points / measured, 1.0)
        costed = [Candidate(c.method, c.score, c.cost_ms * growth) for c in cells[measured]]
        return sorted(costed, key=lambda c: (-c.score, c.cost_ms))

    def choose(self, cloud: CloudEstimate, budget_ms: float | None) -> Candidate:
        """Return the best candidate within a budget; None: of all.

        Raises BadInput for a budget below the cheapest, which it names with its cost.
        """
        candidates = self.candidates(cloud)
        for candidate in candidates:
            if budget_ms is None or candidate.cost_ms <= budget_ms:
                return candidate
        assert budget_ms is not None
        raise too_small(budget_ms, candidates, f"a cloud of {cloud.points} points")

    def methods(self, budget_ms: float | None = None) -> list[str]:
        """Return the methods that some cloud may get, sorted.

        Raises BadInput for a budget below the cheapest on any cloud.
        """
        cells = (*self.clean.values(), *self.noisy.values())
        everything = [candidate for cell in cells for candidate in cell]
        within = {c.method for c in everything if budget_ms is None or c.cost_ms <= budget_ms}
        if budget_ms is not None and not within:
            raise too_small(budget_ms, everything, "any cloud")
        return sorted(within)


def too_small(budget_ms: float, candidates: Sequence[Candidate], cloud: str) -> BadInput:
    """Return the refusal of a budget that no candidate meets."""
    cheapest = min(candidates, key=lambda c: c.cost_ms)
    least = math.ceil(10 * cheapest.cost_ms) / 10  # rounded up, so that giving it is enough
    return BadInput(
        f"budget {budget_ms:g}ms: for {cloud} the cheapest method is {cheapest.method} with "
        f"{least:g} ms for one image; give at least {least:g}ms"
    )


def auto_id(budget_ms: float | None) -> str:
    """Return the id of the method that chooses within a budget; None: without a limit."""
    return AUTO if budget_ms is None else f"{AUTO}@{budget_ms:g}ms"


def budget_ms_of(text: str) -> float:
    """Return the milliseconds of a budget like "50ms" or "0.2s". Raises BadInput for other text."""
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(ms|s)", text.strip())
    budget = float(match[1]) * UNITS_MS[match[2]] if match else 0.0
    if not budget:
        raise BadInput(f"budget {text}: give a time over 0 with its unit, as in 50ms or 0.2s")
    return budget
