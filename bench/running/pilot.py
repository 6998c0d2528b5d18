"""A few items of a run measured on this machine, and the cost of the run from them.

The items are done in a temporary folder, in worker processes like those of a run and as many, since
cost and memory depend on the neighbours on the machine and on what else a process has loaded. The
first item of a method in a process takes longer (libraries, weights, a first image): it is done
twice, the second time counts, and the difference is loading, which a run pays once a process.

What an object costs depends on its size (how much of its box it fills): the surfaces of the paper
take one chair five times as long as another, so that a handful of objects says little about the
mean of all. Sizes of many objects are known at once, so costs are taken along a straight line to
the mean size ("regression estimator", Cochran, Sampling Techniques, 1977, chapter 7).
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, stdev
from typing import Any, NamedTuple

import numpy as np
import psutil
from numpy.typing import NDArray

from bench.catalogue.methods import FLOOR
from bench.catalogue.suites import Limits
from bench.records.job import Job
from bench.records.journal import to_line
from bench.records.record import GROUND_TRUTH
from bench.running.isolation import TASKS_PER_WORKER, WorkerFailure, run_tasks
from bench.running.plan import plan
from bench.running.protocol import Protocol
from bench.running.work import run_job
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.progress import log, progress
from data_prep.randomness import generator

Cell = tuple[str, str]  # method and condition; of ground truths GROUND_TRUTH and nothing
FEWEST_FOR_A_LINE = 4  # with three points, a line leaves one degree of freedom
CANDIDATES = 200  # objects whose size is measured; their clouds take some 20 ms each
CELLS = 15  # along the longest side; as good as 50, and depends less on the number of points
OPTIONAL = "fid"  # features that a run takes only where its weights are given


@dataclass(frozen=True)
class Sample:
    """One item of the pilot, in a process that had done the method before.

    size        of its object, see `size_of`
    seconds     of a worker for the whole job: method, metrics, features, harness
    method_s    of these the method's
    size_b      bytes of its artifact and its line in the journal
    peak_mib    most resident memory of its worker meanwhile, all libraries and weights included
    ssim        mean over its views; None of ground truths and failures
    reason      why it failed; empty where it did not
    loading_s   seconds more that it took as the first of its method in a process, of the first
                method the start of the process included; None where it was not
    optional_s  of `seconds` the optional features'; None where that was not measured

    seconds, method_s and size_b are nan where its worker died before the time limit.
    """

    method: str
    condition: str
    class_name: str
    object_id: str
    size: float
    seconds: float
    method_s: float
    size_b: float
    peak_mib: float
    ssim: float | None
    reason: str
    loading_s: float | None = None
    optional_s: float | None = None


@dataclass(frozen=True)
class Pilot:
    """What was measured, and the sizes of the objects that it stands for."""

    samples: tuple[Sample, ...]
    sizes: tuple[float, ...]


class Amount(NamedTuple):
    """An estimate with its 95 % interval; nan where a pilot is too small for one."""

    value: float
    low: float
    high: float


# --- measure --------------------------------------------------------------------------------------


def measure(protocol: Protocol, objects: int, workers: int) -> Pilot:
    """Do all methods and conditions of the protocol on so many of its objects (at most all).

    Raises BadInput where `objects` is less than one and where none of the objects can be drawn, and
    MissingDependency where a method cannot be run here at all.
    """
    if objects < 1:
        raise BadInput(f"--pilot {objects}: must be at least 1")
    sizes = sizes_of(protocol, workers)
    chosen = spread(sizes, objects)
    if not chosen:
        raise BadInput(
            f"{protocol.dataset}: none of the objects looked at has a cloud; 'bench data inspect' "
            "says why"
        )
    named = {(obj.class_name, obj.object_id): obj for obj in protocol.objects}
    part = replace(protocol, objects=tuple(named[name] for name in chosen))
    log(
        f"pilot: {len(chosen)} of {len(protocol.objects)} objects x "
        f"{len(protocol.conditions)} conditions x {len(protocol.methods)} methods"
    )
    limits = protocol.suite.limits
    with tempfile.TemporaryDirectory(prefix="bench-plan-") as folder:
        planned = plan(part, Path(folder))
        truths = _measure(planned.ground_truths, sizes, workers, limits, "pilot's ground truth")
        drawn = {job.artifact for job, sample in truths if not sample.reason}
        if not drawn:
            first = truths[0][1].reason
            raise BadInput(f"none of the pilot's objects can be drawn; the first: {first}")
        jobs = [job for job in planned.jobs if job.reference in drawn]
        items = _measure(jobs, sizes, workers, limits, "pilot")
    return Pilot(tuple(sample for _, sample in (*truths, *items)), tuple(sizes.values()))


def _measure(
    jobs: Sequence[Job],
    sizes: Mapping[tuple[str, str], float],
    workers: int,
    limits: Limits,
    title: str,
) -> list[tuple[Job, Sample]]:
    """The jobs with their samples, as they end."""
    tasks = [(job, sizes[job.object.class_name, job.object.object_id]) for job in jobs]
    twice = replace(limits, time_s=2 * limits.time_s)  # first items of processes are done twice
    done, failures = [], 0
    with (
        progress(title, len(tasks)) as advance,
        closing(run_tasks(tasks, measured, min(workers, len(tasks)), twice)) as stream,
    ):
        for (job, size), found in stream:
            if isinstance(found, WorkerFailure):
                sample = lost_sample(job, size, found, limits)
            else:
                sample = replace(found, seconds=min(found.seconds, limits.time_s))
            done.append((job, sample))
            failures += bool(sample.reason)
            advance(failures)
    return done


_done_here: set[str] = set()  # in a worker: methods that it has done


def measured(task: tuple[Job, float]) -> Sample:
    """In a worker: do a job on an object of this size, and measure what it takes.

    Raises MissingDependency where going on with the method makes no sense.
    """
    job, size = task
    first_s = None
    if job.method not in _done_here:
        # The first job waits for Python, which the worker's keeper starts.
        begun = time.time() if _done_here else psutil.Process(os.getppid()).create_time()
        run_job(job)
        first_s = time.time() - begun
        _done_here.add(job.method)
    _forget_peak()
    start = time.perf_counter()
    result = run_job(job)
    seconds = time.perf_counter() - start
    if result.unusable:
        raise MissingDependency(result.unusable)
    scores = [record.ssim for record in result.records if record.ssim is not None]
    return _sample(
        job,
        size,
        seconds=seconds,
        method_s=result.timing.methods,
        size_b=float(len(to_line(result)))
        + (job.artifact.stat().st_size if result.artifact_sha256 else 0),
        peak_mib=_peak_mib(),
        ssim=fmean(scores) if scores else None,
        reason=result.records[0].reason,
        loading_s=None if first_s is None else max(0.0, first_s - seconds),
        optional_s=_optional_s(job, seconds),
    )


def _optional_s(job: Job, seconds: float) -> float | None:
    """What a job of the floor takes less without the optional features; None of other jobs.

    Of any method they cost the same, and the floor costs least beside them.
    """
    features = tuple(pair for pair in job.features if pair[0] != OPTIONAL)
    if job.method != FLOOR or features == job.features:
        return None
    start = time.perf_counter()
    run_job(replace(job, features=features, artifact=job.artifact.with_suffix(".without.npz")))
    return max(0.0, seconds - (time.perf_counter() - start))


def lost_sample(job: Job, size: float, lost: WorkerFailure, limits: Limits) -> Sample:
    """Of an item that was stopped at its time limit, or (nan) whose worker died otherwise."""
    stopped = lost.kind == "timeout"
    taken = limits.time_s if stopped else math.nan
    return _sample(
        job,
        size,
        seconds=taken,
        method_s=taken,
        size_b=0.0 if stopped else math.nan,
        peak_mib=limits.memory_gib * 2**10 if lost.kind == "memory" else 0.0,
        ssim=None,
        reason=lost.reason,
    )


def _sample(job: Job, size: float, **measured: Any) -> Sample:
    return Sample(job.method, job.condition, *job.name.object, size, **measured)


def _forget_peak() -> None:
    """Where the kernel can (Linux, where it is allowed), count the peak of memory from now on."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _peak_mib() -> float:
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 2**10
    import resource

    unit = 1 if sys.platform == "darwin" else 2**10  # bytes there, else KiB
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


