"""What jobs come to: as the journal says, or by having them done and writing it down."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing

from bench.records.journal import Journal, Settled
from bench.running.executor import Executor, feed
from bench.running.progress import progress, say
from bench.running.work import Job, Result
from data_prep.failures import MissingDependency


def do_jobs(
    jobs: Sequence[Job],
    journal: Journal,
    title: str,
    start: Callable[[int], Executor[Job, Result]],
) -> dict[str, Settled]:
    """What became of all jobs by key: those in the journal, and the rest by doing them.

    Their records are in the journal, and nowhere else: memory does not grow with the pictures.

    `start` gives the executor for so many jobs; it is closed here. Raises MissingDependency where
    going on makes no sense.
    """
    settled = {job.key: found for job in jobs if (found := journal.usable(job))}
    missing = [job for job in jobs if job.key not in settled]
    if not missing:
        return settled
    if settled:
        say(f"{title}: {len(settled)} of {len(jobs)} are there from before")
    failures = 0
    with (
        progress(title, len(missing)) as advance,
        closing(start(len(missing))) as executor,
        closing(feed(missing, executor)) as stream,
    ):
        for result in stream:
            if result.unusable:
                raise MissingDependency(result.unusable)
            journal.append(result)
            settled[result.key] = Settled.of(result)
            failures += result.artifact_sha256 is None
            advance(failures)
    return settled
