"""A run from beginning to end: plan, ground truth, items, records, tables, figures."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from bench import manifest as manifests
from bench.artifacts import Item
from bench.finish import Outputs, timed, write_outputs
from bench.job_results import do_jobs
from bench.lookup import find
from bench.options import RUNS, Options, default_name, protocol_of, workers_of
from bench.plan import Plan, plan
from bench.pool import JobPool
from bench.progress import say
from bench.report import Made, write_report
from bench.spent import shares
from bench.store import Journal, check_directory, open_journal, set_aside, write_manifest
from bench.suites import SUITES
from bench.work import Job, Result, failed
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Finished:
    """A complete run: where it is, its tables, and how many items were done now and before.

    shares  of the workers' time, see `bench.spent.shares`
    """

    directory: Path
    outputs: Outputs
    done: int
    reused: int
    failed: int
    seconds: dict[str, float]
    shares: dict[str, float]


def run(options: Options) -> Finished:
    """Carry out a run, or what is left of it.

    Raises BadInput for anything the user has to mend; what was done until then is kept.
    """
    begun = time.perf_counter()
    suite = find(options.suite, SUITES, "suite")
    directory = options.out or RUNS / default_name(suite.id, options.dataset, options.shard)
    protocol, skipped = protocol_of(suite, options)
    workers = workers_of(suite, options)
    todo = plan(protocol, directory)  # refuses weights that cannot be used
    manifest = manifests.describe(protocol, workers, skipped)
    start = partial(JobPool, limits=suite.limits, workers=workers)
    if options.fresh and (old := set_aside(directory)):
        say(f"the old run is now {old}")
    check_directory(directory, manifest)
    seconds: dict[str, float] = {}
    with open_journal(directory) as journal:
        write_manifest(directory, manifest)
        with timed("ground truth", seconds):
            truths = do_jobs(todo.references, journal, "ground truth", start)
            _check_any_truth(todo, truths)
        with timed("items", seconds):
            drawable, hopeless = _split(todo, truths)
            results = do_jobs(drawable, journal, suite.id, start) | hopeless
        outputs = write_outputs(
            directory,
            suite.id,
            _in_order(todo, truths | results),
            [metric for metric, _ in protocol.features],
            seconds,
        )
        for line in journal.damage:
            say(line)
        spent = (result.spent for result in (*truths.values(), *results.values()))
        of_workers = shares(spent, workers * (time.perf_counter() - begun))
        manifest |= {
            "finished": manifests.now(),
            "stage_seconds": seconds,
            "worker_shares": {part: round(share, 4) for part, share in of_workers.items()},
        }
        write_manifest(directory, manifest)
    write_report(directory, made=Made(outputs.tables, outputs.orderings, outputs.beyond))
    done = _count_new(todo, hopeless, journal)
    return Finished(
        directory,
        outputs,
        done=done,
        reused=len(todo.items) - done,
        failed=sum(results[job.key].artifact_sha256 is None for job in todo.items),
        seconds=seconds,
        shares=of_workers,
    )


def _check_any_truth(todo: Plan, truths: Mapping[str, Result]) -> None:
    """One bad object among many is a failed record; if none can be drawn, the input is wrong."""
    if any(truth.artifact_sha256 for truth in truths.values()):
        return
    first = truths[todo.references[0].key].records[0].reason.removeprefix("input: ")
    raise BadInput(f"none of the {len(truths)} objects can be drawn; the first: {first}")


def _split(todo: Plan, truths: Mapping[str, Result]) -> tuple[list[Job], dict[str, Result]]:
    """Items whose ground truth is there, and the results of the others: failed, same reason."""
    reasons = {
        job.artifact: truths[job.key].records[0].reason
        for job in todo.references
        if truths[job.key].artifact_sha256 is None
    }
    drawable = [job for job in todo.items if job.reference not in reasons]
    hopeless = {
        job.key: failed(job, reasons[job.reference])
        for job in todo.items
        if job.reference is not None and job.reference in reasons
    }
    return drawable, hopeless


def _count_new(todo: Plan, hopeless: Mapping[str, Result], journal: Journal) -> int:
    """Items that this start has settled; one without a ground truth was settled with that."""
    truths: dict[Path | None, str] = {job.artifact: job.key for job in todo.references}
    settled_by = (truths[j.reference] if j.key in hopeless else j.key for j in todo.items)
    return sum(key in journal.added for key in settled_by)


def _in_order(todo: Plan, results: Mapping[str, Result]) -> list[tuple[Item, Result]]:
    return [(job.item, results[job.key]) for job in (*todo.references, *todo.items)]
