"""Findings about a plug-in, one for each point of its contract, and their summary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Finding:
    """The result of checking one point of a contract.

    ok       whether the plug-in keeps the point
    subject  the name of the point
    text     what was found
    blocks   whether a run would fail or have false results where the point is not kept
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
    """Raised where a point of the contract is not kept; the message tells the problem.

    blocks    whether a run would fail or have false results
    evidence  what the check found out for later steps, which are carried out nevertheless
    """

    def __init__(self, message: str, blocks: bool = True, evidence: Any = None) -> None:
        super().__init__(message)
        self.blocks = blocks
        self.evidence = evidence


def checked_identity(version: object, identity: Callable[[], object] = str) -> str:
    """Return the text of `identity`, by which, with the version, a run knows its finished jobs.

    Raises ContractViolation for a version that is no whole number, and for an identity that is no
    text or is another one the second time.
    """
    if type(version) is not int:
        raise ContractViolation(f"version is {version!r}, expected a whole number")
    text, again = identity(), identity()
    if not isinstance(text, str):
        raise ContractViolation(f"identity() gives a {type(text).__name__}, expected a str")
    if text != again:
        raise ContractViolation(
            f"identity() gives {text!r}, then {again!r}, so that a run could not use its finished "
            "jobs"
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
    line = f"{blocking}, {warnings}"
    return f"{line}; next: {following}" if following else line


def _named(subjects: Sequence[str]) -> str:
    return f" ({', '.join(subjects)})" if subjects else ""
