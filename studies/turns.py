"""Pieces of work timed in turns (A, B, A, B ...), so that other load slows all of them alike."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

Work = Callable[[], Any]


def in_turns(
    works: Sequence[Work],
    rounds: int,
    idle: int = 1,
    now: Callable[[], float] = time.perf_counter,
) -> list[list[float]]:
    """Return seconds of each piece of work by round; `idle` rounds before them are not counted."""
    seconds: list[list[float]] = [[] for _ in works]
    for _ in range(idle + rounds):
        for work, kept in zip(works, seconds, strict=True):
            start = now()
            work()
            kept.append(now() - start)
    return [kept[idle:] for kept in seconds]


def ratio(slow: Sequence[float], fast: Sequence[float]) -> str:
    """Return the ratio of the medians, and the smallest and largest of a round, as two columns."""
    of_rounds = [a / b for a, b in zip(slow, fast, strict=True)]
    span = f"{min(of_rounds):.2f}-{max(of_rounds):.2f}"
    return f"{median(slow) / median(fast):8.2f}  {span:<13}"


def load() -> str:
    """Return the load averages of the machine over 1, 5 and 15 minutes, as text."""
    return "load of the machine " + ", ".join(f"{average:.2f}" for average in os.getloadavg())
