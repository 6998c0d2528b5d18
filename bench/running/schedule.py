"""Which job of a run is next: object by object, for as long as the time allows.

All methods and conditions of an object come before the next object, so that a run that is stopped
has complete objects. Ground truths are drawn one object ahead: nothing waits for one but at the
start.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import zip_longest

from bench.records.job import Job, Result
from bench.records.journal import JobOutcome
from bench.running.protocol import ObjectJobs, Plan
from data_prep.failures import BadInput

UNITS_S = {"s": 1, "m": 60, "h": 3600}
# Seconds that a run takes beside its jobs: to start the workers and load the weights, and for
# tables, figures and report at its end, which grow with the objects. From the default suite on two
# cores, and rather too much than too little.
START_S, END_S, END_OF_OBJECT_S = 8.0, 12.0, 1.2
JOB_S = 0.6  # of a worker for a job, in the mean of the default suite


def seconds_of(text: str) -> float:
    """A time like "90s", "2m" or "1.5h" in seconds. Raises BadInput for anything else, and zero."""
    found = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)([smh])", text.strip())
    seconds = float(found[1]) * UNITS_S[found[2]] if found else 0.0
    if not seconds:
        raise BadInput(f"--budget {text}: give a time over 0 with its unit, as in 90s, 2m or 1.5h")
    return seconds


def guess_s(obj: ObjectJobs, workers: int) -> float:
    """What an object costs, before any has been done."""
    return len(obj.jobs) * JOB_S / workers


def end_s(objects: int) -> float:
    """Seconds for the tables, figures and report of so many objects."""
    return END_S + END_OF_OBJECT_S * objects


@dataclass
class Budget:
    """Whether there is time for another object, by what objects have cost since the start.

    seconds  for the whole run, its end included; None: no limit
    guess_s  what an object costs, as long as none has been done
    clock    in seconds; the time counts from when this was made
    """

    seconds: float | None = None
    guess_s: float = 0.0
    clock: Callable[[], float] = time.monotonic
    _costs: list[float] = field(default_factory=list)
    _last: float | None = None  # when an object was complete, at first when a job was

    def __post_init__(self) -> None:
        self._begun = self.clock()

    def check(self) -> None:
        """Raises BadInput where not even one object would fit."""
        shortest = math.ceil(START_S + self.guess_s + end_s(1))
        if self.seconds is not None and self.seconds < shortest:
            raise BadInput(
                f"--budget {self.seconds:g}s: too short for one object with all methods and "
                f"conditions; give at least {shortest}s, or fewer of them"
            )

    def note(self, complete: bool) -> None:
        """A job has ended, and with it an object if `complete`."""
        now = self.clock()
        if self._last is None:
            self._last = now
        if complete:
            self._costs.append(now - self._last)
            self._last = now

    def allows(self, complete: int, under_way: float) -> bool:
        """Whether to begin another object, with so many complete and so many under way."""
        cost = max(self._costs, default=self.guess_s)
        end = end_s(complete + math.ceil(under_way) + 1)
        return self._fits((under_way + 1) * cost + end)

    def allows_jobs(self, complete: int) -> bool:
        """Whether to go on with objects that are under way: they may take longer than expected."""
        return self._fits(end_s(complete))

    def _fits(self, seconds: float) -> bool:
        return self.seconds is None or self.clock() - self._begun + seconds <= self.seconds


class Schedule:
    """The jobs of a run in the order of their start, and what has become of them.

    outcomes  by key, of the jobs that have ended
    complete  names of the objects whose jobs have all ended. Where the ground truth has failed,
              there is nothing to score, and the object is complete
    scored    how many of these have a ground truth
    total     how many jobs the run has
    left      how many of these are to be done, were there no budget
    """

    def __init__(self, todo: Plan, outcomes: Mapping[str, JobOutcome], budget: Budget) -> None:
        self._objects = todo.in_turns
        self._budget = budget
        self._object_of = {job.key: obj for obj in self._objects for job in obj.jobs}
        self._open = {obj.name: {job.key for job in obj.jobs} for obj in self._objects}
        self.outcomes: dict[str, JobOutcome] = {}
        self.complete: list[str] = []
        self.scored = 0
        self.total = self.left = sum(map(len, self._open.values()))
        for key, outcome in outcomes.items():
            self._put(key, outcome)

    def jobs(self) -> Iterator[Job | None]:
        """Those to be done. None: the next one waits for a ground truth that is under way.

        They end where the budget does not allow another object. The first one is always done.
        """
        truths: set[str] = set()
        begun: list[ObjectJobs] = []
        for obj, ahead in zip_longest(self._objects, self._objects[1:]):
            if not self._open[obj.name]:
                continue
            begun = [one for one in begun if self._open[one.name]]
            if (self.complete or begun) and not self._budget.allows(
                len(self.complete), sum(self._part_left(one) for one in begun)
            ):
                return
            begun.append(obj)
            for one in (obj, ahead):
                if one and one.truth.key not in self.outcomes and one.truth.key not in truths:
                    truths.add(one.truth.key)
                    yield one.truth
            while obj.truth.key not in self.outcomes:
                yield None
            for job in obj.jobs:
                if self.complete and not self._budget.allows_jobs(len(self.complete)):
                    return
                if job.key in self._open[obj.name]:
                    yield job

    def take(self, result: Result) -> bool:
        """Note what has become of a job; whether its object is complete by it."""
        complete = self._put(result.key, JobOutcome.of(result))
        self._budget.note(complete)
        return complete

    def _put(self, key: str, outcome: JobOutcome) -> bool:
        self.outcomes[key] = outcome
        obj = self._object_of[key]
        still_open = self._open[obj.name]
        before = len(still_open)
        still_open.discard(key)
        if key == obj.truth.key and outcome.artifact_sha256 is None:
            still_open.clear()
        self.left -= before - len(still_open)
        if not before or still_open:
            return False
        self.complete.append(obj.name)
        self.scored += self.outcomes[obj.truth.key].artifact_sha256 is not None
        return True

    def _part_left(self, obj: ObjectJobs) -> float:
        return len(self._open[obj.name]) / len(obj.jobs)
