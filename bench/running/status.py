"""The state of a run before its start: what is left to do. Nothing is written, nor locked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.records.run_folder import MANIFEST, check_directory, read_store
from bench.records.store import Store
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
    left : dict
        Jobs that are left, by method and condition; zeros included. A job that is the same under
        every condition counts at the first.
    workers : int
        Processes of this machine.
    """

    protocol: Protocol
    directory: Path
    plan: Plan
    left: dict[MethodCondition, int]
    workers: int


def run_status(options: Options, protocol: Protocol) -> RunStatus:
    """Return what `bench run` would do.

    Raises BadInput as `bench.running.run.run` before it does its first job.
    """
    directory = options.directory
    workers = workers_of(protocol.suite, options)
    protocol, _ = join(options, protocol)
    planned = plan(protocol)
    left = dict.fromkeys(((job.method, job.condition) for job in planned[0].jobs), len(planned))
    if not options.fresh:
        with read_store(directory) as store:
            if not store.is_empty:
                for cell, done in Counter(_done(planned, store)).items():
                    left[cell] -= done
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return RunStatus(protocol, directory, planned, left, workers)


def _done(planned: Plan, store: Store) -> Iterator[MethodCondition]:
    """Yield the cell of each job that is done, or has no true image to be scored with."""
    for obj in planned:
        results = store.find([job.key for job in obj.jobs])
        truth = results.get(obj.truth.key)
        undrawn = truth is not None and not truth.has_images
        yield from (
            (job.method, job.condition) for job in obj.jobs if undrawn or job.key in results
        )


def refuse_small(suite: str, request: str) -> BadInput:
    """Return the refusal of a request for a plan of a suite with a procedure of its own."""
    return BadInput(f"{request}: the suite {suite} takes minutes and has no plan; run it")
