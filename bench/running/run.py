"""A run from its protocol to its records."""

from __future__ import annotations

import math
import time
import typing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from bench.catalogue.chosen import MeasuredMethod, cost_of
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.records.artifacts import JobName
from bench.records.job import Job, Result, shares
from bench.records.parquet import write_features, write_records
from bench.records.record import GROUND_TRUTH, Record
from bench.records.run_folder import (
    MANIFEST,
    check_directory,
    open_folder,
    read_store,
    set_aside,
    write_manifest,
)
from bench.records.store import STORE, DamagedJob, Store
from bench.records.stored_artifacts import Artifact, StoredArtifacts
from bench.running.environment import now
from bench.running.executors import ExecutorFactory, executor_factory, results
from bench.running.extension import (
    KeptRun,
    is_complete,
    join,
    pinned_request,
    refuse_lost_modules,
    refuse_narrowing,
)
from bench.running.isolation import Executor
from bench.running.options import Options, workers_of
from bench.running.plan import ObjectJobs, Plan, plan
from bench.running.protocol import Protocol, describe, protocol_of
from bench.running.schedule import START_S, Budget, Schedule, end_s, guess_s, seeded_turns
from data_prep.failures import BadInput
from data_prep.progress import log

Outputs = TypeVar("Outputs")
# Of an image: it is scored in some 15 ms of a core; its bytes are those of the default suite.
IMAGE_S, IMAGE_B = 0.015, 7_000
TRUTH_MS = 5.0  # of a view of the true mesh


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


class ProgressReporter(typing.Protocol):
    """A listener to the progress of a run."""

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Report that `ended` more jobs have ended, and that `failed` of the run have failed."""
        ...

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Report that an object is complete. `snapshot` takes the longer the more there are."""
        ...


# Takes title and number of the jobs to be done.
Watch = Callable[[str, int], AbstractContextManager[ProgressReporter]]


@dataclass(frozen=True)
class WrittenRun:
    """A run whose records and features are written, while its directory is still locked.

    Attributes
    ----------
    directory : Path
    suite : str
    artifacts : mapping
        The artifacts of all jobs that have images, by name.
    seconds : dict
        The time that each stage took; later stages add theirs.
    """

    directory: Path
    suite: str
    artifacts: Mapping[JobName, Artifact]
    seconds: dict[str, float]


