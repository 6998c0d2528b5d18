"""A run from its protocol to its records; and what a run would do, without doing it."""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.records.artifacts import Artifact
from bench.records.job import Job, Result, failed, shares
from bench.records.journal import (
    MANIFEST,
    JobOutcome,
    Journal,
    check_directory,
    open_journal,
    read_lines,
    set_aside,
    write_manifest,
)
from bench.records.parquet import JobRow, artifacts_of, write_features, write_jobs, write_records
from bench.records.record import GROUND_TRUTH, Record
from bench.running import environment as manifests
from bench.running.executors import JobPool, do_jobs
from bench.running.isolation import Executor
from bench.running.pilot import Cell
from bench.running.protocol import Options, Plan, Protocol, describe, plan, protocol_of, workers_of
from bench.running.ray import LOCAL, RayPool, connected, requirements
from data_prep.failures import BadInput
from data_prep.progress import say

Outputs = TypeVar("Outputs")


@dataclass(frozen=True)
class RunStatus:
    """A run that has not been started, or not now.

    there    keys of the jobs that count as done, items without a true image included
    workers  processes of this machine
    """

    protocol: Protocol
    directory: Path
    todo: Plan
    there: frozenset[str]
    workers: int

    @property
    def left(self) -> dict[Cell, int]:
        """How many jobs are to be done, by method and condition; zeros included."""
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


def look_ahead(options: Options, protocol: Protocol) -> RunStatus:
    """What `bench run` would do with these. Nothing is written, nor locked.

    Raises BadInput as `bench.running.run.run` before it does its first job.
    """
    suite = protocol.suite
    directory = options.directory
    todo = plan(protocol, directory)
    workers = workers_of(suite, options)
    there: frozenset[str] = frozenset()
    if not options.fresh:
        check_directory(directory, describe(protocol, workers, {}))
        there = _there(directory, todo)
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return RunStatus(protocol, directory, todo, there, workers)


def refuse_small(suite: str, what: str) -> BadInput:
    """For suites that are not made of items."""
    return BadInput(f"{what}: the suite {suite} takes minutes and has no plan; run it")


def _there(directory: Path, todo: Plan) -> frozenset[str]:
    journal = Journal(directory, read_lines(directory))
    every = (*todo.references, *todo.items)
    outcomes = {job.key: found for job in every if (found := journal.usable(job))}
    return frozenset(outcomes) | _unscorable(todo, outcomes).keys()


@dataclass(frozen=True)
class ExecutorFactory:
    """How to begin: `start` gives an executor for so many jobs.

    workers  processes at work at once
    cluster  what it is, for the manifest; None for this machine
    """

    start: Callable[[int], Executor[Job, Result]]
    workers: int
    cluster: dict[str, Any] | None


@contextmanager
def executor_factory(options: Options, protocol: Protocol) -> Iterator[ExecutorFactory]:
    """As requested; connected to the cluster for as long as the block lasts.

    Raises BadInput for options that have no meaning, and as `bench.running.ray.connected`.
    """
    suite = protocol.suite
    workers = workers_of(suite, options)
    if options.ray is None:
        start = partial(JobPool, workers=workers, limits=suite.limits)
        yield ExecutorFactory(start, workers, None)
        return
    if suite.frontier:
        raise BadInput(
            f"--ray: has no meaning for the suite {suite.id}, whose times are compared; leave it"
        )
    if options.workers is not None and options.ray != LOCAL:
        raise BadInput("--workers: has no meaning with --ray, whose nodes bring theirs; leave it")
    asked = requirements(protocol)
    with connected(options.ray, workers) as cluster:
        yield ExecutorFactory(
            lambda _: RayPool(cluster, suite.limits, asked), cluster.cpus, asdict(cluster)
        )


@dataclass(frozen=True)
class Measured:
    """A run whose records and features are written, while its directory is still locked.

    artifacts  the images of all jobs that have any: ground truths, then items
    seconds    what each stage took; whoever goes on adds to it
    """

    directory: Path
    suite: str
    artifacts: Sequence[Artifact]
    seconds: dict[str, float]


@dataclass(frozen=True)
class Finished(Generic[Outputs]):
    """A complete run: where it is, what was made of it, and how many items were done when.

    shares  of the workers' time, see `bench.records.job.shares`
    """

    directory: Path
    outputs: Outputs
    done: int
    reused: int
    failed: int
    seconds: dict[str, float]
    shares: dict[str, float]


def run(options: Options, publish: Callable[[Measured], Outputs]) -> Finished[Outputs]:
    """Carry out a run, or what is left of it.

    `publish` makes the outputs from the Parquet files; the run counts as finished after it. Raises
    BadInput for anything the user has to fix; what was done until then is kept.
    """
    begun = time.perf_counter()
    suite = find(options.suite, SUITES, "suite")
    directory = options.directory
    protocol, skipped = protocol_of(suite, options)
    todo = plan(protocol, directory)  # refuses weights that cannot be used
    with executor_factory(options, protocol) as factory:
        manifest = describe(protocol, factory.workers, skipped) | {"cluster": factory.cluster}
        return _carry_out(options, directory, protocol, todo, factory, manifest, begun, publish)


