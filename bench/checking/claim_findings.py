"""Findings about the claims of the paper: requirements, verdicts, and their correction.

A claim holds where everything that it requires is over 0. It is `supported` where all 95 %
intervals over objects are above 0, `contradicted` where one is below, and else `undecided`. A
difference smaller than the spread between trainings of the network is a tie: undecided, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from bench.analysis.comparison import Estimate
from bench.analysis.intervals import SIGNIFICANCE, StandardError

Verdict = Literal["supported", "contradicted", "undecided", "not testable here"]
VERDICTS: tuple[Verdict, ...] = ("supported", "contradicted", "undecided", "not testable here")


class Requirement(NamedTuple):
    """A value that has to be over 0 for a claim to hold."""

    name: str
    estimate: Estimate  # with its 95 % interval over objects; NaN where the objects are too few
    error: StandardError | None  # of the estimate; None where the objects are too few
    objects: int  # their number
    # From the lowest to the highest of several trainings of the network, which differ in their
    # seeds; 0 where that is not known, and where no weights are compared.
    spread: float = 0.0

    @property
    def shown(self) -> bool:
        """Return whether it is over 0, by its interval and by more than the spread."""
        return self.estimate.low > 0 and self.estimate.value > self.spread

    @property
    def refuted(self) -> bool:
        """Return whether it is below 0, by its interval and by more than the spread."""
        return self.estimate.high < 0 and self.estimate.value < -self.spread

    @property
    def p(self) -> float:
        """Return the two-sided p value of a true value of 0; NaN without an error."""
        return self.error.p_value(self.estimate.value) if self.error else math.nan

    def shifted(self, by: float, sign: int) -> Requirement:
        """Return the requirement that sign times this value, and `by` more, is over 0."""
        low, high = sorted(by + sign * end for end in self.estimate[1:])
        return self._replace(estimate=Estimate(by + sign * self.estimate.value, low, high))


@dataclass(frozen=True)
class ClaimFinding:
    """The finding of a run about a claim."""

    subject: str  # the method that the claim is about
    numbers: str  # of the run, with intervals
    requirements: tuple[Requirement, ...] = ()  # of the claim; none where it cannot be tested
    reason: str = ""  # why it cannot be tested, or a remark that belongs to it

    @property
    def verdict(self) -> Verdict:
        """Return the verdict by the intervals, not corrected for other claims."""
        ends = [(r.estimate.low, r.estimate.high) for r in self.requirements]
        if not ends or not np.isfinite(ends).all():
            return "not testable here"
        if all(requirement.shown for requirement in self.requirements):
            return "supported"
        refuted = any(requirement.refuted for requirement in self.requirements)
        return "contradicted" if refuted else "undecided"

    @property
    def p(self) -> float:
        """Return the p value of the verdict.

        All requirements have to be over 0, or one of them below: the largest p value where all are
        over 0, else the smallest of those below, times the number of requirements. NaN where the
        claim cannot be tested.
        """
        if self.verdict == "not testable here":
            return math.nan
        below = [r.p for r in self.requirements if r.estimate.value <= 0]
        if not below:
            return max(requirement.p for requirement in self.requirements)
        return min(1.0, len(self.requirements) * min(below))

    @property
    def objects(self) -> int:
        """Return the fewest objects of a requirement; 0 where the claim cannot be tested."""
        return min((requirement.objects for requirement in self.requirements), default=0)

    @property
    def why(self) -> str:
        """Return the requirements that do not hold, and the reason."""
        missed = [r.name for r in self.requirements if r.name and not r.shown]
        tied = any(abs(r.estimate.value) <= r.spread for r in self.requirements)
        parts = [f"not shown: {', '.join(missed)}" if missed else "", self.reason]
        if tied and self.verdict == "undecided":
            parts.append("smaller than the spread between trainings")
        if self.requirements and self.verdict == "not testable here":
            parts[0] = "too few objects for an interval"
        return "; ".join(filter(None, parts))


def corrected(findings: Sequence[ClaimFinding]) -> list[Verdict]:
    """Return the verdicts of a family of claims, corrected for their number by Holm's procedure.

    A claim stays supported or contradicted where its corrected p value is below 0.05, else it
    becomes undecided.
    """
    p_values = holm([finding.p for finding in findings])
    return [
        finding.verdict
        if finding.verdict in ("not testable here", "undecided") or p < SIGNIFICANCE
        else "undecided"
        for finding, p in zip(findings, p_values, strict=True)
    ]


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values corrected for their number, in their order; NaN stays and does not count."""
    known = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    corrected = [math.nan] * len(p_values)
    largest = 0.0
    for rank, (p, i) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        corrected[i] = largest
    return corrected
