"""Jobs in worker processes: whatever becomes of a worker becomes the records of its job."""

from __future__ import annotations

from collections.abc import Iterator

from bench.running.isolation import Limits, Lost, TaskPool
from bench.running.work import Job, Result, do, failed


class JobPool:
    """Does jobs in worker processes of this machine, an executor (`bench.running.executor`).

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
