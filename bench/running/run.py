"""A run from its options to its records, and what is left of one before its start."""

from __future__ import annotations

import math
import time
import typing
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import pandas as pd

from bench.catalogue.chosen import MeasuredMethod, cost_of
from bench.catalogue.methods import is_module_name
from bench.records.folder import (
    MANIFEST,
    check_directory,
    open_folder,
    open_store,
    set_aside,
    write_manifest,
)
from bench.records.frames import job_frame, write_records
from bench.records.job import GROUND_TRUTH, shares, tenths, timed
from bench.records.store import STORE, Store, unpacked_environment
from bench.running.environment import (
    ENVIRONMENTS,
    environment_changes,
    environments_entry,
    now,
    started_environment,
)
from bench.running.folder import (
    APART,
    NOT_LOADED,
    HeldRun,
    planned_objects,
    protocol_in_folder,
    read_held,
    stated_request,
)
from bench.running.options import LOCAL, Options, workers_of
from bench.running.plan import (
    START_S,
    Budget,
    Plan,
    Schedule,
    end_s,
    guess_s,
    plan,
    seeded_turns,
    settled,
)
from bench.running.pool import QUEUED, Executor
from bench.running.protocol import Protocol
from bench.running.ray import RayPool, connected
from bench.running.work import JobPool, do_and_store
from data_prep.failures import BadInput
from data_prep.progress import log

Outputs = TypeVar("Outputs")
Publish = Callable[[Path, dict[str, float]], Outputs]  # of a folder; adds seconds by stage
# Of an image: it is scored in some 15 ms of a core; its bytes are those of the default suite.
IMAGE_S, IMAGE_B = 0.015, 7_000
_TRUTH_MS = 5.0  # of a view of the true mesh


@dataclass(frozen=True)
class PartialRun:
    """The complete objects of a run, which may still go on."""

    directory: Path
    manifest: dict[str, Any]  # that a run of these objects alone would have
    plan: Plan  # of all objects that the run is to have
    store: Store  # with the results of the complete ones

    def read_jobs(self, name: str) -> pd.DataFrame:
        """Return the jobs of an object, one row each, as `bench.records.frames.job_frame`.

        A job that stands for every condition is there once for each.
        """
        jobs = self.plan.jobs_of(name).method_jobs
        return job_frame([(job.name, self.store.result(job.key)) for job in jobs])


class ProgressReporter(typing.Protocol):
    """A listener to the progress of a run."""

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Report that `ended` more jobs have ended, and that `failed` of the run have failed."""

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Report that an object is complete. `snapshot` takes the longer the more there are."""


# Takes title and number of the jobs to be done.
Watch = Callable[[str, int], AbstractContextManager[ProgressReporter]]


@dataclass(frozen=True)
class RunResult(Generic[Outputs]):
    """A run of which all objects are complete, or some."""

    directory: Path
    # Of the complete objects; None where the folder keeps those of more objects of the run before.
    outputs: Outputs | None
    objects: int  # that are complete
    planned: int  # objects of the whole run
    interrupted: bool  # by Ctrl-C
    done: int  # jobs of this start; one that is the same under every condition counts once
    reused: int  # jobs of earlier ones
    failed: int  # jobs without images; with a failed ground truth all of its object
    hopeless: tuple[str, ...]  # methods without a single image, though there is something to draw
    seconds: dict[str, float]  # of each stage
    shares: dict[str, float]  # of the workers' time, see `bench.records.job.shares`


