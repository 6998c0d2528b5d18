"""Findings about a plug-in, a line for each point of its contract, and their summary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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


def checked_identity(version: object, identity: Callable[[], object] = str) -> str:
    """Return the text of `identity`, which names finished work, as the version does."""
    if type(version) is not int:
        raise ContractViolation(f"version is {version!r}, expected a whole number")
    text, again = identity(), identity()
    if not isinstance(text, str):
        raise ContractViolation(f"identity() gives a {type(text).__name__}, expected a str")
    if text != again:
        raise ContractViolation(
            f"identity() gives {text!r}, then {again!r}; finished work would be lost"
        )
    return text


def is_blocked(findings: Iterable[Finding]) -> bool:
    """Return whether a finding blocks a run or falsifies its results."""
    return any(finding.verdict == "FAIL" for finding in findings)


def summary(findings: Sequence[Finding], following: str = "") -> str:
    """Return one line: what blocks a run, what does not, and what `following` says to do next."""
    failed = [finding.subject for finding in findings if finding.verdict == "FAIL"]
    warned = [finding.subject for finding in findings if finding.verdict == "warn"]
    blocking = f"{len(failed)} {'blocks' if len(failed) == 1 else 'block'} a run{_named(failed)}"
    warnings = f"{len(warned)} warning{'' if len(warned) == 1 else 's'}{_named(warned)}"
    return f"{blocking}, {warnings}" + (f"; next: {following}" if following else "")


def _named(subjects: Sequence[str]) -> str:
    return f" ({', '.join(subjects)})" if subjects else ""
