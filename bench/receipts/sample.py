"""The choice of jobs to compute again, and their computation in a folder of the verifier."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from bench.records.job import Job, Result, failed
from bench.records.store import Store
from bench.running.executors import run_jobs
from bench.running.isolation import Executor
from bench.running.plan import ObjectJobs, Plan
from data_prep.randomness import generator


@dataclass(frozen=True)
class ChosenJobs:
    """An object whose ground truth is computed again, and some of its other jobs."""

    planned: ObjectJobs
    jobs: tuple[Job, ...]

    @property
    def all(self) -> tuple[Job, ...]:
        """Return the ground truth and the others."""
        return (self.planned.truth, *self.jobs)


def draw_jobs(plan: Plan, share: float, seed: int) -> list[ChosenJobs]:
    """Return a random share of a plan's jobs, as many of each method and condition as can be.

    Every job is as probable as any other. A method and condition has a second job among them only
    where all others have one, and all jobs of one are of different objects.
    """
    cells, objects = plan.jobs_per_object - 1, len(plan)
    places = drawn_places(cells, objects, math.ceil(share * cells * objects), seed)
    return [
        ChosenJobs(planned, tuple(planned.jobs[1 + cell] for cell in chosen))
        for number, chosen in places.items()
        for planned in [plan[number]]
    ]


def drawn_places(cells: int, objects: int, count: int, seed: int) -> dict[int, list[int]]:
    """Return the numbers of `count` random cells by the number of their object, both sorted."""
    rng = generator("receipt", seed)
    rounds = math.ceil(count / cells) if cells else 0
    orders = [rng.permutation(objects)[:rounds] for _ in range(cells)]
    drawn: list[tuple[int, int]] = []
    for number in range(rounds):
        left = count - len(drawn)
        drawn += [(int(orders[c][number]), int(c)) for c in rng.permutation(cells)[:left]]
    places: dict[int, list[int]] = {}
    for obj, cell in sorted(drawn):
        places.setdefault(obj, []).append(cell)
    return places


def draw_parts(parts: int, share: float, seed: int) -> list[int]:
    """Return the numbers of a random share of the parts of a run, at least one for a share over 0.

    They are sorted.
    """
    count = min(parts, max(1, round(share * parts))) if share > 0 else 0
    chosen = generator("receipt, parts", seed).choice(parts, count, replace=False)
    return sorted(int(number) for number in chosen)


def compute(
    chosen: Sequence[ChosenJobs], store: Store, start: Callable[[int], Executor[Job, Result]]
) -> None:
    """Compute the chosen jobs into an open store, ground truths first.

    `start` gives an executor for a number of jobs. Raises MissingDependency where a method cannot
    be run here.
    """
    truths = [obj.planned.truth for obj in chosen]
    drawn: Mapping[str, Result] = run_jobs(truths, store, "true images", start)
    ready: list[Job] = []
    for obj in chosen:
        truth = drawn[obj.planned.truth.key]
        if truth.has_images:
            ready += obj.jobs
            continue
        for job in obj.jobs:  # as in a run: there is nothing to score against
            store.append(failed(job, truth.reason))
    run_jobs(ready, store, "jobs", start)