def run(
    options: Options,
    publish: Publish[Outputs],
    watch: Watch,
    make_budget: Callable[[float | None], Budget] = Budget,
) -> RunResult[Outputs]:
    """Carry out a run, or what is left of it, for as long as its budget allows.

    A run of the same request in the folder goes on, see `bench.running.folder`. Where the budget or
    Ctrl-C ends it, it is a run of the objects that are complete, unless the folder has outputs of
    more; the same options go on with the others.

    `publish` makes the outputs of a folder which is still locked; the run counts as finished after
    it. `watch` gives the reporter of progress, `make_budget` makes the budget from `--budget`, in
    seconds from now. Raises BadInput for anything the user has to fix, and KeyboardInterrupt where
    no object is complete; what was done until then is kept.
    """
    begun, budget, directory = time.perf_counter(), make_budget(options.budget), options.directory
    protocol, held = _protocol_and_held(options)
    planned = plan(protocol)  # refuses weights that cannot be used
    with executors_for(protocol, options) as (start, workers, cluster):
        budget.guess_s = guess_s(planned.jobs_per_object, workers)
        _refuse_start(options, planned, budget)
        request = stated_request(options, protocol, held)
        objects = planned_objects(options, protocol, held)
        manifest = protocol.to_manifest(request, objects, workers, cluster)

        def check() -> None:
            if check_directory(directory, manifest) != held.manifest:
                raise BadInput(f"{directory}: another run has changed it just now; run again")

        with _open_checked(directory, check, options.fresh) as store:
            if not held.tabled:
                write_manifest(directory, manifest)
            store.environment = started_environment(manifest)
            order = seeded_turns(planned.names, protocol.seed)
            ahead = math.ceil(QUEUED * max(1, workers) / planned.jobs_per_object)
            schedule = Schedule(planned, store, budget, order, ahead)
            reused, seconds = schedule.total - schedule.left, dict[str, float]()
            _tell_environments(directory, schedule, store.environment)

            def snapshot() -> PartialRun:
                objects = [name for name in planned.names if name in schedule.complete]
                return PartialRun(directory, manifest | {"objects": objects}, planned, store)

            with timed("jobs", seconds):
                jobs = do_and_store(schedule.jobs(), schedule.left, store, start, schedule.left_s)
                interrupted = _do_jobs(jobs, schedule, held.tabled, snapshot, watch)
            _refuse_nothing(schedule, budget, interrupted)
            outputs, keeps_tables = None, not held.tabled <= schedule.complete.keys()
            if not keeps_tables:
                manifest = snapshot().manifest
                write_manifest(directory, manifest)  # the tables are of these objects
                complete = map(planned.jobs_of, manifest["objects"])
                store.list_jobs((job.key, job.name) for obj in complete for job in obj.listed)
                manifest[ENVIRONMENTS] = environments_entry(store.environments())
                write_export(directory, store, seconds)
                outputs = publish(directory, seconds)
            of_workers = shares(schedule.timing, workers * (time.perf_counter() - begun))
            if not keeps_tables:
                manifest["stage_seconds"] = tenths(seconds)
                manifest["worker_shares"] = {n: round(share, 4) for n, share in of_workers.items()}
                write_manifest(directory, manifest | {"finished": now()})
    return RunResult(
        directory,
        outputs,
        objects=len(schedule.complete),
        planned=len(planned),
        interrupted=interrupted,
        done=schedule.total - reused - schedule.left,
        reused=reused,
        failed=schedule.failures,
        hopeless=tuple(m for m in protocol.methods if m not in schedule.working),
        seconds=seconds,
        shares=of_workers,
    )


def _protocol_and_held(options: Options, fetches: bool = True) -> tuple[Protocol, HeldRun]:
    """Return the protocol of a run, and the run that its folder holds."""
    asked = Protocol.from_options(options, fetches=fetches)
    held = HeldRun() if options.fresh else read_held(options.directory, asked)
    return protocol_in_folder(asked, held, options), held


def _tell_environments(directory: Path, schedule: Schedule, here: Mapping[str, str]) -> None:
    """Say on stderr how many jobs were made with other libraries, drivers or processors."""
    for text, jobs in schedule.environments.items():
        if changes := environment_changes(unpacked_environment(text), here):
            log(
                f"{directory}: goes on in another environment: {changes}; {jobs} jobs are from "
                "before, and 'bench check' takes the wider tolerances; --fresh starts over"
            )


