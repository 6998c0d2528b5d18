"""The verification of a receipt: checksums, tables made again, and a part of the jobs again.

Nothing is written but into a temporary folder.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bench.analysis.scored import scored_run
from bench.catalogue.claims import PREFIX, address_of
from bench.catalogue.lookup import find
from bench.catalogue.methods import find_run_method
from bench.catalogue.suites import SUITES
from bench.receipts.compare import compare_job, read_job
from bench.receipts.digests import (
    DAMAGED,
    PART_DIGITS,
    UNREADABLE,
    deal,
    digest_inputs,
    digest_jobs,
    digest_object,
    digest_records,
    digest_tables,
    job_title,
    part_digest,
)
from bench.receipts.folder import compare_folder, compare_manifest, differing, remake
from bench.receipts.receipt import (
    condensed,
    describe_manifest,
    environment_with_python,
    options_of,
    read_receipt,
    weights_of,
)
from bench.receipts.rescore import misscored, other_truth
from bench.receipts.sample import ChosenJobs, compute, draw_jobs, draw_parts
from bench.records.artifacts import IMAGES
from bench.records.former import is_former
from bench.records.job import Job, Result
from bench.records.parquet import RECORDS
from bench.records.run_folder import open_folder, read_finished, write_manifest
from bench.records.store import Store, open_store
from bench.running.environment import now
from bench.running.executors import JobPool
from bench.running.extension import pinned_request
from bench.running.isolation import Executor
from bench.running.manifest import describe
from bench.running.options import Options, workers_of
from bench.running.plan import Plan, plan
from bench.running.protocol import Protocol, protocol_of
from bench.running.run import write_parquet
from bench.tables.build import write_outputs
from bench.tables.table import TABLES
from data_prep.failures import BadInput

SHARE = 0.05
MOST_SEED = 2**32


@dataclass(frozen=True)
class VerifierChoices:
    """The choices of a verifier.

    Attributes
    ----------
    run : Path or None
        Folder of the run; None where only the receipt is at hand.
    share : float
        Part of the jobs to compute again, 0 to 1.
    seed : int
        Seed by which they are drawn.
    workers : int or None
        Worker processes; None for one a core.
    dataset : str or None
        Dataset in place of that of the receipt, whose path is one of another machine.
    images : tuple of Path
        Trees of methods entered by images, in place of those that the run's manifest names.
    """

    run: Path | None = None
    share: float = SHARE
    seed: int = 0
    workers: int | None = None
    dataset: str | None = None
    images: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """The result of a verification: a line for each difference, and remarks on what was done."""

    differences: tuple[str, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class _Here:
    """The request of a receipt as it would be run here.

    Attributes
    ----------
    manifest : dict
        Manifest that a run here would have.
    same_environment : bool
        Whether results have to be those of the receipt to the last digit.
    start : callable
        Returns an executor for a number of jobs.
    """

    options: Options
    protocol: Protocol
    plan: Plan
    manifest: dict[str, Any]
    same_environment: bool
    start: Callable[[int], Executor[Job, Result]]


def random_seed() -> int:
    """Return a seed that nobody could know before, from the operating system."""
    return secrets.randbelow(MOST_SEED)


def verify(
    path: Path,
    choices: VerifierChoices,
    probe: Callable[[], Mapping[str, str]] | None = None,
    start: Callable[[int], Executor[Job, Result]] | None = None,
) -> Verdict:
    """Verify the receipt in a file.

    Parameters
    ----------
    path : Path
    choices : VerifierChoices
    probe : callable or None
        Finds out the environment, as for `bench.running.protocol.protocol_of`.
    start : callable or None
        Returns an executor for a number of jobs; None for worker processes of this machine.

    Raises
    ------
    BadInput
        For a file that is no receipt, is garbled or of another protocol; for a folder without a
        finished run; where the request cannot be made here; and where results of another
        environment are to be compared without their run.
    """
    if not 0 <= choices.share <= 1:
        raise BadInput(f"--share {choices.share:g}: must be from 0 to 1")
    receipt = read_receipt(path)
    if choices.run is not None and is_former(choices.run):
        raise BadInput(f"{choices.run}: of an earlier version; bring it over with 'bench table'")
    manifest = None if choices.run is None else read_finished(choices.run)
    here = _prepare(receipt, choices, manifest or {}, probe, start)
    differences = _compare_protocol(receipt, here)
    remarks = [_environment_remark(receipt, here)]
    with TemporaryDirectory(prefix="bench-verify-") as scratch:
        if choices.run is not None and manifest is not None:
            checks = _verify_folder(receipt, here, choices, manifest, Path(scratch))
        elif choices.share == 0 or here.same_environment:
            checks = _verify_parts(receipt, here, choices, Path(scratch))
        elif differences:
            checks = [], ["no job was computed again"]
        else:
            raise BadInput(
                f"{path}: of another environment ({remarks[0]}), where results can only be "
                "compared within tolerances, and a receipt has no values; give --run DIR"
            )
    return Verdict((*differences, *checks[0]), (*remarks, *checks[1]))


def _prepare(
    receipt: Mapping[str, Any],
    choices: VerifierChoices,
    manifest_there: Mapping[str, Any],
    probe: Callable[[], Mapping[str, str]] | None,
    start: Callable[[int], Executor[Job, Result]] | None,
) -> _Here:
    """Return the receipt's request as it would be run here, with the metrics that it has.

    `manifest_there` is that of the run, empty where only the receipt is at hand. Raises BadInput
    where the request cannot be made here.
    """
    entered = {find_run_method(f"{PREFIX}{tree}").id: f"{PREFIX}{tree}" for tree in choices.images}
    options = replace(options_of(receipt["request"], choices.dataset), workers=choices.workers)
    addresses = (entered.get(m) or address_of(manifest_there, m) for m in options.methods or ())
    options = replace(options, methods=tuple(addresses))
    suite = find(options.suite, SUITES, "suite")
    try:
        protocol, skipped = protocol_of(suite, options, probe)
    except BadInput as error:
        unknown = str(error).partition(": ")[0]
        if not unknown.startswith("unknown method "):
            raise
        raise BadInput(
            f"{unknown}; install its package, or give --images TREE if it was entered by images"
        ) from error
    if lacking := sorted(receipt["metrics"].keys() - protocol.feature_identity.keys()):
        reason = skipped.get(lacking[0], "not of its suite")
        raise BadInput(
            f"{lacking[0]} is measured in the receipt's run, and not here: {reason}; "
            "'bench doctor' says what to install"
        )
    # The weights of fid may be at hand here and not there.
    features = tuple(pair for pair in protocol.features if pair[0] in receipt["metrics"])
    identity = {name: protocol.feature_identity[name] for name, _ in features}
    protocol = replace(protocol, features=features, feature_identity=identity)
    workers = workers_of(protocol.suite, options)
    manifest = describe(protocol, workers, skipped)
    return _Here(
        options,
        protocol,
        plan(protocol),
        manifest,
        environment_with_python(manifest) == receipt["environment"],
        start or (lambda count: JobPool(count, workers, protocol.suite.limits)),
    )


def _compare_protocol(receipt: Mapping[str, Any], here: _Here) -> list[str]:
    """Return a line for each difference between the receipt and code, weights and data here."""
    lines = []
    if here.manifest["code"] != receipt["code"]["sha256"]:
        made_by = receipt["code"]["commit"] or f"release {receipt['code']['version']}"
        lines.append(f"code: not that of the receipt; check out {made_by}")
    weights = weights_of({m: i[1] for m, i in here.manifest["identities"].items()})
    if receipt["weights"].keys() == {"all"}:
        weights = condensed(weights)
    lines += differing("weights here", weights, receipt["weights"])
    metrics = weights_of(here.protocol.feature_identity)
    lines += differing("weights of metrics here", metrics, receipt["metrics"])
    # The plan has grey objects where the truth is grey; inputs are the objects of the dataset.
    inputs = digest_inputs(here.protocol.objects, here.protocol.views, here.protocol.seed)
    return lines + differing("objects here", inputs, receipt["inputs"])


def _environment_remark(receipt: Mapping[str, Any], here: _Here) -> str:
    if here.same_environment:
        return "same environment: results are compared to the last digit"
    other = differing("environment", environment_with_python(here.manifest), receipt["environment"])
    return f"other environment, results are compared within tolerances: {'; '.join(other)}"


def _verify_folder(
    receipt: Mapping[str, Any],
    here: _Here,
    choices: VerifierChoices,
    manifest: Mapping[str, Any],
    scratch: Path,
) -> tuple[list[str], list[str]]:
    """Return differences between a folder and the receipt, and jobs computed here; and remarks."""
    directory = choices.run or Path()
    described = describe_manifest(directory, manifest)
    lines = compare_manifest(receipt, described, manifest["objects"], here.plan.names)
    if described["request"] != receipt["request"] or manifest["objects"] != here.plan.names:
        return lines, [f"{directory} has another run; nothing else is compared"]
    lines += compare_folder(receipt, directory, manifest)
    if any(line.startswith(UNREADABLE) for line in lines):
        return lines, ["nothing is computed again: there is no store to compare with"]
    extractors = [name for name, _ in here.protocol.features]
    more, not_made = remake(
        directory, manifest, extractors, scratch / "again", here.same_environment
    )
    lines += more
    remarks = [f"the folder is compared with the receipt: {receipt['jobs']['count']} jobs"]
    if not_made:
        remarks.append(f"tables compared by checksum alone: {', '.join(not_made)}")
    chosen = draw_jobs(here.plan, choices.share, choices.seed)
    with open_store(directory) as stored, _computed(here, chosen, scratch / "here") as store:
        for obj in chosen:
            lines += _compare_object(obj, stored, store, here.same_environment)
    return lines, [*remarks, _share_remark(here, chosen, choices)]


def _compare_object(
    obj: ChosenJobs, stored: Store, store: Store, same_environment: bool
) -> list[str]:
    """Return a line for each difference between the jobs of an object in two stores."""
    scene = obj.planned.truth.object
    keys = {row.name: row.key for row in stored.listed_of(scene.class_name, scene.object_id)}
    lines, truth = [], None
    for job in obj.all:
        title, key = job_title(job.name), keys.get(job.name, "")
        if same_environment and key != job.key:
            lines.append(f"{title}: its key is not the one that it has here")
        try:
            results = read_job(stored, key)
        except KeyError:
            lines.append(f"{title}: not in the run")
            continue
        except DAMAGED as error:
            lines.append(f"{title}: {error}")
            continue
        here = read_job(store, job.key)
        lines += compare_job(job, results, here, same_environment)
        if not same_environment:
            lines += misscored(job, results, truth)
            if job is obj.planned.truth and results.arrays and here.arrays:
                lines += other_truth(job, results, here)
                truth = results.arrays[IMAGES]
    return lines


@contextmanager
def _computed(here: _Here, chosen: Sequence[ChosenJobs], directory: Path) -> Iterator[Store]:
    """Yield a store in `directory` with the results of the chosen jobs."""
    with open_folder(directory) as store:
        if chosen:
            compute(chosen, store, here.start)
        yield store


def _share_remark(here: _Here, chosen: Sequence[ChosenJobs], choices: VerifierChoices) -> str:
    jobs = sum(len(obj.jobs) for obj in chosen)
    total = len(here.plan) * (here.plan.jobs_per_object - 1)
    return (
        f"computed again: {jobs} of {total} jobs and {len(chosen)} of {len(here.plan)} objects' "
        f"true images, drawn by --seed {choices.seed}"
    )


def _verify_parts(
    receipt: Mapping[str, Any], here: _Here, choices: VerifierChoices, scratch: Path
) -> tuple[list[str], list[str]]:
    """Return the parts of the jobs whose results here are not those of the receipt, and remarks.

    Where all parts are computed, records and tables are made of them and compared, too.
    """
    parts = deal(here.plan.names)
    numbers = draw_parts(len(parts), choices.share, choices.seed)
    digests = [receipt["jobs"]["parts"][i * PART_DIGITS :][:PART_DIGITS] for i in range(len(parts))]
    some = here.plan.select(name for number in numbers for name in parts[number])
    chosen = [ChosenJobs(planned, planned.jobs[1:]) for planned in some]
    lines: list[str] = []
    with _computed(here, chosen, scratch) as store:
        store.list_jobs((j.key, j.name) for obj in some for j in obj.listed)
        for number in numbers:
            rows = (store.listed_of(*name.split("/", 1)) for name in parts[number])
            leaves = [leaf for row in rows for leaf in digest_object(store, row, lines)]
            if part_digest(leaves)[:PART_DIGITS] != digests[number]:
                members = ", ".join(parts[number])
                lines.append(f"jobs of {members}: the results here are not those of the receipt")
        whole = len(numbers) == len(parts)
        if whole:
            lines += _compare_tables(receipt, here, store, scratch)
    remarks = [_share_remark(here, chosen, choices)]
    if not whole:
        remarks.append(
            "not known without --run: the other jobs, and whether the tables follow from them "
            "(--share 1 computes all)"
        )
    return lines, remarks


def _compare_tables(
    receipt: Mapping[str, Any], here: _Here, store: Store, scratch: Path
) -> list[str]:
    """Make records and tables of all jobs of a request, and return what differs from the receipt.

    Tables that others make, such as those of further metrics, are left out.
    """
    manifest = here.manifest | {
        "request": pinned_request(here.options, here.protocol),
        "planned": len(here.plan),
        "finished": now(),
    }
    write_manifest(scratch, manifest)
    write_parquet(manifest, scratch, store, [name for name, _ in here.protocol.features], {})
    write_outputs(scored_run(scratch, manifest))
    remade = digest_tables(scratch, here.protocol.suite)
    tables = condensed(remade) if receipt["tables"].keys() == {"all"} else remade
    lines = [
        f"{TABLES}/{name}: the table of the results here is not that of the receipt"
        for name, digest in receipt["tables"].items()
        if tables.get(name, digest) != digest
    ]
    if digest_records(scratch) != receipt["records"]:
        lines.append(f"{RECORDS}: the records here are not those of the receipt")
    jobs = digest_jobs(store, manifest, lines)[0]
    if jobs != receipt["jobs"]:
        lines.append("jobs: the results here are not those of the receipt")
    return lines
