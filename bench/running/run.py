"""A run from its protocol to its records; and what a run would do, without doing it."""

from __future__ import annotations

import time
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
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
    read_manifest,
    set_aside,
    write_manifest,
)
from bench.records.parquet import JobRow, artifacts_of, write_features, write_jobs, write_records
from bench.records.record import GROUND_TRUTH, Record
from bench.running import environment as manifests
from bench.running.executors import JobPool, results
from bench.running.extension import KeptRun, join, pinned_request, refuse_narrowing
from bench.running.isolation import Executor
from bench.running.pilot import Cell
from bench.running.protocol import (
    LOCAL,
    Options,
    Plan,
    Protocol,
    describe,
    plan,
    protocol_of,
    workers_of,
)
from bench.running.ray import RayPool, connected, requirements
from bench.running.schedule import Budget, Schedule, guess_s
from data_prep.failures import BadInput
from data_prep.progress import log

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
        """Return how many jobs are to be done, by method and condition; zeros included.

        A job that is the same under every condition counts at the first.
        """
        return count(self.todo.jobs, self.there)


def count(jobs: Iterable[Job], there: frozenset[str]) -> dict[Cell, int]:
    """Jobs that are not `there`, by method and condition, in their order."""
    found: dict[Cell, int] = {}
    for job in jobs:
        cell = (job.method, job.condition)
        found[cell] = found.get(cell, 0) + (job.key not in there)
    return found


def run_status(options: Options, protocol: Protocol) -> RunStatus:
    """What `bench run` would do with these. Nothing is written, nor locked.

    Raises BadInput as `bench.running.run.run` before it does its first job.
    """
    suite = protocol.suite
    directory = options.directory
    protocol, _ = join(options, protocol)
    todo = plan(protocol, directory)
    workers = workers_of(suite, options)
    there: frozenset[str] = frozenset()
    if not options.fresh:
        there = _there(directory, todo)
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return RunStatus(protocol, directory, todo, there, workers)


def refuse_small(suite: str, what: str) -> BadInput:
    """For suites that are not made of items."""
    return BadInput(f"{what}: the suite {suite} takes minutes and has no plan; run it")


def _any_complete(options: Options, todo: Plan) -> bool:
    """Whether an earlier start has completed an object."""
    if options.fresh:
        return False
    lines = read_lines(options.directory)
    return any(all(job.key in lines for job in obj.jobs) for obj in todo.objects)


def _there(directory: Path, todo: Plan) -> frozenset[str]:
    journal = Journal(directory, read_lines(directory))
    outcomes = journal.usable_of(todo.jobs)
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
class WrittenRun:
    """A run whose records and features are written, while its directory is still locked.

    artifacts  the images of all jobs that have any: ground truths, then items
    seconds    what each stage took; whoever goes on adds to it
    """

    directory: Path
    suite: str
    artifacts: Sequence[Artifact]
    seconds: dict[str, float]


@dataclass(frozen=True)
class PartialRun:
    """What is complete of a run that goes on.

    manifest  as it would be, were that all
    jobs      of the complete objects: ground truths, then items
    records   gives those of an item
    """

    directory: Path
    manifest: dict[str, Any]
    jobs: Sequence[JobRow]
    records: Callable[[JobRow], Sequence[Record]]


class ProgressReporter(typing.Protocol):
    """Who is told how a run goes on."""

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """So many more jobs have ended; how many have failed since the start."""
        ...

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """One more object is complete. `snapshot` takes longer the more there are."""
        ...


# Gets title and number of the jobs to be done.
Watch = Callable[[str, int], AbstractContextManager[ProgressReporter]]


@dataclass(frozen=True)
class RunResult(Generic[Outputs]):
    """A run that is complete, or of which some objects are.

    outputs           of what is complete; None where the folder keeps those of the run before,
                      because these would be of fewer objects
    objects, planned  complete, and of the whole run
    interrupted       whether Ctrl-C ended it
    done, reused      jobs of this start, and of earlier ones; as in the progress, those that a
                      ground truth without images makes pointless are among them
    failed            jobs without images
    hopeless          methods without an image, though there is something to draw
    shares            of the workers' time, see `bench.records.job.shares`
    """

    directory: Path
    outputs: Outputs | None
    objects: int
    planned: int
    interrupted: bool
    done: int
    reused: int
    failed: int
    hopeless: tuple[str, ...]
    seconds: dict[str, float]
    shares: dict[str, float]


