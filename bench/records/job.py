"""What a worker's time went into."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Spent:
    """Wall time of a worker on one job, in seconds, by what it went into.

    methods    loading, preparing, drawing
    metrics    scores and features
    rendering  the ground truth
    harness    the rest: clouds, artifacts
    """

    methods: float = 0.0
    metrics: float = 0.0
    rendering: float = 0.0
    harness: float = 0.0


NOTHING = Spent()


class Stopwatch:
    """Seconds by the fields of `Spent`, since it was made."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._seconds: dict[str, float] = {}

    @contextmanager
    def on(self, part: str) -> Iterator[None]:
        """Within, time goes to `part`, also where an exception ends it."""
        start = time.perf_counter()
        try:
            yield
        finally:
            taken = time.perf_counter() - start
            self._seconds[part] = self._seconds.get(part, 0.0) + taken

    def spent(self) -> Spent:
        """What went nowhere by name, went into the harness."""
        total = time.perf_counter() - self._start
        return Spent(**self._seconds, harness=total - sum(self._seconds.values()))


def shares(spent: Iterable[Spent], available_s: float) -> dict[str, float]:
    """Parts of 1 by the fields of `Spent`, of the seconds that all workers together had.

    What no method, metric or rendering has used counts as harness: workers that start, wait or
    idle while the tables are made.
    """
    every = list(spent)
    named = {
        part: sum(getattr(one, part) for one in every) / available_s
        for part in ("methods", "metrics", "rendering")
    }
    return named | {"harness": 1.0 - sum(named.values())}
