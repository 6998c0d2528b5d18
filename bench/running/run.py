"""A run from its protocol to its records."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.records.artifacts import JobName
from bench.records.job import Job, Result, failed, shares
from bench.records.journal import (
    Journal,
    JournalIndex,
    check_directory,
    open_journal,
    read_index,
    read_manifest,
    set_aside,
    write_manifest,
)
from bench.records.parquet import JobRow, artifacts_of, write_features, write_jobs, write_records
from bench.records.record import GROUND_TRUTH, Record
from bench.running.environment import now
from bench.running.executors import results
from bench.running.extension import KeptRun, join, pinned_request, refuse_narrowing
from bench.running.factory import ExecutorFactory, executor_factory
from bench.running.isolation import Executor
from bench.running.listeners import PartialRun, StopRule, Watch
from bench.running.manifest import describe
from bench.running.options import UNTIL_DECIDED, Options
from bench.running.plan import Plan, plan
from bench.running.protocol import Protocol, protocol_of
from bench.running.schedule import Budget, Schedule, guess_s
from bench.running.status import undrawn, unscorable
from bench.running.turns import seeded_turns
from data_prep.failures import BadInput
from data_prep.progress import log

Outputs = TypeVar("Outputs")


@dataclass(frozen=True)
class WrittenRun:
    """A run whose records and features are written, while its directory is still locked.

    Attributes
    ----------
    directory : Path
    suite : str
    artifacts : mapping
        The artifacts of all jobs that have images, by name: ground truths first.
    seconds : dict
        The time that each stage took; later stages add theirs.
    """

    directory: Path
    suite: str
    artifacts: Mapping[JobName, Path]
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
    decided : bool
        Whether the stop rule ended it.
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
    decided: bool
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
    manifest : dict
        Manifest that the run will have when all its objects are complete.
    kept : KeptRun or None
        The run in the folder, of which nothing may get lost.
    begun : float
        The start, by `time.perf_counter`.
    """

    directory: Path
    fresh: bool
    protocol: Protocol
    plan: Plan
    manifest: dict[str, Any]
    kept: KeptRun | None
    budget: Budget
    begun: float
    stop_rule: StopRule | None

    def narrows(self, schedule: Schedule) -> bool:
        """Return whether outputs of the complete objects would lack an object of the kept run."""
        return self.kept is not None and not self.kept.objects <= {*schedule.complete}

    def snapshot(
        self, schedule: Schedule, journal: Journal, names: Sequence[str] | None = None
    ) -> PartialRun:
        """Return the run of the objects that are complete, or of some of them."""
        part = self.plan.select(frozenset(schedule.complete if names is None else names))
        without_truth = unscorable(part, schedule.results)

        def records(row: JobRow) -> Sequence[Record]:
            if row.key in without_truth:
                return failed(*without_truth[row.key]).records
            return journal.index.read(row.key).records

        rows = []
        for job in (*part.ground_truths, *part.method_jobs):
            result = schedule.results.get(job.key)  # None: the ground truth has failed
            rows.append(JobRow(job.key, job.name, result and result.artifact_sha256))
        objects = [obj.name for obj in part.objects]
        return PartialRun(self.directory, self.manifest | {"objects": objects}, rows, records)


