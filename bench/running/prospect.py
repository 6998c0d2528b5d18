"""What a run would do, without doing any of it: its plan, its folder, and what is there already."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bench.records.journal import MANIFEST, Journal, check_directory, read_lines
from bench.running import environment as manifests
from bench.running.estimate import Cell
from bench.running.options import Options, workers_of
from bench.running.protocol import Plan, Protocol, plan
from bench.running.work import Job
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Prospect:
    """A run that has not been started, or not now.

    there    keys of the jobs that count as done, items without a true picture included
    workers  processes of this machine
    """

    protocol: Protocol
    directory: Path
    todo: Plan
    there: frozenset[str]
    workers: int

    @property
    def left(self) -> dict[Cell, int]:
        """How many jobs are to be done, by method and condition; noughts included."""
        return count((*self.todo.references, *self.todo.items), self.there)

    def left_of_first(self, objects: int) -> dict[Cell, int]:
        """The same with `--limit`: of each class only so many, as the dataset orders them."""
        taken: dict[str, int] = {}
        first: set[tuple[str, str]] = set()
        for job in self.todo.references:
            number = taken[job.object.class_name] = taken.get(job.object.class_name, 0) + 1
            if number <= objects:
                first.add(job.item.object)
        jobs = (*self.todo.references, *self.todo.items)
        return count((job for job in jobs if job.item.object in first), self.there)


def count(jobs: Iterable[Job], there: frozenset[str]) -> dict[Cell, int]:
    """Jobs that are not `there`, by method and condition, in their order."""
    found: dict[Cell, int] = {}
    for job in jobs:
        cell = (job.method, job.condition)
        found[cell] = found.get(cell, 0) + (job.key not in there)
    return found


def look_ahead(options: Options, protocol: Protocol) -> Prospect:
    """What `bench run` would do with these. Nothing is written, nor locked.

    Raises BadInput as `bench.running.run.run` before it does its first job.
    """
    suite = protocol.suite
    directory = options.directory
    todo = plan(protocol, directory)
    workers = workers_of(suite, options)
    there: frozenset[str] = frozenset()
    if not options.fresh:
        check_directory(directory, manifests.describe(protocol, workers, {}))
        there = _there(directory, todo)
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return Prospect(protocol, directory, todo, there, workers)


def refuse_small(suite: str, what: str) -> BadInput:
    """For suites that are not made of items."""
    return BadInput(f"{what}: the suite {suite} takes minutes and has no plan; run it")


def _there(directory: Path, todo: Plan) -> frozenset[str]:
    journal = Journal(directory, read_lines(directory))
    settled = {job.key: journal.usable(job) for job in (*todo.references, *todo.items)}
    hopeless = {
        job.artifact
        for job in todo.references
        if (of := settled[job.key]) is not None and of.artifact_sha256 is None
    }
    return frozenset(
        job.key
        for job in (*todo.references, *todo.items)
        if settled[job.key] is not None or job.reference in hopeless
    )
