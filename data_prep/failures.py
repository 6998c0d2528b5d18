"""The kinds of failure, distinguished because they end differently.

`BadInput` is for the user to fix: a command that meets it prints one line and exits with 2.
`StageFailure` is a result: a method could not render a cloud, the record says why, the run goes on.
"""

from __future__ import annotations

from collections.abc import Sequence

SIMILAR = 0.5  # of difflib's ratio: "chairs" is like "chair-robustness", "nosuch" like no method
MOST_NAMED = 5  # names in a message


class BadInput(ValueError):
    """An input cannot be used. The message names what, the value found, and the remedy."""


class MissingDependency(BadInput):
    """A library or package that the work needs is not on this machine; the message says which."""


class CannotWrite(BadInput):
    """A file cannot be written: the disk is full, say, or the folder read-only."""


class NoFaces(BadInput):
    """The file of a mesh holds no faces: it may be a point cloud, which can only be drawn."""


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


def unknown(
    wanted: str, names: Sequence[str], kind: str, near: str = "", see: str = "bench list"
) -> BadInput:
    """Return an error that there is no `kind` of the name `wanted`.

    Its message suggests `near`, else the nearest of `names` where one is similar, and has the first
    of them; the command `see` prints all.
    """
    import difflib

    similar = difflib.get_close_matches(wanted.lower(), names, n=1, cutoff=SIMILAR)
    guess = near or "".join(similar)
    hint = f"did you mean '{guess}'? " if guess else ""
    more = len(names) - MOST_NAMED
    rest = f" and {more} more; see '{see}'" if more > 0 else ""
    return BadInput(
        f"unknown {kind} '{wanted}': {hint}there are {', '.join(names[:MOST_NAMED])}{rest}"
    )
