"""The listeners to a run, and the part of a run that they see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from bench.records.record import Record
from bench.records.store import Store
from bench.running.plan import ObjectJobs, Plan


@dataclass(frozen=True)
class PartialRun:
    """The complete objects of a run, which may still go on.

    Attributes
    ----------
    directory : Path
    manifest : dict
        Manifest that a run of these objects alone would have.
    plan : Plan
        Jobs of the complete objects.
    store : Store
        Has their results.
    planned : sequence of str
        Names of all objects that the run is to have.
    """

    directory: Path
    manifest: dict[str, Any]
    plan: Plan
    store: Store
    planned: Sequence[str]

    def read_records(self, obj: ObjectJobs) -> list[Record]:
        """Return all records of an object.

        A job that stands for every condition is there once for each.
        """
        return [
            replace(record, condition=job.condition)
            for job in obj.method_jobs
            for record in self.store.records(job.key)
        ]


class ProgressReporter(Protocol):
    """A listener to the progress of a run."""

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Report that `ended` more jobs have ended, and that `failed` of the run have failed."""
        ...

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Report that an object is complete. `snapshot` takes the longer the more there are."""
        ...


# Takes title and number of the jobs to be done.
Watch = Callable[[str, int], AbstractContextManager[ProgressReporter]]
