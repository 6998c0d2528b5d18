"""Jobs in worker processes, and their outcomes: from the journal, or by running them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing

from bench.catalogue.suites import Limits
from bench.records.job import Job, Result, failed
from bench.records.journal import JobOutcome, Journal
from bench.running.isolation import Executor, Lost, TaskPool, feed
from bench.running.work import do
from data_prep.failures import MissingDependency
from data_prep.progress import progress, say


class JobPool:
    """Does jobs in worker processes of this machine, an executor (`bench.running.isolation`).

    At most `workers` of them, and not more than there are jobs to come (`count`). A job that takes
    more than its limits or whose process dies becomes failed records.
    """

    def __init__(self, count: int, workers: int, limits: Limits) -> None:
        self._pool: TaskPool[Job, Result] = TaskPool(do, min(workers, count), limits)
        self.room = self._pool.room

    def submit(self, job: Job) -> None:
        """Have a job done; at most `room` may be under way."""
        self._pool.submit(job)

    def collect(self) -> Iterator[Result]:
        """Wait until jobs have ended; the result of each."""
        for job, result in self._pool.collect():
            yield failed(job, result.reason) if isinstance(result, Lost) else result

    def close(self) -> None:
        """Stop all workers at once."""
        self._pool.close()


def do_jobs(
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
        say(f"{title}: {len(outcomes)} of {len(jobs)} are there from before")
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

    `jobs` as in `bench.running.isolation.feed`, `start` as in `do_jobs`. Raises MissingDependency
    where going on makes no sense.
    """
    with closing(start(count)) as executor, closing(feed(jobs, executor)) as stream:
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            journal.append(result)
            yield result
