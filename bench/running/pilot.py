"""A handful of a run's items done on this machine, as the run would do them, and measured.

In a temporary folder, in worker processes like those of a run and as many, its ground truths first
and then object by object: what a method costs depends on its neighbours on the machine, and memory
on what else the process has loaded. Every item is measured in a process that has done its method
before; the first time in a process takes longer (libraries, weights, a first picture) and counts as
loading, which a run pays once a process.
"""

from __future__ import annotations

import functools
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Generic, TypeVar

import numpy as np
import psutil
from numpy.typing import NDArray

from bench.catalogue.methods import FLOOR
from bench.records.journal import Journal, open_journal
from bench.running.estimate import Pilot, Sample, spread
from bench.running.isolation import Limits, Lost, run_tasks
from bench.running.progress import progress, say
from bench.running.protocol import Protocol, plan
from bench.running.work import Job, Result, do
from data_prep.failures import BadInput, MissingDependency
from data_prep.randomness import generator
from data_prep.scene_objects import SceneObject

Task = TypeVar("Task")
CANDIDATES = 200  # objects whose size is looked at; their clouds take some 20 ms each
CELLS = 15  # along the longest side; as good as 50, and less a matter of how many points there are
OPTIONAL = "fid"  # features that a run takes only where its weights are given

_done_here: set[str] = set()  # in a worker: methods that it has done


@dataclass(frozen=True)
class Measured:
    """A job done by a worker.

    first     whether its process had not done its method before
    start_s   from the birth of the process to this job, its first; else None
    seconds   for the whole job
    peak_mib  most resident memory of the process meanwhile
    """

    result: Result
    first: bool
    start_s: float | None
    seconds: float
    peak_mib: float


@dataclass(frozen=True)
class Measurements:
    """The pilot, and seconds of an item that its optional features take; None: it has none."""

    pilot: Pilot
    optional_s: float | None


def measure(protocol: Protocol, objects: int, workers: int) -> Measurements:
    """Do all methods and conditions of the protocol on so many of its objects (at most all).

    Raises BadInput where `objects` is less than one and where none of the objects can be drawn, and
    MissingDependency where a method cannot be run here at all.
    """
    if objects < 1:
        raise BadInput(f"--pilot {objects}: must be at least 1")
    sizes = sizes_of(protocol, workers)
    chosen = spread(sizes, objects)
    if not chosen:
        raise BadInput(f"{protocol.dataset}: none of the objects looked at has a cloud")
    named = {(obj.class_name, obj.object_id): obj for obj in protocol.objects}
    part = replace(protocol, objects=tuple(named[name] for name in chosen))
    say(
        f"pilot: {len(chosen)} of {len(protocol.objects)} objects x "
        f"{len(protocol.conditions)} conditions x {len(protocol.methods)} methods"
    )
    with tempfile.TemporaryDirectory(prefix="bench-plan-") as folder:
        todo = plan(part, Path(folder))
        with open_journal(Path(folder)) as journal:
            bench = _Bench(workers, protocol.suite.limits, journal, sizes)
            truths = bench.measure(todo.references, "pilot's ground truth")
            reasons = [s.reason for s in bench.samples if s.reason]
            drawn = {job.artifact for job in todo.references if job.key in truths}
            if not drawn:
                raise BadInput(f"none of the pilot's objects can be drawn; the first: {reasons[0]}")
            items = [job for job in todo.items if job.reference in drawn]
            cheaper = without_optional(items) if OPTIONAL in dict(protocol.features) else {}
            seconds = bench.measure(items, "pilot", [*cheaper.values()])
            lines = sum(path.stat().st_size for path in (Path(folder) / "journal").glob("*.jsonl"))
        line_b = lines / max(1, len(journal.added))
    pilot = Pilot(
        samples=tuple(replace(s, size_b=s.size_b + line_b) for s in bench.samples),
        loading={method: fmean(extra) for method, extra in bench.loading.items()},
        start_s=fmean(bench.starts) if bench.starts else 0.0,
        sizes=tuple(sizes.values()),
    )
    saved = [
        seconds[key] - seconds[job.key]
        for key, job in cheaper.items()
        if key in seconds and job.key in seconds
    ]
    return Measurements(pilot, max(0.0, fmean(saved)) if saved else None)


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
    out, and told.
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
        say(f"pilot: {lacking} of {len(tasks)} objects have no readable cloud; left out")
    names = [(obj.class_name, obj.object_id) for obj, _ in tasks]
    return {name: found[name] for name in names if name in found}


def _size(task: tuple[SceneObject, int]) -> int | None:
    """In a worker: the size of an object; None where it has no cloud, for whatever reason."""
    obj, seed = task
    try:
        return size_of(obj.cloud(generator(seed, "cloud", obj.class_name, obj.object_id)).points)
    except Exception:  # a run has this as the reason of a failed item
        return None


