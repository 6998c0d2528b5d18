"""Findings about a plug-in, a line for each point of its contract, and their summary."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Finding:
    """The result of a check of a point of a contract.

    ok      whether the point is kept
    blocks  whether a run would fail or have false results where it is not kept
    """

    ok: bool
    subject: str
    text: str
    blocks: bool = True

    @property
    def verdict(self) -> str:
        """Return "ok", "warn" or "FAIL"."""
        if self.ok:
            return "ok"
        return "FAIL" if self.blocks else "warn"


class ContractViolation(Exception):
    """A point of the contract that is not kept; the message tells the problem.

    evidence  for later steps, which run nevertheless
    """

    def __init__(self, message: str, blocks: bool = True, evidence: Any = None) -> None:
        super().__init__(message)
        self.blocks = blocks
        self.evidence = evidence


def is_blocked(findings: Iterable[Finding]) -> bool:
    """Return whether a finding blocks a run or falsifies its results."""
    return any(finding.verdict == "FAIL" for finding in findings)


def summary(findings: Sequence[Finding]) -> str:
    """Return one line on which findings block a run, and which do not."""
    failed = [finding.subject for finding in findings if finding.verdict == "FAIL"]
    warned = [finding.subject for finding in findings if finding.verdict == "warn"]
    if not failed and not warned:
        return f"all {len(findings)} points of the contract are kept"
    if not failed:
        return f"nothing blocks a run; {_counted(warned)} to look at: {', '.join(warned)}"
    verb = "blocks" if len(failed) == 1 else "block"
    line = f"{_counted(failed)} {verb} a run: {', '.join(failed)}"
    if warned:
        line += f"; {len(warned)} {'does' if len(warned) == 1 else 'do'} not: {', '.join(warned)}"
    return line


def _counted(subjects: Sequence[str]) -> str:
    return f"{len(subjects)} finding{'' if len(subjects) == 1 else 's'}"