@dataclass(frozen=True)
class RunResult(Generic[Outputs]):
    """A run of which all objects are complete, or some.

    Attributes
    ----------
    directory : Path
    outputs : Outputs or None
        Outputs of the complete objects; None where the folder keeps those of the run before,
        because these would be of fewer objects.
    objects, planned : int
        Complete objects, and objects of the whole run.
    interrupted : bool
        Whether Ctrl-C ended the run.
    done, reused, failed : int
        Jobs of this start, of earlier ones, and without images; with a failed ground truth all of
        its object. A job that is the same under every condition counts once, as in progress.
    hopeless : tuple of str
        Methods without a single image, though there is something to draw.
    seconds : dict
        The time of each stage.
    shares : dict
        Parts of the workers' time, see `bench.records.job.shares`.
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


@dataclass(frozen=True)
class _PreparedRun:
    """A run of which everything is decided and nothing is written yet.

    Attributes
    ----------
    plan, in_turns : Plan
        The objects in the order of the files, and in that of their start.
    manifest : dict
        Manifest that the run will have when all its objects are complete.
    kept : KeptRun or None
        The run in the folder, of which nothing may get lost.
    seen : bytes or None
        The manifest in the folder when all this was decided.
    begun : float
        The start, by `time.perf_counter`.
    """

    directory: Path
    fresh: bool
    protocol: Protocol
    plan: Plan
    in_turns: Plan
    manifest: dict[str, Any]
    kept: KeptRun | None
    seen: bytes | None
    budget: Budget
    begun: float

    def narrows(self, schedule: Schedule) -> bool:
        """Return whether outputs of the complete objects would lack an object of the kept run."""
        return self.kept is not None and not self.kept.objects <= {*schedule.complete}

    def snapshot(self, names: Iterable[str], store: Store) -> PartialRun:
        """Return the run of these complete objects."""
        part = self.plan.select(names)
        manifest = self.manifest | {"objects": part.names}
        return PartialRun(self.directory, manifest, part, store, self.plan.names)


def run(
    options: Options,
    publish: Callable[[WrittenRun], Outputs],
    watch: Watch,
    make_budget: Callable[[float | None], Budget] = Budget,
) -> RunResult[Outputs]:
    """Carry out a run, or what is left of it, for as long as its budget allows.

    What a run in the folder has beyond the request is kept and goes on (`bench.running.extension`).
    Where the budget or Ctrl-C ends it, it is a run of the objects that are complete, unless the
    folder has outputs of more; the same options go on with the others.

    Parameters
    ----------
    options : Options
    publish : callable
        Makes the outputs from the Parquet files; the run counts as finished after it.
    watch : callable
        Gives the reporter of progress.
    make_budget : callable
        Makes the budget from `--budget`, in seconds from now.

    Raises
    ------
    BadInput
        For anything the user has to fix.
    KeyboardInterrupt
        Where no object is complete; what was done until then is kept.
    """
    begun, budget = time.perf_counter(), make_budget(options.budget)
    suite = find(options.suite, SUITES, "suite")
    if options.budget is not None and options.shard is not None:
        raise BadInput(
            f"--budget: has no meaning with --shard {options.shard}, whose objects are fixed; "
            "leave one of the two"
        )
    requested, skipped = protocol_of(suite, options)
    seen = None if options.fresh else _manifest_bytes(options.directory)
    protocol, kept = join(options, requested)
    planned = plan(protocol)  # refuses weights that cannot be used
    if kept is not None:
        refuse_lost_modules(options.directory, requested, planned)
    in_turns = planned.in_order(seeded_turns(planned.names, protocol.seed))
    with executor_factory(options, protocol) as factory:
        budget.guess_s = guess_s(planned.jobs_per_object, factory.workers)
        if options.budget is not None and not _any_complete(options, planned):
            budget.check()
        manifest = describe(protocol, factory.workers, skipped) | {
            "request": pinned_request(options, protocol),
            "cluster": factory.cluster,
            "planned": len(planned),  # "objects" are those that are complete, at the end
        }
        if options.same_objects and kept is not None:
            manifest = kept.with_intention(manifest)
        prepared = _PreparedRun(
            *(options.directory, options.fresh, protocol, planned, in_turns, manifest, kept),
            *(seen, budget, begun),
        )
        return _carry_out(prepared, factory, publish, watch)


@contextmanager
def open_run(directory: Path, manifest: dict[str, Any], fresh: bool = False) -> Iterator[Store]:
    """Yield the store of a run, whose directory is locked for as long as the block lasts.

    The manifest is written first, and again where the block ends without an error, with the time
    and what the block has added to it. `fresh` renames an old run first. Raises BadInput where the
    directory holds something else, or more than this run would have, or another process writes
    there.
    """

    def check() -> None:
        if not fresh:
            refuse_narrowing(directory, manifest)
        check_directory(directory, manifest)

    with _open_checked(directory, check, fresh) as store:
        write_manifest(directory, manifest)
        yield store
        write_manifest(directory, manifest | {"finished": now()})


@contextmanager
def _open_checked(directory: Path, check: Callable[[], None], fresh: bool) -> Iterator[Store]:
    if fresh and (old := set_aside(directory)):
        log(f"the old run is now {old}")
    check()  # before anything is written there
    with open_folder(directory) as store:
        check()  # another process may have had the lock meanwhile
        try:
            yield store
        except DamagedJob as error:
            if error.path != store.path:  # of a shard
                raise
            count = store.forget_damaged(error.key)
            raise BadInput(
                f"{store.path}: the images or records of {count} jobs are missing or altered; run "
                "again, which draws them anew"
            ) from error


def _carry_out(
    prepared: _PreparedRun,
    factory: ExecutorFactory,
    publish: Callable[[WrittenRun], Outputs],
    watch: Watch,
) -> RunResult[Outputs]:
    directory, planned = prepared.directory, prepared.plan
    seconds: dict[str, float] = {}

    def check() -> None:
        check_directory(directory, prepared.manifest)
        if _manifest_bytes(directory) != prepared.seen:
            raise BadInput(f"{directory}: another run has changed it just now; run again")

    with _open_checked(directory, check, prepared.fresh) as store:
        if prepared.kept is None:
            write_manifest(directory, prepared.manifest)
        schedule = Schedule(
            prepared.in_turns,
            store,
            prepared.budget,
            ahead=math.ceil(factory.capacity / planned.jobs_per_object),
        )
        reused = schedule.total - schedule.left
        with timed("jobs", seconds):
            interrupted = _do_jobs(prepared, schedule, store, factory.start, watch)
        if not schedule.complete and not interrupted:
            raise BadInput(
                f"--budget {prepared.budget.seconds:g}s: used up before one object was complete; "
                f"{schedule.total - schedule.left} of its jobs are kept, and the same command goes "
                "on with the others: give it more time"
            )
        if schedule.undrawn and not schedule.scored:
            # One bad object among many is a failed record; if none can be drawn, the input is
            # wrong.
            reason = schedule.undrawn.removeprefix("input: ")
            raise BadInput(
                f"none of the {len(schedule.complete)} objects can be drawn; the first: {reason}"
            )
        part = None if prepared.narrows(schedule) else prepared.snapshot(schedule.complete, store)
        outputs = None
        if part is not None:
            write_manifest(directory, part.manifest)  # the tables are of these objects
            store.list_jobs((job.key, job.name) for obj in part.plan for job in obj.listed)
            extractors = [metric for metric, _ in prepared.protocol.features]
            outputs = publish(write_parquet(part.manifest, directory, store, extractors, seconds))
        of_workers = shares(
            schedule.timing, factory.workers * (time.perf_counter() - prepared.begun)
        )
        if part is not None:
            ending = {
                "stage_seconds": seconds,
                "worker_shares": {name: round(share, 4) for name, share in of_workers.items()},
                "finished": now(),
            }
            write_manifest(directory, part.manifest | ending)
    return RunResult(
        directory,
        outputs,
        objects=len(schedule.complete),
        planned=len(planned),
        interrupted=interrupted,
        done=schedule.total - reused - schedule.left,
        reused=reused,
        failed=schedule.failures,
        hopeless=tuple(m for m in prepared.protocol.methods if m not in schedule.working),
        seconds=seconds,
        shares=of_workers,
    )


def _manifest_bytes(directory: Path) -> bytes | None:
    path = directory / MANIFEST
    return path.read_bytes() if path.is_file() else None


def _any_complete(options: Options, planned: Plan) -> bool:
    """Return whether an earlier start has completed an object."""
    if options.fresh:
        return False
    with read_store(options.directory) as store:
        return not store.is_empty and any(is_complete(obj, store) for obj in planned)


def _do_jobs(
    prepared: _PreparedRun,
    schedule: Schedule,
    store: Store,
    start: Callable[[int], Executor[Job, Result]],
    watch: Watch,
) -> bool:
    """Do the jobs that are left, and return whether Ctrl-C came in between.

    Raises KeyboardInterrupt where no object is complete by then.
    """
    if not schedule.left:
        return False
    title = prepared.protocol.suite.id
    if reused := schedule.total - schedule.left:
        log(f"{title}: {reused} jobs are there from before")
    try:
        with (
            watch(f"{title}, jobs", schedule.left) as reporter,
            closing(
                results(schedule.jobs(), schedule.left, store, start, schedule.left_s)
            ) as stream,
        ):
            for result in stream:
                before = schedule.left
                complete = schedule.take(result)
                # With a ground truth all jobs of its object fail.
                reporter.on_jobs_done(before - schedule.left, schedule.failures)
                if complete and schedule.scored and not prepared.narrows(schedule):
                    reporter.on_object_done(partial(prepared.snapshot, schedule.complete, store))
    except KeyboardInterrupt:
        if not schedule.scored:
            raise
        return True
    return False


def write_parquet(
    manifest: Mapping[str, Any],
    directory: Path,
    store: Store,
    extractors: Iterable[str],
    seconds: dict[str, float],
) -> WrittenRun:
    """Write the results of the jobs that the store lists as Parquet files into a run's folder.

    `extractors` are those whose features are in the artifacts. The time is added to `seconds`.
    """
    with timed("tables", seconds):
        write_records(directory, store.listed_columns())
        write_features(directory, store, [*extractors])
    return WrittenRun(directory, str(manifest["suite"]), StoredArtifacts(directory), seconds)


@contextmanager
def timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Add the time of the block to `seconds[stage]`, rounded to tenths."""
    start = time.perf_counter()
    yield
    seconds[stage] = round(seconds.get(stage, 0.0) + time.perf_counter() - start, 1)


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

        `costs` are those of `bench.catalogue.chosen`. Methods without a cost are left out.
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