def without_optional(items: Iterable[Job]) -> dict[str, Job]:
    """By their keys, items of the floor as they are without the optional features.

    Of any method they cost the same, and the floor costs least beside them. A condition is enough.
    """
    found: dict[Path | None, tuple[str, Job]] = {}
    for job in items:
        if job.method == FLOOR and job.reference not in found:
            features = tuple(pair for pair in job.features if pair[0] != OPTIONAL)
            changed = replace(
                job,
                key=f"{job.key}-without",
                features=features,
                artifact=job.artifact.with_name(f"{job.key}-without.npz"),
            )
            found[job.reference] = (job.key, changed)
    return dict(found.values())


class _Again(Generic[Task]):
    """Tasks that may grow while they are done (see `bench.running.executor.feed`)."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self.waiting = deque(tasks)

    def __iter__(self) -> Iterator[Task]:
        return self

    def __next__(self) -> Task:
        if not self.waiting:
            raise StopIteration
        return self.waiting.popleft()


class _Bench:
    """Does jobs in worker processes and keeps what they took."""

    def __init__(
        self, workers: int, limits: Limits, journal: Journal, sizes: Mapping[tuple[str, str], float]
    ) -> None:
        self._workers, self._limits, self._journal, self._sizes = workers, limits, journal, sizes
        self.samples: list[Sample] = []
        self.loading: dict[str, list[float]] = {}
        self.starts: list[float] = []

    def measure(
        self, jobs: Sequence[Job], title: str, extra: Sequence[Job] = ()
    ) -> dict[str, float]:
        """Seconds of the jobs that gave pictures, by key; `extra` jobs leave no sample."""
        queue, seconds = _Again([*jobs, *extra]), {}
        cold: dict[str, list[float]] = {}
        failures, counted = 0, {job.key for job in jobs}
        workers = min(self._workers, len(queue.waiting))
        with (
            progress(title, len(queue.waiting)) as advance,
            closing(run_tasks(queue, measured, workers, self._limits)) as stream,
        ):
            for job, found in stream:
                if isinstance(found, Measured):
                    if found.result.unusable:
                        raise MissingDependency(found.result.unusable)
                    if found.start_s is not None:
                        self.starts.append(found.start_s)
                    if found.first:
                        cold.setdefault(job.key, []).append(found.seconds)
                        queue.waiting.append(job)
                        continue
                sample = sample_of(job, found, self._limits, self._sizes)
                failures += bool(sample.reason)
                advance(failures)
                if not sample.reason:
                    seconds[job.key] = sample.seconds
                if isinstance(found, Measured):
                    self.loading.setdefault(job.method, []).extend(
                        max(0.0, taken - found.seconds) for taken in cold.get(job.key, ())
                    )
                    if job.key in counted:
                        self._journal.append(found.result)
                if job.key in counted:
                    self.samples.append(sample)
        return seconds


def measured(job: Job) -> Measured:
    """In a worker: do a job, and measure what it takes."""
    born = None if _done_here else time.time() - psutil.Process().create_time()
    first = job.method not in _done_here
    _done_here.add(job.method)
    peak = _watch_peak()
    start = time.perf_counter()
    result = do(job)
    return Measured(result, first, born, time.perf_counter() - start, peak())


def _watch_peak() -> Callable[[], float]:
    """Gives a function: the most resident memory since now, in MiB.

    Where the kernel does not forget an older peak (not Linux, or not allowed), since the process
    began.
    """
    import resource
    import sys

    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        unit = 1 if sys.platform == "darwin" else 2**10  # bytes there, else KiB
        return lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20
    return _peak_on_linux


def _peak_on_linux() -> float:
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 2**10


def sample_of(
    job: Job,
    found: Measured | Lost,
    limits: Limits,
    sizes: Mapping[tuple[str, str], float],
) -> Sample:
    """What is kept of an item; one that was stopped at its time limit has cost just that.

    Of one whose worker died otherwise nobody knows what it has cost: nan.
    """
    name = (job.object.class_name, job.object.object_id)
    sample = functools.partial(Sample, job.method, job.condition, *name, sizes[name])
    if isinstance(found, Lost):
        taken = limits.time_s if found.kind == "timeout" else float("nan")
        peak = limits.memory_gib * 2**10 if found.kind == "memory" else 0.0
        return sample(taken, taken, 0.0, peak, None, found.reason)
    result = found.result
    scores = [record.ssim for record in result.records if record.ssim is not None]
    return sample(
        found.seconds,
        result.spent.methods,
        float(job.artifact.stat().st_size) if result.artifact_sha256 else 0.0,
        found.peak_mib,
        fmean(scores) if scores else None,
        result.records[0].reason,
    )
