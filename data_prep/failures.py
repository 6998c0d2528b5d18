"""The kinds of failure, distinguished because they end differently.

`BadInput` is for the user to fix: a command that meets it prints one line and exits with 2.
`StageFailure` is a result: a method could not render a cloud, the record says why, the run goes on.
"""

from __future__ import annotations


class BadInput(ValueError):
    """An input cannot be used. The message names what, the value found, and the remedy."""


class MissingDependency(BadInput):
    """A library or package that the work needs is not on this machine; the message says which."""


class CannotWrite(BadInput):
    """A file cannot be written: the disk is full, say, or the folder read-only."""


class StageFailure(RuntimeError):
    """A stage of a method handed on nothing usable.

    `stage` is a kebab-case name ("ball-pivoting"), `problem` says what was wrong ("no faces").
    """

    def __init__(self, stage: str, problem: str) -> None:
        super().__init__(f"{stage}: {problem}")
        self.stage = stage
        self.problem = problem

    def __reduce__(self) -> tuple[type[StageFailure], tuple[str, str]]:
        return (type(self), (self.stage, self.problem))  # it crosses process boundaries
