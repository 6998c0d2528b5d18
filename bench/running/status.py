"""The state of a run before its start: what is left to do. Nothing is written, nor locked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from pathlib import Path

from bench.records.job import Job, Result
from bench.records.journal import MANIFEST, Journal, check_directory, read_index
from bench.running.extension import join
from bench.running.options import Options, workers_of
from bench.running.plan import Plan, plan
from bench.running.protocol import Protocol
from data_prep.failures import BadInput

MethodCondition = tuple[str, str]  # of ground truths GROUND_TRUTH and an empty condition


@dataclass(frozen=True)
class RunStatus:
    """A run that has not been started, or not now.

    Attributes
    ----------
    protocol : Protocol
    directory : Path
    plan : Plan
    completed_keys : frozenset of str
        Keys of the jobs that count as done, also those that have no true image to be scored with.
    workers : int
        Processes of this machine.
    """

    protocol: Protocol
    directory: Path
    plan: Plan
    completed_keys: frozenset[str]
    workers: int

    @property
    def left(self) -> dict[MethodCondition, int]:
        """Return how many jobs are left, by method and condition; zeros included.

        A job that is the same under every condition counts at the first.
        """
        return count(self.plan.jobs, self.completed_keys)


def count(jobs: Iterable[Job], completed_keys: Set[str]) -> dict[MethodCondition, int]:
    """Return how many jobs are not completed, by method and condition, in their order."""
    left: dict[MethodCondition, int] = {}
    for job in jobs:
        cell = (job.method, job.condition)
        left[cell] = left.get(cell, 0) + (job.key not in completed_keys)
    return left


def run_status(options: Options, protocol: Protocol) -> RunStatus:
    """Return what `bench run` would do.

    Raises BadInput as `bench.running.run.run` before it does its first job.
    """
    directory = options.directory
    workers = workers_of(protocol.suite, options)
    protocol, _ = join(options, protocol)
    planned = plan(protocol, directory)
    completed: frozenset[str] = frozenset()
    if not options.fresh:
        journal = Journal(directory, read_index(directory))
        results = journal.all_usable(planned.jobs)
        completed = frozenset((*results, *unscorable(planned, results)))
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return RunStatus(protocol, directory, planned, completed, workers)


def unscorable(planned: Plan, results: Mapping[str, Result]) -> dict[str, tuple[Job, str]]:
    """Return, by key, the jobs whose ground truth has failed, with the reason of its failure."""
    return {
        job.key: (job, truth.reason)
        for obj in planned.objects
        if (truth := results.get(obj.truth.key)) and not truth.has_images
        for job in obj.method_jobs
    }


def undrawn(planned: Plan, results: Mapping[str, Result]) -> set[str]:
    """Return the keys of the jobs without images, and of those whose ground truth has none."""
    failed = {key for key, result in results.items() if not result.has_images}
    return failed | unscorable(planned, results).keys()


def refuse_small(suite: str, request: str) -> BadInput:
    """Return the refusal of a request for a plan of a suite with a procedure of its own."""
    return BadInput(f"{request}: the suite {suite} takes minutes and has no plan; run it")
