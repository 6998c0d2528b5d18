"""Results of jobs: from the journal, or by running the jobs in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing

from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.records.journal import Journal
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
    journal: Journal,
    title: str,
    start: Callable[[int], Executor[Job, Result]],
) -> dict[str, Result]:
    """Do the jobs that the journal does not have yet, and return the results of all, by key.

    Records are in the journal, and nowhere else: memory does not grow with the images. `start`
    gives the executor for a number of jobs; it is closed here. Raises MissingDependency where going
    on makes no sense.
    """
    done = journal.all_usable(jobs)
    missing = [job for job in jobs if job.key not in done]
    if not missing:
        return done
    if done:
        log(f"{title}: {len(done)} of {len(jobs)} are there from before")
    failures = 0
    with (
        progress(title, len(missing)) as advance,
        closing(results(missing, len(missing), journal, start)) as stream,
    ):
        for result in stream:
            done[result.key] = result.without_records()
            failures += not result.has_images
            advance(failures)
    return done


def results(
    jobs: Iterable[Job | None],
    count: int,
    journal: Journal,
    start: Callable[[int], Executor[Job, Result]],
) -> Generator[Result, None, None]:
    """Do jobs, at most `count`, and yield each result as soon as the journal has it.

    `jobs` is as in `submit_all`, `start` as in `run_jobs`. Raises MissingDependency where going on
    makes no sense.
    """
    with closing(start(count)) as executor, closing(submit_all(jobs, executor)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            journal.append(result)
            yield result