@contextmanager
def executors_for(
    protocol: Protocol, options: Options
) -> Iterator[tuple[Callable[[int], Executor], int, dict[str, Any] | None]]:
    """Yield what gives an executor for a number of jobs, its workers, and the manifest's cluster.

    These are processes of this machine, or a Ray cluster, which is connected within the block.
    """
    suite = protocol.suite
    workers = workers_of(suite, options)
    if options.ray is None:
        yield partial(JobPool, workers=workers, limits=suite.limits), workers, None
        return
    if suite.timed:
        raise BadInput(
            f"--ray: has no meaning for the suite {suite.id}, whose times are compared; leave it"
        )
    if modules := list(filter(is_module_name, protocol.methods)):
        raise BadInput(
            f"--ray: {modules[0]} is of a module of this machine; install its package on all "
            "nodes, and give the id of its method"
        )
    if options.workers is not None and options.ray != LOCAL:
        raise BadInput("--workers: has no meaning with --ray, whose nodes bring theirs; leave it")
    with connected(options.ray, workers) as cluster:
        yield lambda _: RayPool(cluster, protocol), cluster.cpus, asdict(cluster)


def _refuse_start(options: Options, planned: Plan, budget: Budget) -> None:
    """Refuse a budget too short for the first object, and jobs of modules that are not named."""
    if options.fresh:
        budget.check()
        return
    lost = {m.id for m in planned.protocol.methods.values() if m.source == NOT_LOADED}
    with open_store(options.directory) as store:
        for obj in planned if lost else ():
            done = settled(obj, store)
            if left := sorted(lost.intersection(j.method for j in obj.jobs if j.key not in done)):
                raise BadInput(
                    f"{options.directory}: {left[0]} has jobs left, and its module is executed "
                    f"only where the command names it; name it, too, {APART}"
                )
        complete = (len(settled(obj, store)) == len(obj.jobs) for obj in planned)
        if options.budget is not None and (store.is_empty or not any(complete)):
            budget.check()


def _refuse_nothing(schedule: Schedule, budget: Budget, interrupted: bool) -> None:
    """Refuse a run with no object that is complete, or with none that can be drawn."""
    if not schedule.complete and not interrupted:
        raise BadInput(
            f"--budget {budget.seconds:g}s: used up before one object was complete; "
            f"{schedule.total - schedule.left} of its jobs are kept, and the same command goes on "
            "with the others: give it more time"
        )
    if schedule.undrawn and not schedule.scored:
        # One bad object among many is a failed record; if none can be drawn, the input is wrong.
        reason = schedule.undrawn.removeprefix("input: ")
        raise BadInput(
            f"none of the {len(schedule.complete)} objects can be drawn; the first: {reason}"
        )


def _do_jobs(
    jobs: Generator[Any, None, None],
    schedule: Schedule,
    tabled: Collection[str],
    snapshot: Callable[[], PartialRun],
    watch: Watch,
) -> bool:
    """Do the jobs that are left; return whether Ctrl-C came when an object was complete.

    Progress has no tables before all objects that the folder's tables have are complete.
    """
    if not schedule.left:
        return False
    title = schedule.plan.protocol.suite.id
    if reused := schedule.total - schedule.left:
        log(f"{title}: {reused} jobs are there from before")
    try:
        with watch(f"{title}, jobs", schedule.left) as reporter, closing(jobs) as stream:
            for result in stream:
                before = schedule.left
                complete = schedule.take(result)
                # With a ground truth all jobs of its object fail.
                reporter.on_jobs_done(before - schedule.left, schedule.failures)
                if complete and schedule.scored and schedule.complete.keys() >= {*tabled}:
                    reporter.on_object_done(snapshot)
    except KeyboardInterrupt:
        if not schedule.scored:
            raise
        return True
    return False


