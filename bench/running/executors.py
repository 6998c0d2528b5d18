"""Results of jobs: from the store of a run, or by running the jobs in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from typing import Any

from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.records.store import Store
from bench.running.isolation import (
    TASKS_PER_WORKER,
    Executor,
    TaskPool,
    WorkerFailure,
    submit_all,
)
from bench.running.work import (
    RenderedViews,
    draw_job,
    foreign_code,
    of_images_only,
    run_job,
    score_job,
)
from data_prep.failures import MissingDependency
from data_prep.progress import log, progress

_REFERENCES_KEPT = 4  # ground truths in memory: the jobs of an object follow each other


@dataclass(frozen=True, eq=False)
class _Step:
    """A job, or what is left of one whose images were drawn in the company of foreign code."""

    job: Job
    company: str
    drawn: RenderedViews | None = None

    def do(self) -> Result | RenderedViews:
        if self.drawn is not None:
            return score_job(self.job, self.drawn)
        return draw_job(self.job) if self.company else run_job(self.job)


class JobPool:
    """An executor (`bench.running.isolation`) of jobs in worker processes of this machine.

    At most `workers` of them are at work, and not more than there are jobs to come (`count`). A job
    that takes more than its limits or whose process dies becomes failed records; one that takes too
    long is tried once more before. The code of others draws in workers of its own, and the images
    are scored in ours.
    """

    def __init__(
        self, count: int, workers: int, limits: Limits, tasks_per_worker: int = TASKS_PER_WORKER
    ) -> None:
        more = {"tasks_per_worker": tasks_per_worker, "company": attrgetter("company")}
        self._pool: TaskPool[_Step, Any] = TaskPool(_Step.do, min(workers, count), limits, **more)
        self.capacity = self._pool.capacity
        self._late: set[str] = set()

    def submit(self, job: Job) -> None:
        """Start a job; at most `capacity` may be under way."""
        self._pool.submit(_Step(job, foreign_code(job)))

    def wait_any(self, timeout_s: float | None = None) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each; nothing after `timeout_s`."""
        for step, result in self._pool.wait_any(timeout_s):
            is_late = isinstance(result, WorkerFailure) and result.kind == "timeout"
            if isinstance(result, RenderedViews):  # it goes on by another step
                self._pool.submit(_Step(of_images_only(step.job), "", result))
            elif is_late and step.job.key not in self._late:
                self._late.add(step.job.key)  # the machine may have been busy
                self._pool.submit(step)
            elif isinstance(result, WorkerFailure):
                yield failed(step.job, result.reason, result.taken_s)
            else:
                yield result

    def close(self) -> None:
        """Stop all workers at once."""
        self._pool.close()


def run_jobs(
    jobs: Sequence[Job],
    store: Store,
    title: str,
    start: Callable[[int], Executor],
) -> dict[str, Result]:
    """Do the jobs that the store does not have yet, and return the results of all, by key.

    Raises as `do_and_store`.
    """
    done = store.find([job.key for job in jobs])
    missing = [job for job in jobs if job.key not in done]
    if not missing:
        return done
    if done:
        log(f"{title}: {len(done)} of {len(jobs)} are there from before")
    failures = 0
    with (
        progress(title, len(missing)) as advance,
        closing(do_and_store(missing, len(missing), store, start)) as stream,
    ):
        for result in stream:
            done[result.key] = result
            failures += not result.has_images
            advance(failures)
    return done


def do_and_store(
    jobs: Iterable[Job | None],
    count: int,
    store: Store,
    start: Callable[[int], Executor],
    left_s: Callable[[], float | None] = lambda: None,
) -> Generator[Result, None, None]:
    """Do jobs, at most `count`, and yield each result, without contents, when the store has it.

    `jobs` and `left_s` are as in `submit_all`, `start` gives the executor for a number of jobs; it
    is closed here. Raises MissingDependency where going on makes no sense, and BadInput where a
    ground truth has changed since it was drawn.
    """
    read = lru_cache(_REFERENCES_KEPT)(store.array)
    ready = (
        replace(job, reference=read(job.reference_key)) if job and job.reference_key else job
        for job in jobs
    )
    with closing(start(count)) as executor, closing(submit_all(ready, executor, left_s)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            store.append(result)
            yield replace(result, views=b"", arrays={})
