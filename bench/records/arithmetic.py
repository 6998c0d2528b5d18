"""The arithmetic of a job: how it is to be computed, where that is not as everywhere else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "plain",
    "random",
    "down",
    "up",
    "toward-zero",
    "two-threads",
    "one-view",
    "float64",
    "bfloat16",
    "float16",
]
FORMATS: tuple[Kind, ...] = ("float64", "bfloat16", "float16")  # of networks
INPUT = "input"  # the stage of a job that is its cloud
SEPARATOR = "~"  # between a condition and the id of an arithmetic


@dataclass(frozen=True)
class Arithmetic:
    """One way of computing a job.

    Attributes
    ----------
    kind : Kind
        "plain" is that of all other suites; "random" draws the rounding mode of each native call
        and moves each coordinate of the cloud by at most one unit in the last place; "down", "up"
        and "toward-zero" are IEEE's directed modes; "two-threads" and "one-view" change the number
        of threads and of views drawn in a call; the others are number formats of networks.
    stages : tuple of str
        The stages that it is limited to; none for all from the input to the metrics.
    repetition : int
        Its number, by which random choices differ.
    """

    kind: Kind
    stages: tuple[str, ...] = ()
    repetition: int = 0

    @property
    def id(self) -> str:
        """Return its name, such as "up", "random-07" or "random-apss-07"."""
        repetition = [f"{self.repetition:02d}"] if self.kind == "random" else []
        return "-".join([self.kind, *self.stages, *repetition])

    @property
    def moves_input(self) -> bool:
        """Return whether it moves the last bits of the cloud."""
        return self.kind == "random" and (not self.stages or INPUT in self.stages)

    @property
    def number_format(self) -> str:
        """Return the number format that networks compute in; empty for that of their weights."""
        return self.kind if self.kind in FORMATS else ""


PLAIN = Arithmetic("plain")