@contextmanager
def open_run(directory: Path, manifest: dict[str, Any], fresh: bool = False) -> Iterator[Store]:
    """Yield the store of a run, whose directory is locked for as long as the block lasts.

    The manifest is written first, and again where the block ends without an error, with the time
    and what the block has added to it. `fresh` renames an old run first. Raises BadInput where the
    directory holds something else, or more than this run would have.
    """

    def check() -> None:
        before = check_directory(directory, manifest)
        for kind in ("methods", "conditions", "objects", "pairs", "triples"):
            names = manifest.get(kind, ())
            if lacking := [name for name in before.get(kind, ()) if name not in names]:
                noun = kind if len(lacking) > 1 else kind.removesuffix("s")
                raise BadInput(
                    f"{directory}: holds a run with {len(lacking)} more {noun}, {lacking[0]} among "
                    "them; give a new --out"
                )

    with _open_checked(directory, check, fresh) as store:
        write_manifest(directory, manifest)
        store.environment = started_environment(manifest)
        yield store
        write_manifest(directory, manifest | {"finished": now()})


@contextmanager
def _open_checked(directory: Path, check: Callable[[], None], fresh: bool) -> Iterator[Store]:
    if fresh and (old := set_aside(directory)):
        log(f"the old run is now {old}")
    check()  # before anything is written there
    with open_folder(directory) as store:
        check()  # another process may have had the lock meanwhile
        if count := store.forget_damaged():
            log(
                f"{store.path}: the images or records of {count} jobs are missing or altered; they "
                "are done again"
            )
        yield store


def write_export(directory: Path, store: Store, seconds: dict[str, float]) -> None:
    """Write the records of the jobs that the store lists."""
    with timed("tables", seconds):
        write_records(directory, store)


@dataclass(frozen=True)
class RunStatus:
    """A run that has not been started, or not now."""

    directory: Path
    plan: Plan
    left: Mapping[str, int]  # jobs by method; one that is the same under every condition once
    workers: int  # processes of this machine
    stored_b: int  # size of the store in the folder

    @property
    def jobs(self) -> int:
        """Return how many jobs are left."""
        return sum(self.left.values())

    @property
    def done(self) -> int:
        """Return how many jobs are done."""
        return len(self.plan) * self.plan.jobs_per_object - self.jobs

    @property
    def size_b(self) -> float:
        """Return the bytes of disk that the jobs left are expected to take."""
        views = self.plan.protocol.views
        return self.jobs * (self.stored_b / self.done if self.done else IMAGE_B * views)

    def unmeasured(self, costs: Mapping[str, MeasuredMethod]) -> list[str]:
        """Return the methods with jobs left whose cost is not known."""
        return [m for m, jobs in self.left.items() if jobs and self._job_s(m, costs) is None]

    def seconds(self, costs: Mapping[str, MeasuredMethod]) -> float:
        """Return the time that the jobs left are expected to take, tables and figures included.

        Methods without a cost are left out.
        """
        of_cores = sum(jobs * (self._job_s(m, costs) or 0.0) for m, jobs in self.left.items())
        busy = max(1, min(self.workers, self.jobs))
        return START_S + of_cores / busy + end_s(len(self.plan))

    def _job_s(self, method: str, costs: Mapping[str, MeasuredMethod]) -> float | None:
        """Return the seconds of a core that a job takes, scores included; None if unknown."""
        views = self.plan.protocol.views
        if method == GROUND_TRUTH:
            return views * (_TRUTH_MS / 1000 + IMAGE_S)
        cost = cost_of(method, costs)
        return None if cost is None else cost.cloud_ms(views) / 1000 + views * IMAGE_S


def run_status(options: Options) -> RunStatus:
    """Return what `bench run` would do; nothing is written. Raises BadInput as `run`."""
    directory = options.directory
    protocol, _ = _protocol_and_held(options, fetches=False)
    workers, planned = workers_of(protocol.suite, options), plan(protocol)
    first = Counter(job.method for job in planned[0].jobs)
    left, stored_b = {method: jobs * len(planned) for method, jobs in first.items()}, 0
    if not options.fresh:
        with open_store(directory) as store:
            for obj in () if store.is_empty else planned:
                done = settled(obj, store)
                for job in obj.jobs:
                    left[job.method] -= job.key in done
            stored_b = 0 if store.is_empty else (directory / STORE).stat().st_size
    elif not (directory / MANIFEST).exists():  # else it would be renamed
        check_directory(directory, {})
    return RunStatus(directory, planned, left, workers, stored_b)
