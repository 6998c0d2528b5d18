"""The state of a run before its start: what is left to do, and what that takes. Nothing is written.

The time is that of the table of costs, which `bench list` shows too; the disk space is that of the
jobs in the folder.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.catalogue.costs import MeasuredMethod, cost_of
from bench.records.record import GROUND_TRUTH
from bench.records.run_folder import MANIFEST, check_directory, read_store
from bench.records.store import STORE, Store
from bench.running.extension import join
from bench.running.options import Options, workers_of
from bench.running.plan import Plan, plan
from bench.running.protocol import Protocol
from bench.running.schedule import START_S, end_s

# Of an image: it is scored in some 15 ms of a core; its bytes are those of the default suite.
IMAGE_S, IMAGE_B = 0.015, 7_000
TRUTH_MS = 5.0  # of a view of the true mesh


@dataclass(frozen=True)
class RunStatus:
    """A run that has not been started, or not now.

    Attributes
    ----------
    protocol : Protocol
    directory : Path
    plan : Plan
    left : dict
        Jobs that are left, by method; zeros included. A job that is the same under every condition
        counts once.
    workers : int
        Processes of this machine.
    stored_b : int
        Size of the store in the folder.
    """

    protocol: Protocol
    directory: Path
    plan: Plan
    left: dict[str, int]
    workers: int
    stored_b: int

    @property
    def jobs(self) -> int:
        """Return the number of jobs that are left."""
        return sum(self.left.values())

    @property
    def size_b(self) -> float:
        """Return the bytes of disk that the jobs left are expected to take."""
        done = self.plan.job_count - self.jobs
        return self.jobs * (self.stored_b / done if done else IMAGE_B * self.protocol.views)

    def unmeasured(self, costs: Mapping[str, MeasuredMethod]) -> list[str]:
        """Return the methods with jobs left whose cost is not known."""
        return [m for m, jobs in self.left.items() if jobs and self._job_s(m, costs) is None]

    def seconds(self, costs: Mapping[str, MeasuredMethod]) -> float:
        """Return the time that the jobs left are expected to take, tables and figures included.

        `costs` are those of `bench.catalogue.costs`. Methods without a cost are left out.
        """
        of_cores = sum(jobs * (self._job_s(m, costs) or 0.0) for m, jobs in self.left.items())
        busy = max(1, min(self.workers, self.jobs))
        return START_S + of_cores / busy + end_s(len(self.plan))

    def _job_s(self, method: str, costs: Mapping[str, MeasuredMethod]) -> float | None:
        """Return the seconds of a core that a job takes, scores included; None if unknown."""
        views = self.protocol.views
        if method == GROUND_TRUTH:
            return views * (TRUTH_MS / 1000 + IMAGE_S)
        cost = cost_of(method, costs)
        return None if cost is None else cost.cloud_ms(views) / 1000 + views * IMAGE_S


def run_status(options: Options, protocol: Protocol) -> RunStatus:
    """Return what `bench run` would do.

    Raises BadInput as `bench.running.run.run` before it does its first job.
    """
    directory = options.directory
    workers = workers_of(protocol.suite, options)
    protocol, _ = join(options, protocol)
    planned = plan(protocol)
    left = Counter(job.method for job in planned[0].jobs)
    left = {method: jobs * len(planned) for method, jobs in left.items()}
    stored_b = 0
    if not options.fresh:
        with read_store(directory) as store:
            if not store.is_empty:
                stored_b = (directory / STORE).stat().st_size
                for method, done in Counter(_done(planned, store)).items():
                    left[method] -= done
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return RunStatus(protocol, directory, planned, left, workers, stored_b)


def _done(planned: Plan, store: Store) -> Iterator[str]:
    """Yield the method of each job that is done, or has no true image to be scored with."""
    for obj in planned:
        results = store.find([job.key for job in obj.jobs])
        truth = results.get(obj.truth.key)
        undrawn = truth is not None and not truth.has_images
        yield from (job.method for job in obj.jobs if undrawn or job.key in results)