@contextmanager
def open_run(directory: Path, manifest: dict[str, Any], fresh: bool = False) -> Iterator[Journal]:
    """The journal of a run, whose directory is locked for as long as the block lasts.

    The manifest is written first, and again where the block ends without an error, with the time
    and what the block has added to it. `fresh` renames an old run first. Raises BadInput where the
    directory holds something else or another process writes there.
    """
    if fresh and (old := set_aside(directory)):
        say(f"the old run is now {old}")
    check_directory(directory, manifest)
    with open_journal(directory) as journal:
        write_manifest(directory, manifest)
        yield journal
        for line in journal.damage:
            say(line)
        write_manifest(directory, manifest | {"finished": manifests.now()})


def _carry_out(
    options: Options,
    directory: Path,
    protocol: Protocol,
    todo: Plan,
    factory: ExecutorFactory,
    manifest: dict[str, Any],
    begun: float,
    publish: Callable[[Measured], Outputs],
) -> Finished[Outputs]:
    suite, start = protocol.suite, factory.start
    seconds: dict[str, float] = {}
    with open_run(directory, manifest, options.fresh) as journal:
        with timed("ground truth", seconds):
            truths = do_jobs(todo.references, journal, "ground truth", start)
            _check_any_truth(todo, truths)
        with timed("items", seconds):
            unscorable = _unscorable(todo, truths)
            drawable = [job for job in todo.items if job.key not in unscorable]
            outcomes = do_jobs(drawable, journal, suite.id, start)
            outcomes |= {key: JobOutcome(None, reason) for key, (_, reason) in unscorable.items()}

        def records(row: JobRow) -> Sequence[Record]:
            lost = unscorable.get(row.key)
            return failed(*lost).records if lost else journal.lines.result(row.key).records

        extractors = [metric for metric, _ in protocol.features]
        rows = _in_order(todo, truths | outcomes)
        outputs = publish(write_parquet(directory, suite.id, rows, records, extractors, seconds))
        timing = (of.timing for every in (truths, outcomes) for of in every.values())
        of_workers = shares(timing, factory.workers * (time.perf_counter() - begun))
        manifest |= {
            "stage_seconds": seconds,
            "worker_shares": {part: round(share, 4) for part, share in of_workers.items()},
        }
    done = _count_new(todo, unscorable, journal)
    return Finished(
        directory,
        outputs,
        done=done,
        reused=len(todo.items) - done,
        failed=sum(outcomes[job.key].artifact_sha256 is None for job in todo.items),
        seconds=seconds,
        shares=of_workers,
    )


def write_parquet(
    directory: Path,
    suite: str,
    jobs: Sequence[JobRow],
    records: Callable[[JobRow], Sequence[Record]],
    features: Iterable[str],
    seconds: dict[str, float],
) -> Measured:
    """Write the results of jobs as Parquet files into a directory with a manifest.

    jobs      all jobs in the order of the plan: ground truths, then items
    records   gives those of a job; asked for once for each item
    features  extractors whose features are in the artifacts
    seconds   gets what it took, and goes on in what is returned
    """
    artifacts = artifacts_of(directory, jobs)
    with timed("tables", seconds):
        write_records(directory, [job for job in jobs if job.item.method != GROUND_TRUTH], records)
        write_jobs(directory, jobs)
        for metric in features:
            write_features(directory, metric, artifacts)
    return Measured(directory, suite, artifacts, seconds)


@contextmanager
def timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Within, time is added to `seconds[stage]`, rounded to tenths."""
    start = time.perf_counter()
    yield
    seconds[stage] = round(seconds.get(stage, 0.0) + time.perf_counter() - start, 1)


def _check_any_truth(todo: Plan, truths: Mapping[str, JobOutcome]) -> None:
    """One bad object among many is a failed record; if none can be drawn, the input is wrong."""
    if any(truth.artifact_sha256 for truth in truths.values()):
        return
    first = truths[todo.references[0].key].reason.removeprefix("input: ")
    raise BadInput(f"none of the {len(truths)} objects can be drawn; the first: {first}")


def _unscorable(todo: Plan, outcomes: Mapping[str, JobOutcome]) -> dict[str, tuple[Job, str]]:
    """By key, items whose ground truth has failed: the item, and the reason of the failure."""
    reasons: dict[Path | None, str] = {
        job.artifact: found.reason
        for job in todo.references
        if (found := outcomes.get(job.key)) and found.artifact_sha256 is None
    }
    return {
        job.key: (job, reasons[job.reference]) for job in todo.items if job.reference in reasons
    }


def _count_new(todo: Plan, unscorable: Container[str], journal: Journal) -> int:
    """Items that this start has done; one without a ground truth is done with that."""
    truths: dict[Path | None, str] = {job.artifact: job.key for job in todo.references}
    outcome_keys = (truths[j.reference] if j.key in unscorable else j.key for j in todo.items)
    return sum(key in journal.added for key in outcome_keys)


def _in_order(todo: Plan, outcomes: Mapping[str, JobOutcome]) -> list[JobRow]:
    every = (*todo.references, *todo.items)
    return [JobRow(job.key, job.item, outcomes[job.key].artifact_sha256) for job in every]