def run(
    options: Options, publish: Callable[[WrittenRun], Outputs], watch: Watch
) -> RunResult[Outputs]:
    """Carry out a run, or what is left of it, for as long as its budget allows.

    `publish` makes the outputs from the Parquet files; the run counts as finished after it. What a
    run in the folder has beyond the request is kept and goes on (`bench.running.extension`). Where
    the budget or Ctrl-C ends it, it is a run of the objects that are complete, unless the folder
    has outputs of more; the same options go on with the others. Raises BadInput for anything the
    user has to fix, and KeyboardInterrupt where no object is complete; what was done until then is
    kept.
    """
    begun = time.perf_counter()
    suite = find(options.suite, SUITES, "suite")
    if options.budget is not None and options.shard is not None:
        raise BadInput(
            f"--budget: has no meaning with --shard {options.shard}, whose objects are fixed; "
            "leave one of the two"
        )
    asked, skipped = protocol_of(suite, options)
    protocol, kept = join(options, asked)
    todo = plan(protocol, options.directory)  # refuses weights that cannot be used
    with executor_factory(options, protocol) as factory:
        budget = Budget(options.budget, guess_s(todo.objects[0], factory.workers))
        if options.budget is not None and not _any_complete(options, todo):
            budget.check()
        manifest = describe(protocol, factory.workers, skipped) | {
            "request": pinned_request(options, protocol),
            "cluster": factory.cluster,
            "planned": len(todo.objects),  # "objects" are those that are complete, at the end
        }
        return _carry_out(
            options, protocol, kept, todo, factory, budget, manifest, begun, publish, watch
        )


@contextmanager
def open_run(directory: Path, manifest: dict[str, Any], fresh: bool = False) -> Iterator[Journal]:
    """Yield the journal of a run, whose directory is locked for as long as the block lasts.

    The manifest is written first, and again where the block ends without an error, with the time
    and what the block has added to it. `fresh` renames an old run first. Raises BadInput where the
    directory holds something else, or more than this run would have, or another process writes
    there.
    """
    with _locked_journal(directory, manifest, fresh) as journal:
        refuse_narrowing(directory, manifest)
        write_manifest(directory, manifest)
        yield journal
        _write_finished(directory, manifest)


def _write_finished(directory: Path, manifest: dict[str, Any]) -> None:
    write_manifest(directory, manifest | {"finished": manifests.now()})


@contextmanager
def _locked_journal(directory: Path, manifest: dict[str, Any], fresh: bool) -> Iterator[Journal]:
    if fresh and (old := set_aside(directory)):
        log(f"the old run is now {old}")
    check_directory(directory, manifest)
    with open_journal(directory) as journal:
        yield journal
        for line in journal.damage:
            log(line)


def _carry_out(
    options: Options,
    protocol: Protocol,
    kept: KeptRun | None,
    todo: Plan,
    factory: ExecutorFactory,
    budget: Budget,
    manifest: dict[str, Any],
    begun: float,
    publish: Callable[[WrittenRun], Outputs],
    watch: Watch,
) -> RunResult[Outputs]:
    suite, directory = protocol.suite, options.directory
    seconds: dict[str, float] = {}
    with _locked_journal(directory, manifest, options.fresh) as journal:
        if kept is None:
            write_manifest(directory, manifest)
        elif read_manifest(directory) != kept.manifest:  # another process had the lock meanwhile
            raise BadInput(f"{directory}: another run has changed it just now; run again")
        schedule = Schedule(todo, journal.usable_of(todo.jobs), budget)
        reused = schedule.total - schedule.left

        def narrows() -> bool:
            """Return whether outputs of what is complete would lack an object of those before."""
            return kept is not None and not kept.objects <= {*schedule.complete}

        def snapshot() -> PartialRun:
            """And the manifest says what is complete."""
            part = todo.of(frozenset(schedule.complete))
            manifest["objects"] = [obj.name for obj in part.objects]
            unscorable = _unscorable(part, schedule.outcomes)

            def records(row: JobRow) -> Sequence[Record]:
                lost = unscorable.get(row.key)
                return failed(*lost).records if lost else journal.lines.result(row.key).records

            rows = _in_order(part, schedule.outcomes)
            return PartialRun(directory, manifest, rows, records)

        with timed("items", seconds):
            interrupted = _do(schedule, journal, factory, suite.id, snapshot, narrows, watch)
        _check_any_truth(todo, schedule.outcomes)
        outputs = None
        if not narrows():
            made = snapshot()
            extractors = [metric for metric, _ in protocol.features]
            write_manifest(directory, manifest)  # the tables are of these objects
            outputs = publish(
                write_parquet(directory, suite.id, made.jobs, made.records, extractors, seconds)
            )
        timing = (outcome.timing for outcome in schedule.outcomes.values())
        of_workers = shares(timing, factory.workers * (time.perf_counter() - begun))
        manifest |= {
            "stage_seconds": seconds,
            "worker_shares": {part: round(share, 4) for part, share in of_workers.items()},
        }
        if outputs is not None:
            _write_finished(directory, manifest)
    without = {key for key, found in schedule.outcomes.items() if found.artifact_sha256 is None}
    return RunResult(
        directory,
        outputs,
        objects=len(schedule.complete),
        planned=len(todo.objects),
        interrupted=interrupted,
        done=schedule.total - reused - schedule.left,
        reused=reused,
        failed=len(without | _unscorable(todo, schedule.outcomes).keys()),
        hopeless=_hopeless(todo, schedule),
        seconds=seconds,
        shares=of_workers,
    )