# --- sizes ----------------------------------------------------------------------------------------


def size_of(points: NDArray[np.floating]) -> int:
    """How large an object is for its box: occupied cells of a grid, of points [N, 3].

    The grid has `CELLS` cubes along the longest side. 1 for points in one place, 0 for none.
    """
    if not len(points):
        return 0
    low = points.min(axis=0)
    longest = float((points.max(axis=0) - low).max())
    if longest == 0:
        return 1
    places = np.minimum((points - low) * (CELLS / longest), CELLS - 1).astype(np.int64)
    return len(np.unique(places, axis=0))


def sizes_of(protocol: Protocol, workers: int) -> dict[tuple[str, str], float]:
    """Sizes of the protocol's objects (class, name), of a random `CANDIDATES` where they are more.

    In their order; the choice is the same every time. Objects without a readable cloud are left
    out, with a message.
    """
    count = len(protocol.objects)
    rng = generator(0, "pilot", str(count))
    chosen = sorted(rng.choice(count, min(count, CANDIDATES), replace=False).tolist())
    tasks = [(protocol.objects[i], protocol.seed) for i in chosen]
    found: dict[tuple[str, str], float] = {}
    limits = protocol.suite.limits
    with closing(run_tasks(tasks, _size, min(workers, len(tasks)), limits)) as stream:
        for (obj, _), size in stream:
            if isinstance(size, int):
                found[obj.class_name, obj.object_id] = float(size)
    if lacking := len(tasks) - len(found):
        log(f"pilot: {lacking} of {len(tasks)} objects have no readable cloud; left out")
    names = [(obj.class_name, obj.object_id) for obj, _ in tasks]
    return {name: found[name] for name in names if name in found}


