"""Jobs in worker processes, and their outcomes: from the journal, or by running them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing

from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.records.journal import JobOutcome, Journal
from bench.running.isolation import Executor, TaskPool, WorkerFailure, submit_all
from bench.running.work import run_job
from data_prep.failures import MissingDependency
from data_prep.progress import log, progress


class JobPool:
    """Does jobs in worker processes of this machine, an executor (`bench.running.isolation`).

    At most `workers` of them, and not more than there are jobs to come (`count`). A job that takes
    more than its limits or whose process dies becomes failed records.
    """

    def __init__(self, count: int, workers: int, limits: Limits) -> None:
        self._pool: TaskPool[Job, Result] = TaskPool(run_job, min(workers, count), limits)
        self.capacity = self._pool.capacity

    def submit(self, job: Job) -> None:
        """Have a job done; at most `capacity` may be under way."""
        self._pool.submit(job)

    def wait_any(self) -> Iterator[Result]:
        """Wait until jobs have ended; the result of each."""
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
) -> dict[str, JobOutcome]:
    """What became of all jobs by key: those in the journal, and the rest by doing them.

    Their records are in the journal, and nowhere else: memory does not grow with the images.

    `start` gives the executor for so many jobs; it is closed here. Raises MissingDependency where
    going on makes no sense.
    """
    outcomes = journal.usable_of(jobs)
    missing = [job for job in jobs if job.key not in outcomes]
    if not missing:
        return outcomes
    if outcomes:
        log(f"{title}: {len(outcomes)} of {len(jobs)} are there from before")
    failures = 0
    with (
        progress(title, len(missing)) as advance,
        closing(results(missing, len(missing), journal, start)) as stream,
    ):
        for result in stream:
            outcomes[result.key] = JobOutcome.of(result)
            failures += result.artifact_sha256 is None
            advance(failures)
    return outcomes


def results(
    jobs: Iterable[Job | None],
    count: int,
    journal: Journal,
    start: Callable[[int], Executor[Job, Result]],
) -> Generator[Result, None, None]:
    """Do jobs, at most `count`; each result as it comes, written into the journal.

    `jobs` as in `submit_all`, `start` as in `run_jobs`. Raises MissingDependency
    where going on makes no sense.
    """
    with closing(start(count)) as executor, closing(submit_all(jobs, executor)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            journal.append(result)
            yield result
