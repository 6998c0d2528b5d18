"""The kinds of failure.

The user has to fix a `BadInput`: a command prints its one line and exits with 2. A `StageFailure`
is a result: a method could not render a cloud, the record says why, and the run goes on.
"""

from __future__ import annotations

from collections.abc import Sequence

# Least ratio of difflib at which a name is suggested: so "chairs" suggests "chair-robustness", and
# "nosuch" suggests no method.
_SIMILAR = 0.5
MOST_NAMED = 5  # names that a message lists; it gives the number of the others


class BadInput(ValueError):
    """An input that cannot be used; the message names it, its value and the remedy."""


class MissingDependency(BadInput):
    """A library or package that is not installed; the message names it."""


class CannotWrite(BadInput):
    """A file that cannot be written, because of a full disk or a read-only folder."""


class NoFaces(BadInput):
    """A mesh file without faces: perhaps a point cloud, which can only be drawn."""


class StageFailure(RuntimeError):
    """A stage of a method without a usable result.

    Attributes
    ----------
    stage : str
        Name of the stage in kebab-case, such as "ball-pivoting".
    problem : str
        Reason, such as "no faces".
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
    """Return the refusal of a name that is not among `names`; it lists the first of these.

    `near` is the name to suggest, "" for the most similar one; `see` is a command that lists all.
    """
    import difflib

    similar = difflib.get_close_matches(wanted.lower(), names, n=1, cutoff=_SIMILAR)
    guess = near or "".join(similar)
    hint = f"did you mean '{guess}'? " if guess else ""
    more = len(names) - MOST_NAMED
    rest = f" and {more} more; see '{see}'" if more > 0 else ""
    return BadInput(
        f"unknown {kind} '{wanted}': {hint}there are {', '.join(names[:MOST_NAMED])}{rest}"
    )
