"""The order of the jobs of a run: object by object, for as long as the time allows.

All methods and conditions of an object come before the next object, so that a run that is stopped
has complete objects.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

from bench.records.job import Job, Result
from bench.running.plan import ObjectJobs, Plan
from data_prep.failures import BadInput

UNITS_S = {"s": 1, "m": 60, "h": 3600}
# Seconds that a run takes beside its jobs: to start the workers and load the weights, and for
# tables, figures and report at its end, which grow with the objects. From the default suite on two
# cores, and rather too much than too little.
START_S, END_S, END_OF_OBJECT_S = 8.0, 12.0, 1.2
JOB_S = 0.6  # of a worker for a job, in the mean of the default suite


def seconds_of(text: str) -> float:
    """Return the seconds of a time like "90s", "2m" or "1.5h".

    Raises BadInput for any other text, and for zero.
    """
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)([smh])", text.strip())
    seconds = float(match[1]) * UNITS_S[match[2]] if match else 0.0
    if not seconds:
        raise BadInput(f"--budget {text}: give a time over 0 with its unit, as in 90s, 2m or 1.5h")
    return seconds


def guess_s(obj: ObjectJobs, workers: int) -> float:
    """Return the seconds that an object is expected to take, before any has been done."""
    return len(obj.jobs) * JOB_S / workers


def end_s(objects: int) -> float:
    """Return the seconds for the tables, figures and report of so many objects."""
    return END_S + END_OF_OBJECT_S * objects


@dataclass
class Budget:
    """A time limit of a run, which decides whether to begin another object.

    The time counts from the creation of the budget.

    Attributes
    ----------
    seconds : float or None
        Limit of the whole run, its end included; None for no limit.
    guess_s : float
        Expected seconds of an object, as long as none has been done.
    clock : callable
        Returns the time in seconds.
    """

    seconds: float | None = None
    guess_s: float = 0.0
    clock: Callable[[], float] = time.monotonic
    _costs: list[float] = field(default_factory=list)
    _last: float | None = None  # when an object was complete, at first when a job was

    def __post_init__(self) -> None:
        self._begun = self.clock()

    def check(self) -> None:
        """Raise BadInput where not even one object would fit."""
        shortest = math.ceil(START_S + self.guess_s + end_s(1))
        if self.seconds is not None and self.seconds < shortest:
            raise BadInput(
                f"--budget {self.seconds:g}s: too short for one object with all methods and "
                f"conditions; give at least {shortest}s, or fewer of them"
            )

    def note(self, complete: bool) -> None:
        """Note that a job has ended, and with it an object if `complete`."""
        now = self.clock()
        if self._last is None:
            self._last = now
        if complete:
            self._costs.append(now - self._last)
            self._last = now

    def allows(self, complete: int, under_way: float) -> bool:
        """Return whether to begin another object, with so many complete and so many under way."""
        cost = max(self._costs, default=self.guess_s)
        end = end_s(complete + math.ceil(under_way) + 1)
        return self._fits((under_way + 1) * cost + end)

    def allows_jobs(self, complete: int) -> bool:
        """Return whether to go on with objects that are under way."""
        # They may take longer than was expected when they were begun.
        return self._fits(end_s(complete))

    def _fits(self, seconds: float) -> bool:
        return self.seconds is None or self.clock() - self._begun + seconds <= self.seconds


class Schedule:
    """The jobs of a run in the order of their start, and their results.

    Attributes
    ----------
    results : dict
        Results of the jobs that have ended, by key and without records.
    complete : list of str
        Names of the objects whose jobs have all ended. An object whose ground truth has failed is
        complete: there is nothing to score.
    scored : int
        Complete objects that have a ground truth.
    total : int
        Jobs of the run.
    left : int
        Jobs to be done, if there were no budget.
    """

    def __init__(
        self,
        planned: Plan,
        results: Mapping[str, Result],
        budget: Budget,
        order: Sequence[str] | None = None,
        enough: Callable[[], bool] | None = None,
    ) -> None:
        """Take the plan, earlier results, and the budget.

        `order` has the names of the objects as they are begun; None for their turns. `enough` is
        asked before another object is begun.
        """
        self._objects = planned.in_turns
        if order is not None:
            place = {name: i for i, name in enumerate(order)}
            self._objects = tuple(sorted(planned.objects, key=lambda obj: place[obj.name]))
        self._budget = budget
        self._enough = enough or (lambda: False)
        self._object_of = {job.key: obj for obj in self._objects for job in obj.jobs}
        self._open = {obj.name: {job.key for job in obj.jobs} for obj in self._objects}
        self.results: dict[str, Result] = {}
        self.complete: list[str] = []
        self.scored = 0
        self.total = self.left = sum(map(len, self._open.values()))
        for result in results.values():
            self._put(result)

    def jobs(self) -> Iterator[Job | None]:
        """Yield the jobs to be done; None where the next job waits for a ground truth.

        They end where the budget does not allow another object, or enough are done. The first
        object is always done.
        """
        truths: set[str] = set()
        begun: list[ObjectJobs] = []
        for obj, ahead in zip_longest(self._objects, self._objects[1:]):
            if not self._open[obj.name]:
                continue
            begun = [earlier for earlier in begun if self._open[earlier.name]]
            under_way = sum(len(self._open[o.name]) / len(o.jobs) for o in begun)
            allowed = not self._enough() and self._budget.allows(len(self.complete), under_way)
            if (self.complete or begun) and not allowed:
                return
            begun.append(obj)
            # Ground truths are drawn one object ahead: nothing waits for one but at the start.
            for truth in (obj.truth, ahead and ahead.truth):
                if truth and truth.key not in self.results and truth.key not in truths:
                    truths.add(truth.key)
                    yield truth
            while obj.truth.key not in self.results:
                yield None
            for job in obj.jobs:
                if self.complete and not self._budget.allows_jobs(len(self.complete)):
                    return
                if job.key in self._open[obj.name]:
                    yield job

    def take(self, result: Result) -> bool:
        """Note the result of a job, and return whether its object is complete by it."""
        complete = self._put(result.without_records())
        self._budget.note(complete)
        return complete

    def _put(self, result: Result) -> bool:
        self.results[result.key] = result
        obj = self._object_of[result.key]
        still_open = self._open[obj.name]
        before = len(still_open)
        still_open.discard(result.key)
        if result.key == obj.truth.key and not result.has_images:
            still_open.clear()
        self.left -= before - len(still_open)
        if not before or still_open:
            return False
        self.complete.append(obj.name)
        self.scored += self.results[obj.truth.key].has_images
        return True
