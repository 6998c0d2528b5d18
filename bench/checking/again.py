"""The check of a finished run by its own jobs: a random share of them is computed again.

In the environment of the run images, features and scores have to be equal. In another one the means
over the views of each object may differ by the tolerances of golden values. Tables, report and
`records.parquet` are not read: they are made of the same store. The folder is only read.
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
from bench.checking.tolerances import OBJECT_RENDERING, object_tolerance
from bench.metrics.inception_weights import DOWNLOAD
from bench.records.job import IMAGES, Job, failed, unpack
from bench.records.record import GROUND_TRUTH
from bench.records.run_folder import read_finished
from bench.records.store import Store, open_store
from bench.running.environment import (
    cores,
    environment,
    environment_of,
    is_same,
    machine_info,
    told_mixture,
)
from bench.running.isolation import Executor
from bench.running.plan import ObjectJobs, Plan, plan
from bench.running.protocol import Protocol, extractors_of
from bench.running.work import JobPool, run_jobs
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.progress import log
from data_prep.randomness import generator


@dataclass(frozen=True)
class _AgainResult:
    """A line for each job that differs, and how many jobs were computed again, of how many.

    Lines are about true images, too; they are no jobs of a method, and do not count as such.
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
    """Compute a share of the jobs of a finished run again, drawn by a seed, and compare results.

    The true images of their objects are computed, too. A line on stderr names libraries, methods
    and metrics that are others than in the run. `probe` is as for
    `Protocol.from_options`; `start` gives an executor for a number of jobs (default:
    worker processes as of a run).

    Raises BadInput for a share that is not over 0 and at most 1, for a folder without a finished
    run of jobs, for records that are unreadable, and where a method, a condition or an object of
    the run is no longer there.
    """
    if not 0 < share <= 1:
        raise BadInput(f"--again {share:g}: must be over 0 and at most 1")
    manifest = read_finished(directory)
    protocol = _protocol_again(directory, manifest)
    planned = plan(protocol)
    same_environment = _name_changes(manifest, replace(protocol, environment=probe()))
    workers, limits = 1 if protocol.suite.timed else cores(), protocol.suite.limits
    chosen = draw_jobs(planned, share, seed)
    log(f"jobs drawn by --seed {seed}")
    lines: list[str] = []
    with (
        open_store(directory) as stored,
        TemporaryDirectory(prefix="bench-again-") as scratch,
        open_store(Path(scratch), write=True) as store,
    ):
        _compute(chosen, store, start or partial(JobPool, workers=workers, limits=limits))
        for obj, jobs in chosen:
            keys = {row.name: row.key for row in stored.listed(*obj.truth.name.object)}
            for job in (obj.truth, *jobs):
                key = keys.get(job.name, "")
                lines += _compare(job, stored, key, store, same_environment)
    computed = sum(len(jobs) for _, jobs in chosen)
    total = (planned.jobs_per_object - 1) * len(planned)
    return _AgainResult(tuple(lines), computed, total, same_environment)


def _protocol_again(directory: Path, manifest: Mapping[str, Any]) -> Protocol:
    """Return the protocol of a run, with the extractors of features that it has."""
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
    weights = None if weights == DOWNLOAD else weights  # only a run fetches
    features, identity, skipped = extractors_of(
        manifest["feature_identity"], weights, protocol.device
    )
    for name, reason in skipped.items():
        log(f"{name}: not compared; {reason}")
    return replace(protocol, features=features, feature_identity=identity)


def _name_changes(manifest: Mapping[str, Any], protocol: Protocol) -> bool:
    """Name what is another than in the run, and return whether the environment is the same."""
    for name, here in {**protocol.identities, **protocol.feature_identity}.items():
        if here != {**manifest["identities"], **manifest["feature_identity"]}.get(name):
            log(f"{name}: of another version or with other weights than in the run")
    of_run = environment_of(manifest)
    here = environment_of(
        {"environment": protocol.environment, "device": protocol.device, **machine_info()}
    )
    if here != of_run:
        others = "; ".join(f"{n} {here[n]} ({of_run[n]})" for n in here if here[n] != of_run[n])
        log(f"another environment than that of the run, wider tolerances: {others}")
    if mixture := told_mixture(manifest):
        log(mixture)
    return is_same(here, of_run)


