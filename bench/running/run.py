"""A run from its options to its records, and what a run would have to do (`run_status`)."""

from __future__ import annotations

import math
import time
import typing
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
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
from data_prep.datasets.dataset import first_names
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.failures import BadInput
from data_prep.progress import log

Outputs = TypeVar("Outputs")
# Makes the outputs of a run's folder, and adds the seconds of each stage to the dictionary.
Publish = Callable[[Path, dict[str, float]], Outputs]
# What an image costs, by the default suite, to tell time and disk space before a run.
IMAGE_S = 0.015  # seconds of a core to score an image
IMAGE_B = 7_000  # bytes of an image in the store, with its scores and features
_TRUTH_MS = 5.0  # milliseconds to draw a view of the true mesh
# The most meshes that are searched for the names of missing files before a run: of large data sets
# with a budget all would take longer than the run.
_MOST_LOOKED_INTO = 200


@dataclass(frozen=True)
class PartialRun:
    """The complete objects of a run, which may still go on."""

    directory: Path
    manifest: dict[str, Any]  # the manifest that a run of these objects alone would have
    plan: Plan  # the plan of all objects that the run is to have
    store: Store  # the store with the results of the complete objects

    def read_jobs(self, name: str) -> pd.DataFrame:
        """Return the jobs of an object as a frame with one row each.

        The columns are those of `bench.records.frames.job_frame`. A job that is done once for all
        conditions has a row for each of them.
        """
        jobs = self.plan.jobs_of(name).method_jobs
        return job_frame([(job.name, self.store.result(job.key)) for job in jobs])


class ProgressReporter(typing.Protocol):
    """A listener to the progress of a run."""

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Report that `ended` more jobs have ended, and that `failed` of the run have failed."""

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Report that an object is complete.

        snapshot  returns the run of all complete objects; it takes longer the more there are
        """


# Returns the reporter of a run's progress, by a title and the number of jobs to be done.
Watch = Callable[[str, int], AbstractContextManager[ProgressReporter]]


@dataclass(frozen=True)
class RunResult(Generic[Outputs]):
    """The result of a run that has ended with at least one complete object."""

    directory: Path
    # The tables and figures of the complete objects. None where the folder keeps those of a run
    # before, which have more objects.
    outputs: Outputs | None
    objects: int  # the number of complete objects
    planned: int  # the number of objects of the whole run
    interrupted: bool  # whether Ctrl-C has ended it
    done: int  # the jobs done since this start; one that stands for all conditions counts once
    reused: int  # the jobs that were done before this start
    failed: int  # the jobs without images; with a ground truth all jobs of its object fail
    hopeless: tuple[str, ...]  # the methods that have not given a single image
    seconds: dict[str, float]  # the seconds of each stage, by its name
    shares: dict[str, float]  # of the workers' time, 0 to 1, by what it was spent on


def run(
    options: Options,
    publish: Publish[Outputs],
    watch: Watch,
    make_budget: Callable[[float | None], Budget] = Budget,
) -> RunResult[Outputs]:
    """Carry out a run, or what is left of it, for as long as its budget allows.

    A run of the same request in the folder goes on, see `bench.running.folder`. Where the budget or
    Ctrl-C ends a run, its outputs are made of the complete objects, unless the folder has outputs
    of more objects. The same options then go on with the others.

    publish      makes the outputs of the folder, which is still locked; the run counts as finished
                 when it returns
    watch        returns the reporter of progress
    make_budget  makes the budget from the seconds of `--budget`, which count from then

    Raises BadInput for anything the user has to fix, and KeyboardInterrupt where no object is
    complete. Finished jobs are kept in any case.
    """
    begun, budget, directory = time.perf_counter(), make_budget(options.budget), options.directory
    protocol, held = _protocol_and_held(options)
    planned = plan(protocol)
    with executors_for(protocol, options) as (start, workers, cluster):
        budget.guess_s = guess_s(planned.jobs_per_object, workers)
        _refuse_start(options, planned, budget)
        request = stated_request(options, protocol, held)
        objects = planned_objects(options, protocol, held)
        manifest = protocol.to_manifest(request, objects, workers, cluster)
        if options.adds and held.manifest:  # the command that started the run stays
            added = [*held.manifest.get("added", ()), manifest["command"]]
            manifest |= {"command": held.manifest["command"], "added": added}

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
            _tell_missing_files(planned, [name for name in order if name not in schedule.complete])

            def snapshot() -> PartialRun:
                objects = [name for name in planned.names if name in schedule.complete]
                return PartialRun(directory, manifest | {"objects": objects}, planned, store)

            with timed("jobs", seconds):
                jobs = do_and_store(schedule.jobs(), schedule.left, store, start, schedule.left_s)
                interrupted = _do_jobs(jobs, schedule, held.tabled, snapshot, watch)
            _refuse_nothing(schedule, budget, interrupted)
            outputs, keeps_tables = None, not held.tabled <= schedule.complete.keys()
            if not keeps_tables:
                manifest = snapshot().manifest  # names the complete objects, which the tables show
                write_manifest(directory, manifest)
                complete = map(planned.jobs_of, manifest["objects"])
                store.list_jobs((job.key, job.name) for obj in complete for job in obj.listed)
                manifest[ENVIRONMENTS] = environments_entry(store.environments())
                write_export(directory, store, seconds)
                outputs = publish(directory, seconds)
            of_workers = shares(schedule.timing, workers * (time.perf_counter() - begun))
            if not keeps_tables:
                # A run that goes on has also taken the time of its jobs before.
                before = held.manifest.get("stage_seconds", {}).get("jobs", 0.0)
                manifest["stage_seconds"] = tenths({**seconds, "jobs": before + seconds["jobs"]})
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
    """Return the protocol of a run, and the run that its folder holds.

    `fetches` is as in `Protocol.from_options`.
    """
    asked = Protocol.from_options(options, fetches=fetches)
    held = HeldRun() if options.fresh else read_held(options.directory, asked)
    return protocol_in_folder(asked, held, options), held


