"""A run from beginning to end: plan, ground truth, items, records, tables, figures."""

from __future__ import annotations

import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.commands.publish import Outputs, timed, write_outputs
from bench.records.job import shares
from bench.records.journal import (
    Journal,
    Settled,
    check_directory,
    open_journal,
    set_aside,
    write_manifest,
)
from bench.records.parquet import JobRow
from bench.records.record import Record
from bench.report.build import Made, write_report
from bench.running import environment as manifests
from bench.running.job_results import do_jobs
from bench.running.options import Options, protocol_of
from bench.running.progress import say
from bench.running.protocol import Plan, Protocol, plan
from bench.running.work import Job, failed
from bench.running.workforce import Workforce, workforce
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Finished:
    """A complete run: where it is, its tables, and how many items were done now and before.

    shares  of the workers' time, see `bench.records.job.shares`
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
    directory = options.directory
    protocol, skipped = protocol_of(suite, options)
    todo = plan(protocol, directory)  # refuses weights that cannot be used
    with workforce(options, protocol) as crew:
        manifest = manifests.describe(protocol, crew.workers, skipped) | {"cluster": crew.cluster}
        return _carry_out(options, directory, protocol, todo, crew, manifest, begun)


def _carry_out(
    options: Options,
    directory: Path,
    protocol: Protocol,
    todo: Plan,
    crew: Workforce,
    manifest: dict[str, Any],
    begun: float,
) -> Finished:
    suite, start = protocol.suite, crew.start
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
            settled = do_jobs(drawable, journal, suite.id, start)
            settled |= {key: Settled(None, reason) for key, (_, reason) in hopeless.items()}

        def records(row: JobRow) -> Sequence[Record]:
            lost = hopeless.get(row.key)
            return failed(*lost).records if lost else journal.lines.result(row.key).records

        outputs = write_outputs(
            directory,
            suite.id,
            _in_order(todo, truths | settled),
            records,
            [metric for metric, _ in protocol.features],
            seconds,
        )
        for line in journal.damage:
            say(line)
        spent = (of.spent for every in (truths, settled) for of in every.values())
        of_workers = shares(spent, crew.workers * (time.perf_counter() - begun))
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
        failed=sum(settled[job.key].artifact_sha256 is None for job in todo.items),
        seconds=seconds,
        shares=of_workers,
    )


def _check_any_truth(todo: Plan, truths: Mapping[str, Settled]) -> None:
    """One bad object among many is a failed record; if none can be drawn, the input is wrong."""
    if any(truth.artifact_sha256 for truth in truths.values()):
        return
    first = truths[todo.references[0].key].reason.removeprefix("input: ")
    raise BadInput(f"none of the {len(truths)} objects can be drawn; the first: {first}")


def _split(
    todo: Plan, truths: Mapping[str, Settled]
) -> tuple[list[Job], dict[str, tuple[Job, str]]]:
    """Items whose ground truth is there; by key, the others, failed for the same reason."""
    reasons = {
        job.artifact: truths[job.key].reason
        for job in todo.references
        if truths[job.key].artifact_sha256 is None
    }
    drawable = [job for job in todo.items if job.reference not in reasons]
    hopeless = {
        job.key: (job, reasons[job.reference])
        for job in todo.items
        if job.reference is not None and job.reference in reasons
    }
    return drawable, hopeless


def _count_new(todo: Plan, hopeless: Container[str], journal: Journal) -> int:
    """Items that this start has settled; one without a ground truth was settled with that."""
    truths: dict[Path | None, str] = {job.artifact: job.key for job in todo.references}
    settled_by = (truths[j.reference] if j.key in hopeless else j.key for j in todo.items)
    return sum(key in journal.added for key in settled_by)


def _in_order(todo: Plan, settled: Mapping[str, Settled]) -> list[JobRow]:
    every = (*todo.references, *todo.items)
    return [JobRow(job.key, job.item, settled[job.key].artifact_sha256) for job in every]
