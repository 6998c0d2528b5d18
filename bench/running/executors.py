"""Results of jobs: from the store of a run, or by running the jobs in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import lru_cache, partial

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
from bench.running.work import run_job
from data_prep.failures import MissingDependency
from data_prep.progress import log, progress

REFERENCES_KEPT = 4  # ground truths in memory: the jobs of an object follow each other


class JobPool:
    """An executor (`bench.running.isolation`) of jobs in worker processes of this machine.

    It has at most `workers` processes, and not more than there are jobs to come (`count`). A job
    that takes more than its limits or whose process dies becomes failed records.
    """

    def __init__(
        self,
        count: int,
        workers: int,
        limits: Limits,
        tasks_per_worker: int = TASKS_PER_WORKER,
    ) -> None:
        self._pool: TaskPool[Job, Result] = TaskPool(
            run_job, min(workers, count), limits, tasks_per_worker=tasks_per_worker
        )
        self.capacity = self._pool.capacity

    def submit(self, job: Job) -> None:
        """Start a job; at most `capacity` may be under way."""
        self._pool.submit(job)

    def wait_any(self) -> Iterator[Result]:
        """Wait until jobs have ended, and yield the result of each."""
        for job, result in self._pool.wait_any():
            yield failed(job, result.reason) if isinstance(result, WorkerFailure) else result

    def close(self) -> None:
        """Stop all workers at once."""
        self._pool.close()


def run_jobs(
    jobs: Sequence[Job],
    store: Store,
    title: str,
    start: Callable[[int], Executor[Job, Result]],
) -> dict[str, Result]:
    """Do the jobs that the store does not have yet, and return the results of all, by key.

    Records and artifacts are in the store, and nowhere else: memory does not grow with the images.
    `start` gives the executor for a number of jobs; it is closed here. Raises MissingDependency
    where going on makes no sense.
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
        closing(results(missing, len(missing), store, start)) as stream,
    ):
        for result in stream:
            done[result.key] = result
            failures += not result.has_images
            advance(failures)
    return done


def results(
    jobs: Iterable[Job | None],
    count: int,
    store: Store,
    start: Callable[[int], Executor[Job, Result]],
) -> Generator[Result, None, None]:
    """Do jobs, at most `count`, and yield each result, without contents, when the store has it.

    `jobs` is as in `submit_all`, `start` as in `run_jobs`. Raises MissingDependency where going on
    makes no sense, and BadInput where a ground truth has changed since it was drawn.
    """
    ready = map(partial(_with_reference, lru_cache(REFERENCES_KEPT)(store.artifact)), jobs)
    with closing(start(count)) as executor, closing(submit_all(ready, executor)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            store.append(result)
            yield result.without_contents()


def _with_reference(read: Callable[[str], bytes], job: Job | None) -> Job | None:
    """Return a job with the true images that it is scored against."""
    if job is None or job.reference_key is None:
        return job
    return replace(job, reference=read(job.reference_key))