def _tell_environments(directory: Path, schedule: Schedule, here: Mapping[str, str]) -> None:
    """Say on stderr how many finished jobs are from another environment, and what differs there."""
    for text, jobs in schedule.environments.items():
        if changes := environment_changes(unpacked_environment(text), here):
            log(
                f"{directory}: goes on in another environment: {changes}; {jobs} jobs are from "
                "before, and 'bench check' takes the wider tolerances; --fresh starts over"
            )


def _tell_missing_files(planned: Plan, names: Sequence[str]) -> None:
    """Say on stderr how many objects name files that are not there, and which.

    names  the objects to be done, in the order of their start; the first _MOST_LOOKED_INTO are read
    """
    lacking = []
    for name in names[:_MOST_LOOKED_INTO]:
        obj = planned.objects[name]  # an object in grey is no `MeshFile`, and needs no materials
        if isinstance(obj, MeshFile) and (missing := obj.missing_files()):
            lacking.append(f"{name} ({first_names(missing)})")
    if lacking:
        more = len(names) > _MOST_LOOKED_INTO
        among = f"the first {_MOST_LOOKED_INTO}" if more else str(len(names))
        line = (
            f"bench: {len(lacking)} of {among} objects name files that are not there, so that "
            f"their faces may be grey: {first_names(lacking)}"
        )
        # The names come from files of strangers, and might change the settings of a terminal.
        log("".join(c if c.isprintable() else "?" for c in line))


@contextmanager
def executors_for(
    protocol: Protocol, options: Options
) -> Iterator[tuple[Callable[[int], Executor], int, dict[str, Any] | None]]:
    """Yield how to start an executor, how many workers it has, and the manifest's entry "cluster".

    The workers are processes of this machine, or those of a Ray cluster, which stays connected
    within the block. An executor is started with the number of jobs to come. Raises BadInput where
    the suite, a method or another option does not go together with `--ray`.
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
    """Raise BadInput for a budget too short for the first object, and for jobs that cannot be done.

    These are jobs of a method MODULE:NAME whose module is not executed, because only the manifest
    names it.
    """
    if options.fresh:
        budget.check()
        return
    with open_store(options.directory) as store:
        _refuse_jobs_without_module(options.directory, planned, store)
        if options.budget is None:
            return
        if store.is_empty or not any(len(settled(o, store)) == len(o.jobs) for o in planned):
            budget.check()


def _refuse_jobs_without_module(directory: Path, planned: Plan, store: Store) -> None:
    methods = planned.protocol.methods.values()
    without_module = {method.id for method in methods if method.source == NOT_LOADED}
    if not without_module:
        return
    for obj in planned:
        done = settled(obj, store)
        left = {job.method for job in obj.jobs if job.key not in done}
        if lost := sorted(without_module & left):
            raise BadInput(
                f"{directory}: {lost[0]} has jobs left, and its module is executed only where the "
                f"command names it; name it, too, {APART}"
            )


def _refuse_nothing(schedule: Schedule, budget: Budget, interrupted: bool) -> None:
    """Raise BadInput for a run without a complete object, or without one that can be drawn."""
    if not schedule.complete and not interrupted:
        raise BadInput(
            f"--budget {budget.seconds:g}s: used up before one object was complete; "
            f"{schedule.total - schedule.left} of its jobs are kept, and the same command goes on "
            "with the others: give it more time"
        )
    if schedule.undrawn and not schedule.scored:
        # A bad object among good ones just has failed records. Where none can be drawn, the whole
        # dataset is wrong, and the user has to know.
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
    """Do the jobs that are left, and return whether Ctrl-C has ended them.

    tabled  the objects in the folder's tables; objects are reported as complete only when all of
            these are, so that no table of fewer objects is shown

    Raises KeyboardInterrupt where Ctrl-C comes before any object is complete.
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
                # A failed ground truth ends all jobs of its object at once.
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

    The manifest is written first, and once more where the block ends without an error: with the
    time of the end, and with entries that the block has added. `fresh` renames an old run first.
    Raises BadInput where the directory holds something else than a run, another run, or a run with
    a method, condition or object that this one has not.
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
    """Yield the store of a folder that is locked and has passed a check.

    Jobs whose images or records are damaged are removed from the store, so that they are done
    again; a line on stderr counts them.
    """
    if fresh and (old := set_aside(directory)):
        log(f"the old run is now {old}")
    check()  # before the lock, which is the first file to be written there
    with open_folder(directory) as store:
        check()  # once more: until now another process may have had the lock
        if count := store.forget_damaged():
            log(
                f"{store.path}: the images or records of {count} jobs are missing or altered; they "
                "are done again"
            )
        yield store