def draw_jobs(planned: Plan, share: float, seed: int) -> list[tuple[ObjectJobs, list[Job]]]:
    """Return a random share of a plan's jobs by object, at least one; ground truths are not drawn.

    Every job is as probable as any other.
    """
    cells = planned.jobs_per_object - 1
    total = cells * len(planned)
    drawn = generator("again", seed).choice(total, max(1, round(share * total)), replace=False)
    cells_of: dict[int, list[int]] = {}
    for number in sorted(map(int, drawn)):
        cells_of.setdefault(number // cells, []).append(1 + number % cells)
    objects = ((planned[place], chosen) for place, chosen in cells_of.items())
    return [(obj, [obj.jobs[cell] for cell in chosen]) for obj, chosen in objects]


def _compute(
    chosen: Sequence[tuple[ObjectJobs, list[Job]]],
    store: Store,
    start: Callable[[int], Executor],
) -> None:
    """Compute the chosen jobs into an open store, the ground truths of their objects first."""
    truths = run_jobs([obj.truth for obj, _ in chosen], store, "true images", start)
    ready: list[Job] = []
    for obj, jobs in chosen:
        truth = truths[obj.truth.key]
        if truth.has_images:
            ready += jobs
            continue
        for job in jobs:  # as in a run: there is nothing to score against
            store.append(failed(job, truth.reason))
    run_jobs(ready, store, "jobs", start)


def _compare(job: Job, stored: Store, key: str, store: Store, same_environment: bool) -> list[str]:
    """Return a line where the results of a job in the run, under a key, are not those here."""
    at = f" at {job.condition}" if job.condition else ""
    title = f"{job.method}{at} of {'/'.join(job.name.object)}"
    if (was := stored.find([key]).get(key)) is None:
        return [f"{title}: not in the store of the run"]
    now = store.find([job.key])[job.key]
    if (was.has_images, was.reason) != (now.has_images, now.reason):
        told = ["images" if r.has_images else f"failed ({r.reason})" for r in (was, now)]
        return [f"{title}: {told[0]} in the run, {told[1]} here"]
    if not was.has_images:
        return []
    names = [IMAGES, *(name for name, _ in job.features)]
    try:
        in_run = _numbers(stored, key, names)
    except (BadInput, KeyError) as error:
        return [f"{title}: {error.args[0]}"]
    here = _numbers(store, job.key, names)
    find = _inequality if same_environment else partial(_beyond_tolerance, job.method)
    differences = [text for name in here if (text := find(name, in_run[name], here[name]))]
    return [f"{title}: {'; '.join(differences)}"] if differences else []


def _numbers(store: Store, key: str, names: Sequence[str]) -> dict[str, Floats]:
    """Return the images, features and scores of a job by name; NaN where there is no score."""
    numbers = {name: unpack(store.array(key, name)).astype(np.float64) for name in names}
    scores = store.result(key).of_views
    return numbers | {metric: scores[column(metric)] for metric in OBJECT_RENDERING}


def _inequality(name: str, stored: Floats, here: Floats) -> str:
    """Return by how much numbers [views, ...] of a job differ; empty where they are equal."""
    if stored.shape != here.shape:
        return f"{name} {[*stored.shape]} in the run, {[*here.shape]} here"
    other = (stored != here) & ~(np.isnan(stored) & np.isnan(here))
    if not other.any():
        return ""
    views = int(other.reshape(len(other), -1).any(axis=1).sum())
    most = np.nan_to_num(np.abs(stored - here)[other], nan=np.inf).max()
    unit = " levels of 255" if name == IMAGES else ""
    return f"{name} of {views} of {len(other)} views differ by up to {most:.3g}{unit}"


def _beyond_tolerance(method: str, name: str, stored: Floats, here: Floats) -> str:
    """Return how a mean over views differs that another environment does not move so far."""
    if name not in OBJECT_RENDERING or method == GROUND_TRUTH:
        return ""
    was, now = (values[~np.isnan(values)] for values in (stored, here))
    if not was.size and not now.size:
        return ""
    by = abs(was.mean() - now.mean()) if was.size and now.size else np.inf
    allowed = object_tolerance(method, name, same_environment=False)
    return "" if by <= allowed else f"{name} differs by {by:.3g}, allowed {allowed:g}"