def run(
    options: Options,
    publish: Callable[[WrittenRun], Outputs],
    watch: Watch,
    make_budget: Callable[[float | None, float], Budget] = Budget,
    stop_rule: StopRule | None = None,
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
        Makes the budget from `--budget` and the expected cost of an object, both in seconds.
    stop_rule : StopRule or None
        Is asked before another object is begun.

    Raises
    ------
    BadInput
        For anything the user has to fix.
    KeyboardInterrupt
        Where no object is complete; what was done until then is kept.
    """
    begun = time.perf_counter()
    suite = find(options.suite, SUITES, "suite")
    if options.budget is not None and options.shard is not None:
        raise BadInput(
            f"--budget: has no meaning with --shard {options.shard}, whose objects are fixed; "
            "leave one of the two"
        )
    if options.until_decided and options.shard is not None:
        raise BadInput(
            f"--until-decided: has no meaning with --shard {options.shard}, which sees a part of "
            "the objects; leave one of the two"
        )
    requested, skipped = protocol_of(suite, options)
    protocol, kept = join(options, requested)
    planned = plan(protocol, options.directory)  # refuses weights that cannot be used
    with executor_factory(options, protocol) as factory:
        budget = make_budget(options.budget, guess_s(planned.objects[0], factory.workers))
        if options.budget is not None and not _any_complete(options, planned):
            budget.check()
        manifest = describe(protocol, factory.workers, skipped) | {
            "request": pinned_request(options, protocol),
            "cluster": factory.cluster,
            "planned": len(planned.objects),  # "objects" are those that are complete, at the end
            **({UNTIL_DECIDED: True} if options.until_decided else {}),
        }
        if stop_rule is not None:
            names = (obj.name for obj in planned.objects)
            stop_rule.begin(manifest, seeded_turns(names, protocol.seed))
        prepared = _PreparedRun(
            *(options.directory, options.fresh, protocol, planned, manifest, kept, budget, begun),
            stop_rule=stop_rule,
        )
        return _carry_out(prepared, factory, publish, watch)


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
        write_manifest(directory, manifest | {"finished": now()})


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
    prepared: _PreparedRun,
    factory: ExecutorFactory,
    publish: Callable[[WrittenRun], Outputs],
    watch: Watch,
) -> RunResult[Outputs]:
    directory, planned = prepared.directory, prepared.plan
    seconds: dict[str, float] = {}
    with _locked_journal(directory, prepared.manifest, prepared.fresh) as journal:
        if prepared.kept is None:
            write_manifest(directory, prepared.manifest)
        elif read_manifest(directory) != prepared.kept.manifest:  # it had the lock meanwhile
            raise BadInput(f"{directory}: another run has changed it just now; run again")
        order = seeded_turns((obj.name for obj in planned.objects), prepared.protocol.seed)
        may_stop = prepared.stop_rule.enough if prepared.stop_rule else None
        usable = journal.all_usable(planned.jobs)
        schedule = Schedule(planned, usable, prepared.budget, order, may_stop)
        reused = schedule.total - schedule.left
        with timed("items", seconds):
            interrupted = _do_jobs(prepared, schedule, journal, factory.start, watch)
        _check_any_truth(planned, schedule.results)
        part = None if prepared.narrows(schedule) else prepared.snapshot(schedule, journal)
        outputs = None
        if part is not None:
            write_manifest(directory, part.manifest)  # the tables are of these objects
            extractors = [metric for metric, _ in prepared.protocol.features]
            outputs = publish(write_parquet(part, extractors, seconds))
        timings = (result.timing for result in schedule.results.values())
        of_workers = shares(timings, factory.workers * (time.perf_counter() - prepared.begun))
        if part is not None:
            ending = {
                "stage_seconds": seconds,
                "worker_shares": {name: round(share, 4) for name, share in of_workers.items()},
                "finished": now(),
            }
            write_manifest(directory, part.manifest | ending)
    without_images = undrawn(planned, schedule.results)
    return RunResult(
        directory,
        outputs,
        objects=len(schedule.complete),
        planned=len(planned.objects),
        interrupted=interrupted,
        decided=prepared.stop_rule is not None and prepared.stop_rule.enough(),
        done=schedule.total - reused - schedule.left,
        reused=reused,
        failed=len(without_images),
        hopeless=_hopeless(planned.select(frozenset(schedule.complete)), without_images),
        seconds=seconds,
        shares=of_workers,
    )


def _any_complete(options: Options, planned: Plan) -> bool:
    """Return whether an earlier start has completed an object."""
    index = JournalIndex() if options.fresh else read_index(options.directory)
    return any(all(job.key in index for job in obj.jobs) for obj in planned.objects)


def _do_jobs(
    prepared: _PreparedRun,
    schedule: Schedule,
    journal: Journal,
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
    failures = len(undrawn(prepared.plan, schedule.results))
    rule = prepared.stop_rule
    if rule is not None:
        rule.add_missing(prepared.snapshot(schedule, journal))
    try:
        with (
            watch(f"{title}, jobs", schedule.left) as reporter,
            closing(results(schedule.jobs(), schedule.left, journal, start)) as stream,
        ):
            for result in stream:
                before = schedule.left
                complete = schedule.take(result)
                ended = before - schedule.left  # with a ground truth all jobs of its object fail
                failures += ended * (not result.has_images)
                reporter.on_jobs_done(ended, failures)
                if complete and rule is not None:
                    rule.add_missing(prepared.snapshot(schedule, journal, schedule.complete[-1:]))
                if complete and schedule.scored and not prepared.narrows(schedule):
                    reporter.on_object_done(partial(prepared.snapshot, schedule, journal))
    except KeyboardInterrupt:
        if not schedule.scored:
            raise
        return True
    return False


def write_parquet(
    part: PartialRun, extractors: Iterable[str], seconds: dict[str, float]
) -> WrittenRun:
    """Write the results of jobs as Parquet files into a directory with a manifest.

    `extractors` are those whose features are in the artifacts. The time is added to `seconds`.
    """
    artifacts = artifacts_of(part.directory, part.jobs)
    with timed("tables", seconds):
        rows = [job for job in part.jobs if job.name.method != GROUND_TRUTH]
        write_records(part.directory, rows, part.records)
        write_jobs(part.directory, part.jobs)
        for metric in extractors:
            write_features(part.directory, metric, artifacts)
    return WrittenRun(part.directory, str(part.manifest["suite"]), artifacts, seconds)


@contextmanager
def timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Add the time of the block to `seconds[stage]`, rounded to tenths."""
    start = time.perf_counter()
    yield
    seconds[stage] = round(seconds.get(stage, 0.0) + time.perf_counter() - start, 1)


def _check_any_truth(planned: Plan, done: Mapping[str, Result]) -> None:
    """Raise BadInput where none of the ground truths could be drawn."""
    # One bad object among many is a failed record; if none can be drawn, the input is wrong.
    truths = [done[job.key] for job in planned.ground_truths if job.key in done]
    if not any(truth.has_images for truth in truths):
        reason = truths[0].reason.removeprefix("input: ")
        raise BadInput(f"none of the {len(truths)} objects can be drawn; the first: {reason}")


def _hopeless(complete: Plan, undrawn: Set[str]) -> tuple[str, ...]:
    """Return the methods that have failed on all complete objects that can be drawn."""
    jobs = [
        job for obj in complete.objects if obj.truth.key not in undrawn for job in obj.method_jobs
    ]
    working = {job.method for job in jobs if job.key not in undrawn}
    return tuple(dict.fromkeys(job.method for job in jobs if job.method not in working))
