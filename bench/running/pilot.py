"""A pilot: some jobs of a run, done and measured on this machine before the run starts."""

from __future__ import annotations

import math
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from bench.catalogue.suites import Limits
from bench.records.job import Job
from bench.records.record import GROUND_TRUTH
from bench.records.store import pack_records
from bench.running.isolation import WorkerFailure, run_tasks
from bench.running.plan import plan
from bench.running.protocol import Protocol, name_of
from bench.running.status import MethodCondition
from bench.running.work import run_job
from data_prep.arrays import Floats32
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput, MissingDependency
from data_prep.progress import log, progress
from data_prep.randomness import generator

CANDIDATES = 200  # objects whose clouds are read, in some 20 ms each
GRID = 15  # cubes along the longest side; as good as 50, and depends less on the number of points


class Cost(NamedTuple):
    """The cost of jobs: seconds of a core, loading excluded, and bytes of disk."""

    seconds: float
    size_b: float


@dataclass(frozen=True)
class Sample:
    """A measured job of the pilot.

    Attributes
    ----------
    cost : Cost
        nan where the worker died before the time limit.
    peak_mib : float
        Most memory of the worker so far, libraries and weights included.
    reason : str
        Why the job failed; empty where it did not.
    artifact : bytes or None
        Its images, where it is a ground truth.
    """

    job: Job
    cost: Cost
    peak_mib: float
    reason: str
    artifact: bytes | None = None


def run_pilot(protocol: Protocol, objects: int, workers: int) -> list[Sample]:
    """Measure all methods and conditions on some objects of the protocol, at most all of them.

    There are as many workers as in the run, since neighbours on a machine slow each other down.
    Raises BadInput for fewer than one object and where none of them can be drawn, and
    MissingDependency where a method cannot be run on this machine at all.
    """
    if objects < 1:
        raise BadInput(f"--pilot {objects}: must be at least 1")
    chosen = spread(object_sizes(protocol, workers), objects)
    if not chosen:
        raise BadInput(
            f"{protocol.dataset}: none of the objects looked at has a cloud; 'bench data inspect' "
            "says why"
        )
    log(
        f"pilot: {len(chosen)} of {len(protocol.objects)} objects x "
        f"{len(protocol.conditions)} conditions x {len(protocol.methods)} methods"
    )
    some = tuple(obj for obj in protocol.objects if name_of(obj) in chosen)
    limits = protocol.suite.limits
    planned = [*plan(replace(protocol, objects=some))]
    truths = _measure([obj.truth for obj in planned], workers, limits, "pilot's ground truth")
    drawn = {truth.job.key: truth.artifact for truth in truths if truth.artifact}
    if not drawn:
        first = truths[0].reason
        raise BadInput(f"none of the pilot's objects can be drawn; the first: {first}")
    scored = [
        replace(job, reference=drawn[obj.truth.key])
        for obj in planned
        if obj.truth.key in drawn
        for job in obj.jobs[1:]
    ]
    return [*truths, *_measure(scored, workers, limits, "pilot")]


def _measure(jobs: Sequence[Job], workers: int, limits: Limits, title: str) -> list[Sample]:
    samples: list[Sample] = []
    twice = replace(limits, time_s=2 * limits.time_s)  # the first job of a method is done twice
    with (
        progress(title, len(jobs)) as advance,
        closing(run_tasks(jobs, MeasuringWorker(), min(workers, len(jobs)), twice)) as stream,
    ):
        for job, outcome in stream:
            lost = isinstance(outcome, WorkerFailure)
            samples.append(lost_sample(job, outcome, limits) if lost else outcome)
            advance(sum(bool(sample.reason) for sample in samples))
    return samples


