"""The check that a finished run can be repeated: a random share of its jobs is computed again.

In the environment of the run, the images, features and scores have to be equal to those in the
run's store. In another environment, only the mean of each score over the views of an object is
compared, and it may differ by the tolerances of golden values. Tables, report and `records.parquet`
are not compared, because they are made from the same store. Nothing is written into the folder.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench.catalogue.metrics import column
from bench.catalogue.suites import PROCEDURES
from bench.check.tolerances import OBJECT_RENDERING, object_tolerance
from bench.metrics.inception_weights import DOWNLOAD
from bench.records.folder import read_finished
from bench.records.job import GROUND_TRUTH, IMAGES, Job, failed, unpack
from bench.records.store import Store, open_store
from bench.running.environment import (
    cores,
    environment,
    environment_of,
    is_same,
    machine_info,
    told_mixture,
)
from bench.running.plan import ObjectJobs, Plan, plan
from bench.running.pool import Executor
from bench.running.protocol import Protocol, extractors_of
from bench.running.work import JobPool, run_jobs
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.progress import log
from data_prep.randomness import generator


@dataclass(frozen=True)
class _AgainResult:
    """The result of computing jobs again.

    differing         a line for each job whose results differ, and for each object whose true
                      images do
    computed          the number of jobs that were computed again; true images do not count
    total             the number of jobs of the run, without those of true images
    same_environment  whether this is the environment of the run
    """

    differing: tuple[str, ...]
    computed: int
    total: int
    same_environment: bool


def check_again(
    directory: Path,
    share: float,
    seed: int,
    probe: Callable[[], Mapping[str, str]] = environment,
    start: Callable[[int], Executor] | None = None,
) -> _AgainResult:
    """Compute a random share of the jobs of a finished run again, and compare the results.

    The true images of the objects of these jobs are computed again, too. Lines on stderr name the
    libraries, methods and metrics whose versions are not those of the run.

    share  the share of the jobs, over 0 and at most 1
    seed   the seed by which the jobs are drawn
    probe  returns the environment, as for `Protocol.from_options`
    start  returns an executor for a number of jobs; by default the worker processes of a run

    Raises BadInput for another share, for a folder without a finished run that consists of jobs,
    for unreadable records, and where a method, condition or object of the run no longer exists.
    """
    if not 0 < share <= 1:
        raise BadInput(f"--again {share:g}: must be over 0 and at most 1")
    manifest = read_finished(directory)
    protocol = _protocol_again(directory, manifest)
    planned = plan(protocol)
    same_environment = _name_changes(manifest, replace(protocol, environment=probe()))
    workers = 1 if protocol.suite.timed else cores()
    limits = protocol.suite.limits
    drawn = draw_jobs(planned, share, seed)
    log(f"jobs drawn by --seed {seed}")
    lines: list[str] = []
    with (
        open_store(directory) as stored,
        TemporaryDirectory(prefix="bench-again-") as scratch,
        open_store(Path(scratch), write=True) as store,
    ):
        _compute(drawn, store, start or partial(JobPool, workers=workers, limits=limits))
        for obj, jobs in drawn:
            keys = {row.name: row.key for row in stored.listed(*obj.truth.name.object)}
            for job in (obj.truth, *jobs):
                key = keys.get(job.name, "")
                lines += _compare(job, stored, key, store, same_environment)
    method_jobs = planned.jobs_per_object - 1  # without the job that draws the true images
    return _AgainResult(
        differing=tuple(lines),
        computed=sum(len(jobs) for _, jobs in drawn),
        total=method_jobs * len(planned),
        same_environment=same_environment,
    )


def _protocol_again(directory: Path, manifest: Mapping[str, Any]) -> Protocol:
    """Return the protocol of a run, with the extractors whose features the run has stored."""
    if manifest["suite"] in [suite.id for suite in PROCEDURES]:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} has no jobs that could be computed again; "
            "give one of a suite with records"
        )
    names = manifest["objects"]
    protocol = Protocol.from_manifest(manifest)
    if lacking := sorted({*names} - {*protocol.names}):
        raise BadInput(
            f"{directory}: {lacking[0]} is not in {protocol.dataset} any more ({len(lacking)} of "
            f"{len(names)} objects are not); bring the dataset back as it was"
        )
    weights = manifest.get("request", {}).get("inception_weights")
    if weights == DOWNLOAD:  # `bench run` downloads weights; here they have to be there already
        weights = None
    features, identity, skipped = extractors_of(
        manifest["feature_identity"], weights, protocol.device
    )
    for name, reason in skipped.items():
        log(f"{name}: not compared; {reason}")
    return replace(protocol, features=features, feature_identity=identity)


def _name_changes(manifest: Mapping[str, Any], protocol: Protocol) -> bool:
    """Log what has changed since the run, and return whether the environment is the same."""
    identities_then = {**manifest["identities"], **manifest["feature_identity"]}
    identities_now = {**protocol.identities, **protocol.feature_identity}
    for name, identity in identities_now.items():
        if identity != identities_then.get(name):
            log(f"{name}: of another version or with other weights than in the run")
    of_run = environment_of(manifest)
    here = environment_of(
        {"environment": protocol.environment, "device": protocol.device, **machine_info()}
    )
    if here != of_run:
        changed = [name for name in here if here[name] != of_run[name]]
        others = "; ".join(f"{name} {here[name]} ({of_run[name]})" for name in changed)
        log(f"another environment than that of the run, wider tolerances: {others}")
    if mixture := told_mixture(manifest):
        log(mixture)
    return is_same(here, of_run)


def draw_jobs(planned: Plan, share: float, seed: int) -> list[tuple[ObjectJobs, list[Job]]]:
    """Return a random share of a plan's jobs, at least one, together with their objects.

    All jobs are equally probable. Those that draw true images are not among them.
    """
    # Job 0 of each object draws its true images; the others are numbered object by object.
    method_jobs = planned.jobs_per_object - 1
    total = method_jobs * len(planned)
    count = max(1, round(share * total))
    numbers = generator("again", seed).choice(total, count, replace=False)
    jobs_of: dict[int, list[int]] = {}
    for number in sorted(map(int, numbers)):
        object_number, job_number = divmod(number, method_jobs)
        jobs_of.setdefault(object_number, []).append(1 + job_number)
    drawn = []
    for object_number, job_numbers in jobs_of.items():
        obj = planned[object_number]
        drawn.append((obj, [obj.jobs[job_number] for job_number in job_numbers]))
    return drawn


def _compute(
    drawn: Sequence[tuple[ObjectJobs, list[Job]]],
    store: Store,
    start: Callable[[int], Executor],
) -> None:
    """Compute jobs, after the true images of their objects, and put the results into a store."""
    truths = run_jobs([obj.truth for obj, _ in drawn], store, "true images", start)
    ready: list[Job] = []
    for obj, jobs in drawn:
        truth = truths[obj.truth.key]
        if truth.has_images:
            ready += jobs
            continue
        for job in jobs:  # a run does the same: without true images there are no scores
            store.append(failed(job, truth.reason))
    run_jobs(ready, store, "jobs", start)


def _compare(job: Job, stored: Store, key: str, store: Store, same_environment: bool) -> list[str]:
    """Return a line with the differences between two results of a job; no line without any.

    stored, key  the store of the run, and the key of the job there
    store        the store into which the job was computed again
    """
    at = f" at {job.condition}" if job.condition else ""
    title = f"{job.method}{at} of {'/'.join(job.name.object)}"
    if (was := stored.find([key]).get(key)) is None:
        return [f"{title}: not in the store of the run"]
    now = store.find([job.key])[job.key]
    if (was.has_images, was.reason) != (now.has_images, now.reason):
        before, here = (
            "images" if result.has_images else f"failed ({result.reason})" for result in (was, now)
        )
        return [f"{title}: {before} in the run, {here} here"]
    if not was.has_images:
        return []
    names = [IMAGES, *(name for name, _ in job.features)]
    try:
        in_run = _numbers(stored, key, names)
    except (BadInput, KeyError) as error:
        return [f"{title}: {error.args[0]}"]
    differences = []
    for name, numbers in _numbers(store, job.key, names).items():
        if same_environment:
            difference = _inequality(name, in_run[name], numbers)
        else:
            difference = _beyond_tolerance(job.method, name, in_run[name], numbers)
        if difference:
            differences.append(difference)
    return [f"{title}: {'; '.join(differences)}"] if differences else []


def _numbers(store: Store, key: str, names: Sequence[str]) -> dict[str, Floats]:
    """Return the images, features and scores of a job by their names; a missing score is NaN."""
    numbers = {name: unpack(store.array(key, name)).astype(np.float64) for name in names}
    scores = store.result(key).of_views
    return numbers | {metric: scores[column(metric)] for metric in OBJECT_RENDERING}


def _inequality(name: str, stored: Floats, here: Floats) -> str:
    """Return in words by how much two arrays [views, ...] differ; "" where they are equal."""
    if stored.shape != here.shape:
        return f"{name} {[*stored.shape]} in the run, {[*here.shape]} here"
    differs = (stored != here) & ~(np.isnan(stored) & np.isnan(here))
    if not differs.any():
        return ""
    views = int(differs.reshape(len(differs), -1).any(axis=1).sum())
    most = np.nan_to_num(np.abs(stored - here)[differs], nan=np.inf).max()
    unit = " levels of 255" if name == IMAGES else ""
    return f"{name} of {views} of {len(differs)} views differ by up to {most:.3g}{unit}"


def _beyond_tolerance(method: str, name: str, stored: Floats, here: Floats) -> str:
    """Return in words how far the mean of a score over views [views] has moved beyond tolerance.

    "" where it has not, and for numbers without a tolerance, such as features.
    """
    if name not in OBJECT_RENDERING or method == GROUND_TRUTH:
        return ""
    was, now = (values[~np.isnan(values)] for values in (stored, here))
    if not was.size and not now.size:
        return ""
    move = abs(was.mean() - now.mean()) if was.size and now.size else np.inf
    allowed = object_tolerance(method, name, same_environment=False)
    return "" if move <= allowed else f"{name} differs by {move:.3g}, allowed {allowed:g}"