def _do(
    schedule: Schedule,
    journal: Journal,
    factory: ExecutorFactory,
    title: str,
    snapshot: Callable[[], PartialRun],
    narrows: Callable[[], bool],
    watch: Watch,
) -> bool:
    """Do the jobs; whether Ctrl-C came in between. Raises KeyboardInterrupt where that leaves
    nothing complete."""
    if not schedule.left:
        return False
    if schedule.outcomes:
        log(f"{title}: {len(schedule.outcomes)} jobs are there from before")
    failures = 0
    try:
        with (
            watch(f"{title}, jobs", schedule.left) as observer,
            closing(results(schedule.jobs(), schedule.left, journal, factory.start)) as stream,
        ):
            for result in stream:
                before = schedule.left
                complete = schedule.take(result)
                ended = before - schedule.left  # with a ground truth its items fail
                failures += ended * (result.artifact_sha256 is None)
                observer.on_jobs_done(ended, failures)
                if complete and schedule.scored and not narrows():
                    observer.on_object_done(snapshot)
    except KeyboardInterrupt:
        if not schedule.scored:
            raise
        return True
    return False


def write_parquet(
    directory: Path,
    suite: str,
    jobs: Sequence[JobRow],
    records: Callable[[JobRow], Sequence[Record]],
    features: Iterable[str],
    seconds: dict[str, float],
) -> WrittenRun:
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
    return WrittenRun(directory, suite, artifacts, seconds)


@contextmanager
def timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Within, time is added to `seconds[stage]`, rounded to tenths."""
    start = time.perf_counter()
    yield
    seconds[stage] = round(seconds.get(stage, 0.0) + time.perf_counter() - start, 1)


def _check_any_truth(todo: Plan, outcomes: Mapping[str, JobOutcome]) -> None:
    """One bad object among many is a failed record; if none can be drawn, the input is wrong."""
    truths = [outcomes[job.key] for job in todo.references if job.key in outcomes]
    if any(truth.artifact_sha256 for truth in truths):
        return
    first = truths[0].reason.removeprefix("input: ")
    raise BadInput(f"none of the {len(truths)} objects can be drawn; the first: {first}")


def _unscorable(todo: Plan, outcomes: Mapping[str, JobOutcome]) -> dict[str, tuple[Job, str]]:
    """By key, items whose ground truth has failed: the item, and the reason of the failure."""
    return {
        job.key: (job, found.reason)
        for obj in todo.objects
        if (found := outcomes.get(obj.truth.key)) and found.artifact_sha256 is None
        for job in obj.items
    }


def _hopeless(todo: Plan, schedule: Schedule) -> tuple[str, ...]:
    """Return the methods that have failed on all complete objects that can be drawn."""
    drawn = {
        key for key, outcome in schedule.outcomes.items() if outcome.artifact_sha256 is not None
    }
    complete = todo.of(frozenset(schedule.complete)).objects
    items = [job for obj in complete if obj.truth.key in drawn for job in obj.items]
    working = {job.method for job in items if job.key in drawn}
    return tuple(dict.fromkeys(job.method for job in items if job.method not in working))


def _in_order(todo: Plan, outcomes: Mapping[str, JobOutcome]) -> list[JobRow]:
    every = (*todo.references, *todo.items)
    shas = ((job, outcomes.get(job.key)) for job in every)  # None: the ground truth has failed
    return [JobRow(job.key, job.item, found and found.artifact_sha256) for job, found in shas]