def write_export(directory: Path, store: Store, seconds: dict[str, float]) -> None:
    """Write the records of the jobs that the store lists to `records.parquet`, for scripts.

    The time that it takes is added to `seconds["tables"]`.
    """
    with timed("tables", seconds):
        write_records(directory, store)


@dataclass(frozen=True)
class RunStatus:
    """The work that a run needs, and the part of it that is done."""

    directory: Path
    plan: Plan
    left: Mapping[str, int]  # the number of jobs left, by method
    workers: int  # the number of worker processes of this machine
    stored_b: int  # the size of the store in the folder, in bytes

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
        """Return the bytes of disk that the jobs left are expected to take.

        A job takes as much as finished jobs did in the mean, or where there are none, as much as in
        the default suite.
        """
        job_b = IMAGE_B * self.plan.protocol.views
        if self.done:
            job_b = self.stored_b / self.done
        return self.jobs * job_b

    def unmeasured(self, costs: Mapping[str, MeasuredMethod]) -> list[str]:
        """Return the methods that have jobs left and whose cost is not known."""
        return [m for m, jobs in self.left.items() if jobs and self._job_s(m, costs) is None]

    def seconds(self, costs: Mapping[str, MeasuredMethod]) -> float:
        """Return the seconds that the rest of the run is expected to take, tables included.

        Jobs of methods whose cost is not known count as nothing.
        """
        core_s = sum(jobs * (self._job_s(m, costs) or 0.0) for m, jobs in self.left.items())
        busy_workers = max(1, min(self.workers, self.jobs))
        return START_S + core_s / busy_workers + end_s(len(self.plan))

    def _job_s(self, method: str, costs: Mapping[str, MeasuredMethod]) -> float | None:
        """Return the seconds that a method's job takes of a core, its scores included.

        None where the cost of the method is not known.
        """
        views = self.plan.protocol.views
        if method == GROUND_TRUTH:
            return views * (_TRUTH_MS / 1000 + IMAGE_S)
        cost = cost_of(method, costs)
        return None if cost is None else cost.cloud_ms(views) / 1000 + views * IMAGE_S


def run_status(options: Options) -> RunStatus:
    """Return what `bench run` would do with these options; nothing is written.

    Raises BadInput as `run`.
    """
    directory = options.directory
    protocol, _ = _protocol_and_held(options, fetches=False)
    workers, planned = workers_of(protocol.suite, options), plan(protocol)
    jobs_of_an_object = Counter(job.method for job in planned[0].jobs)  # the same for each object
    left = {method: jobs * len(planned) for method, jobs in jobs_of_an_object.items()}
    stored_b = 0
    if not options.fresh:
        with open_store(directory) as store:
            if not store.is_empty:
                stored_b = (directory / STORE).stat().st_size
                for obj in planned:
                    done = settled(obj, store)
                    done_of_object = Counter(job.method for job in obj.jobs if job.key in done)
                    for method, jobs in done_of_object.items():
                        left[method] -= jobs
    elif not (directory / MANIFEST).exists():
        # `--fresh` would rename a run out of the way, but nothing else that lies there.
        check_directory(directory, {})
    return RunStatus(directory, planned, left, workers, stored_b)