@dataclass
class MeasuringWorker:
    """The work of one worker process, which remembers the methods that it has loaded.

    The first job of a method in a process loads libraries and weights, which a run does once in
    hundreds of jobs. It is therefore done twice, and the second time counts.
    """

    loaded: set[str] = field(default_factory=set)

    def __call__(self, job: Job) -> Sample:
        """Carry out a job. Raises MissingDependency where no job of the method can be done."""
        if job.method not in self.loaded:
            run_job(job)
            self.loaded.add(job.method)
        start = time.perf_counter()
        result = run_job(job)
        seconds = time.perf_counter() - start
        if result.unusable:
            raise MissingDependency(result.unusable)
        unit = 1 if sys.platform == "darwin" else 2**10  # bytes there, else KiB
        peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20
        size_b = len(pack_records(result.records)) + len(result.artifact or b"")
        artifact = result.artifact if job.method == GROUND_TRUTH else None
        cost, reason = Cost(seconds, float(size_b)), result.records[0].reason
        return Sample(replace(job, reference=None), cost, peak_mib, reason, artifact)


def lost_sample(job: Job, failure: WorkerFailure, limits: Limits) -> Sample:
    """Return the sample of a job whose worker was stopped at its limits, or died."""
    cost = Cost(limits.time_s, 0.0) if failure.kind == "timeout" else Cost(math.nan, math.nan)
    peak_mib = limits.memory_gib * 2**10 if failure.kind == "memory" else 0.0
    return Sample(job, cost, peak_mib, failure.reason)


def object_size(points: Floats32) -> int:
    """Return how many cubes of a grid have a point of [N, 3].

    The grid has `GRID` cubes along the longest side of the points' box.
    """
    if not len(points):
        return 0
    low = points.min(axis=0)
    longest = float((points.max(axis=0) - low).max()) or 1.0  # of points in one place
    cubes = np.minimum((points - low) * (GRID / longest), GRID - 1).astype(np.int64)
    return len(np.unique(cubes, axis=0))


def object_sizes(protocol: Protocol, workers: int, most: int = CANDIDATES) -> dict[str, int]:
    """Return the sizes of the protocol's objects by name, of a random `most` at most.

    The choice is the same every time. Objects without a readable cloud are left out, with a
    message.
    """
    count = len(protocol.objects)
    rng = generator(0, "pilot", str(count))
    chosen = sorted(rng.choice(count, min(count, most), replace=False).tolist())
    tasks = [(protocol.objects[i], protocol.seed) for i in chosen]
    with closing(
        run_tasks(tasks, _size, min(workers, len(tasks)), protocol.suite.limits)
    ) as stream:
        sizes = {name_of(obj): size for (obj, _), size in stream if isinstance(size, int)}
    if unreadable := len(tasks) - len(sizes):
        log(f"pilot: {unreadable} of {len(tasks)} objects have no readable cloud; left out")
    return sizes


def _size(task: tuple[SceneObject, int]) -> int | None:
    obj, seed = task
    try:
        rng = generator(seed, "cloud", obj.class_name, obj.object_id)
        return object_size(obj.cloud(rng).points)
    except Exception:  # a run has this as the reason of a failed job
        return None


def spread(sizes: Mapping[str, int], count: int) -> set[str]:
    """Return the names of at most `count` objects, spread over classes and, within them, sizes.

    The paper's surfaces take one chair five times as long as another, in proportion to its size:
    a few objects of all sizes cost what all objects cost in the mean.
    """
    in_order = sorted(sizes, key=lambda name: (name.partition("/")[0], sizes[name], name))
    count = min(count, len(in_order))
    middles = ((2 * part + 1) * len(in_order) // (2 * count) for part in range(count))
    return {in_order[i] for i in middles}


def mean_costs(
    costs: Iterable[tuple[MethodCondition, Cost]], cells: Iterable[MethodCondition]
) -> dict[MethodCondition, Cost]:
    """Return the mean cost of a job for each of the cells whose method has a finite cost.

    A method without a cost at a condition has its mean over the other conditions there.
    """
    finite: dict[MethodCondition, list[Cost]] = defaultdict(list)
    for (method, condition), cost in costs:
        if math.isfinite(cost.seconds):
            for cell in {(method, condition), (method, "")}:
                finite[cell].append(cost)
    return {
        (method, condition): Cost(*np.mean(finite.get((method, condition), of_method), axis=0))
        for method, condition in cells
        if (of_method := finite.get((method, "")))
    }
