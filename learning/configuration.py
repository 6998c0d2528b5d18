"""The part that configurations of all trainings share; command lines load it without PyTorch."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Cadence:
    """The intervals, in steps, at which something is written."""

    log: int = 10
    sheet: int = 500
    checkpoint: int = 500


DEFAULT_CADENCE = Cadence()


@dataclass(frozen=True)
class TimeLimit:
    """The seconds that a command may take, counted from when this is made; `text` states them."""

    seconds: float
    text: str
    clock: Callable[[], float] = lambda: time.monotonic()  # tests replace it
    started: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "started", self.clock())

    def left_s(self) -> float:
        """Return the seconds that are left; below zero where the time is over."""
        return self.started + self.seconds - self.clock()
