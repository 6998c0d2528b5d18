"""The parts that configurations of trainings share; command lines read them without PyTorch."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Cadence:
    """The numbers of steps between two times that a training writes something.

    log         a row of losses, and a line on the screen
    sheet       an image of the progress
    checkpoint  the checkpoint
    """

    log: int = 10
    sheet: int = 500
    checkpoint: int = 500


DEFAULT_CADENCE = Cadence()


@dataclass(frozen=True)
class TimeLimit:
    """A limit of the time that a command may take, counted from when this object is made.

    seconds  the time
    text     the time as the user gave it
    clock    returns seconds
    """

    seconds: float
    text: str
    clock: Callable[[], float] = lambda: time.monotonic()
    started: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "started", self.clock())

    def left_s(self) -> float:
        """Return the seconds that are left; a negative number when the time is over."""
        return self.started + self.seconds - self.clock()