def _size(task: tuple[SceneObject, int]) -> int | None:
    """In a worker: the size of an object; None where it has no cloud, for whatever reason."""
    obj, seed = task
    try:
        return size_of(obj.cloud(generator(seed, "cloud", obj.class_name, obj.object_id)).points)
    except Exception:  # a run has this as the reason of a failed item
        return None


def spread(sizes: Mapping[tuple[str, str], float], count: int) -> list[tuple[str, str]]:
    """At most `count` of the objects (class, name), spread over classes and, within them, sizes.

    Sorted and cut into `count` parts of about one length; of each part the one in its middle. With
    at least as many as there are classes, equally large, every class has one.
    """
    in_order = sorted(sizes, key=lambda name: (name[0], sizes[name]))
    count = min(count, len(in_order))
    return [in_order[(2 * part + 1) * len(in_order) // (2 * count)] for part in range(count)]


# --- estimate -------------------------------------------------------------------------------------


def estimate(pilot: Pilot, left: Mapping[Cell, int], quantity: str = "seconds") -> Amount:
    """The sum of a quantity of `Sample` over `left` items of each method and condition.

    A sample that is missing is the mean of its method and condition, else of its method; nan where
    there is none of these.
    """
    sizes = {(s.class_name, s.object_id): s.size for s in pilot.samples}
    per_object = np.zeros(len(sizes))  # of the whole of `left`, were all objects as this one
    for (method, condition), items in left.items():
        if not items:
            continue
        of_method = {
            (s.condition, s.class_name, s.object_id): getattr(s, quantity)
            for s in pilot.samples
            if s.method == method and math.isfinite(getattr(s, quantity))
        }
        known = [value for key, value in of_method.items() if key[0] == condition]
        known = known or list(of_method.values())
        missing = fmean(known) if known else math.nan
        per_object += [items * of_method.get((condition, *name), missing) for name in sizes]
    return mean_at(per_object, np.array([*sizes.values()]), pilot.sizes)


def mean_at(
    costs: NDArray[np.float64], sizes: NDArray[np.float64], among: Sequence[float]
) -> Amount:
    """The mean of `costs` [n] of objects of `sizes` [n], at the mean of the sizes `among` [m].

    With a line through them (Student's t with n - 2 degrees of freedom); it never leaves the range
    of the costs. The plain mean with fewer than 4 objects, or all of one size. The interval takes
    in that `among` may be a sample; nan with fewer than two objects. nan throughout for none.
    """
    count = len(costs)
    if count == 0 or not np.isfinite(costs).all():
        return Amount(math.nan, math.nan, math.nan)
    mean, deviations = float(costs.mean()), sizes - sizes.mean()
    spread_of_sizes = float((deviations**2).sum())
    slope, shift, free = 0.0, 0.0, count - 1
    if count >= FEWEST_FOR_A_LINE and spread_of_sizes > 1e-12 * float((sizes**2).sum()):
        slope = float((deviations * costs).sum()) / spread_of_sizes
        shift, free = float(np.mean(among)) - float(sizes.mean()), count - 2
    value = float(np.clip(mean + slope * shift, costs.min(), costs.max()))
    if free < 1:
        return Amount(value, math.nan, math.nan)
    from scipy.stats import t

    residual = float(((costs - mean - slope * deviations) ** 2).sum()) / free
    variance = residual / count
    if slope:
        variance += residual * shift**2 / spread_of_sizes
        variance += slope**2 * float(np.var(among)) / len(among)
    half = float(t.ppf(0.975, free)) * math.sqrt(variance)
    return Amount(value, max(0.0, value - half), value + half)


def loading_s(pilot: Pilot, left: Mapping[Cell, int], workers: int) -> float:
    """Seconds of all worker processes that do `left` to start, and to load every method of it.

    Ground truths come before all else, in worker processes of their own.
    """
    truths = {cell: n for cell, n in left.items() if n and cell[0] == GROUND_TRUTH}
    items = {cell: n for cell, n in left.items() if n and cell[0] != GROUND_TRUTH}
    total = 0.0
    for part in (truths, items):
        jobs = sum(part.values())
        processes = max(min(workers, jobs), math.ceil(jobs / TASKS_PER_WORKER))
        for method in {method for method, _ in part}:
            found = [
                s.loading_s for s in pilot.samples if s.method == method and s.loading_s is not None
            ]
            total += processes * fmean(found) if found else 0.0
    return total


def core_s(pilot: Pilot, left: Mapping[Cell, int], workers: int) -> Amount:
    """Seconds of a core for `left` items of each method and condition, loading included."""
    loading = loading_s(pilot, left, workers)
    return Amount(*(seconds + loading for seconds in estimate(pilot, left)))


def peak_mib(pilot: Pilot, left: Mapping[Cell, int]) -> float:
    """The most memory of a worker; nan where there is nothing to do."""
    found = [s.peak_mib for s in pilot.samples if left.get((s.method, s.condition))]
    return max(found, default=math.nan)


def ssim_deviations(pilot: Pilot, cells: Sequence[Cell]) -> dict[Cell, float]:
    """How far the SSIM of objects is spread; of cells with two objects that have one."""
    found = {
        cell: [
            s.ssim for s in pilot.samples if (s.method, s.condition) == cell and s.ssim is not None
        ]
        for cell in cells
    }
    return {cell: stdev(scores) for cell, scores in found.items() if len(scores) > 1}
