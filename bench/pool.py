"""Jobs in worker processes: whatever becomes of a worker becomes the records of its job."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import closing

from bench.isolation import Limits, Lost, run_tasks
from bench.work import Job, Result, do, failed


def run_jobs(jobs: Iterable[Job], workers: int, limits: Limits) -> Generator[Result, None, None]:
    """The results of `jobs`, as they come. Closing the iterator stops all workers at once.

    A job that takes more than its limits or whose process dies becomes failed records.
    """
    with closing(run_tasks(jobs, do, workers, limits)) as stream:
        for job, result in stream:
            yield failed(job, result.reason) if isinstance(result, Lost) else result
