"""A few of a run's items done and measured on this machine, and from them what the run costs.

In a temporary folder, in worker processes like those of a run and as many, its ground truths first
and then object by object: what a method costs depends on its neighbours on the machine, and memory
on what else the process has loaded. Every item is measured in a process that has done its method
before; the first time in a process takes longer (libraries, weights, a first picture) and counts as
loading, which a run pays once a process.

What an object costs goes by its size (how much of its box it fills): the surfaces of the paper take
one chair five times as long as another. A handful of objects says little about the mean of all;
but sizes are cheap to know of many, so costs are taken to the mean size along a line ("regression
estimator", Cochran, Sampling Techniques, 1977, chapter 7).
"""

from __future__ import annotations

import functools
import math
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
from bench.catalogue.suites import Limits
from bench.records.job import Job, Result
from bench.records.journal import Journal, open_journal
from bench.records.record import GROUND_TRUTH
from bench.running.isolation import TASKS_PER_WORKER, Lost, run_tasks
from bench.running.protocol import Protocol, plan
from bench.running.work import do
from data_prep.failures import BadInput, MissingDependency
from data_prep.progress import progress, say
from data_prep.randomness import generator
from data_prep.scene_objects import SceneObject

Cell = tuple[str, str]  # method and condition; of ground truths GROUND_TRUTH and nothing
FEWEST_FOR_A_LINE = 4  # with three points, a line leaves one degree of freedom


@dataclass(frozen=True)
class Sample:
    """One item of the pilot, in a process that had done the method before.

    size       of its object, see `spread`
    seconds    of a worker for the whole job: method, metrics, features, harness
    method_s   of these the method's
    size_b     bytes of its artifact and its line in the journal
    peak_mib   most resident memory of its worker meanwhile, all libraries and weights included
    ssim       mean over its views; None of ground truths and failures
    reason     why it failed; empty where it did not
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


@dataclass(frozen=True)
class Pilot:
    """What was measured.

    samples   of each method and condition as many as there are objects, fewer where workers died
    loading   by method, seconds that its first item in a process took more than the same item later
    start_s   from the birth of a worker to its first job
    sizes     of the objects that those of the pilot were chosen among
    """

    samples: tuple[Sample, ...]
    loading: Mapping[str, float]
    start_s: float
    sizes: tuple[float, ...]


@dataclass(frozen=True)
class Amount:
    """An estimate with its 95 % interval; nan where a pilot is too small for one."""

    value: float
    low: float
    high: float

    def plus(self, exact: float) -> Amount:
        """With something added that has no spread."""
        return Amount(self.value + exact, self.low + exact, self.high + exact)


@dataclass(frozen=True)
class Cost:
    """What a run costs, or the part of it that is one method's.

    items     to be done
    core_s    seconds of workers, loading included; nan where nothing was measured
    method_s  of these the method's, without loading
    size_b    bytes on disk of artifacts and journal
    peak_mib  of a worker; nan where there is nothing to do
    failed    of the pilot's items
    """

    items: int
    core_s: Amount
    method_s: float
    size_b: float
    peak_mib: float
    failed: int


@dataclass(frozen=True)
class Estimate:
    """Of a run: by method, the ground truth among them; their sum; wall time with its workers."""

    methods: Mapping[str, Cost]
    total: Cost
    wall_s: Amount


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


def estimate(pilot: Pilot, left: Mapping[Cell, int], workers: int) -> Estimate:
    """What it costs to do `left` items of each method and condition with so many workers.

    Ground truths come before all else, in worker processes of their own. A method or condition that
    the pilot has not measured, because all its workers died, has the mean of what it has of the
    method, or nan.
    """
    truths = {cell: n for cell, n in left.items() if cell[0] == GROUND_TRUTH}
    items = {cell: n for cell, n in left.items() if cell[0] != GROUND_TRUTH}
    births = [_processes(sum(part.values()), workers) for part in (truths, items)]
    methods = dict.fromkeys(method for method, _ in left)
    of_each = {
        method: _cost(
            pilot,
            {cell: n for cell, n in left.items() if cell[0] == method},
            births[method != GROUND_TRUTH],
        )
        for method in methods
    }
    starts = pilot.start_s * sum(births)
    per_object, sizes = _per_object(pilot.samples, left)
    loading = sum(
        pilot.loading.get(m, 0.0) * births[m != GROUND_TRUTH] for m in methods if of_each[m].items
    )
    core_s = mean_at(per_object, sizes, pilot.sizes).plus(loading + starts)
    peaks = [cost.peak_mib for cost in of_each.values() if cost.items]
    total = Cost(
        items=sum(items.values()),
        core_s=core_s,
        method_s=sum(cost.method_s for cost in of_each.values()),
        size_b=sum(cost.size_b for cost in of_each.values()),
        peak_mib=max(peaks, default=math.nan),
        failed=sum(cost.failed for cost in of_each.values()),
    )
    busy = max(1, min(workers, sum(left.values())))
    wall_s = Amount(core_s.value / busy, core_s.low / busy, core_s.high / busy)
    return Estimate(of_each, total, wall_s)


def half_width(pilot: Pilot, cell: Cell, objects: int) -> float:
    """Half the 95 % interval of the mean SSIM over so many objects, by the pilot's spread.

    nan with fewer than two objects that have one.
    """
    found = [s.ssim for s in _of(pilot.samples, cell) if s.ssim is not None]
    if len(found) < 2:
        return math.nan
    return 1.96 * float(np.std(found, ddof=1)) / math.sqrt(objects)


def widest(pilot: Pilot, cells: Iterable[Cell]) -> Cell | None:
    """Whose mean SSIM has the widest interval; None where none has any."""
    widths = {cell: half_width(pilot, cell, 1) for cell in cells}
    known = {cell: width for cell, width in widths.items() if math.isfinite(width)}
    return max(known, key=lambda cell: known[cell]) if known else None


def spread(sizes: Mapping[tuple[str, str], float], count: int) -> list[tuple[str, str]]:
    """At most `count` of the objects (class, name), spread over classes and, within them, sizes.

    Sorted and cut into `count` parts of about one length; of each part the one in its middle. With
    at least as many as there are classes, equally large, every class has one.
    """
    # Up and down in turns: parts that reach over the border of two classes stay of about one size.
    classes = list(dict.fromkeys(class_name for class_name, _ in sizes))
    in_order = [
        name
        for number, of_class in enumerate(classes)
        for name in sorted(
            (name for name in sizes if name[0] == of_class),
            key=lambda name: sizes[name],
            reverse=number % 2 == 1,
        )
    ]
    count = min(count, len(in_order))
    return [in_order[(2 * part + 1) * len(in_order) // (2 * count)] for part in range(count)]


def _processes(items: int, workers: int) -> int:
    """Worker processes that are born in doing so many items, as `isolation` replaces them."""
    return max(min(workers, items), math.ceil(items / TASKS_PER_WORKER))


def _cost(pilot: Pilot, left: Mapping[Cell, int], births: int) -> Cost:
    items = sum(left.values())
    samples = [sample for cell in left for sample in _of(pilot.samples, cell)]
    per_object, sizes = _per_object(samples, left)
    loading = pilot.loading.get(next(iter(left))[0], 0.0) * births if items else 0.0
    return Cost(
        items=items,
        core_s=mean_at(per_object, sizes, pilot.sizes).plus(loading),
        method_s=_sum_of_means(samples, left, "method_s"),
        size_b=_sum_of_means(samples, left, "size_b"),
        peak_mib=max((s.peak_mib for s in samples), default=math.nan) if items else math.nan,
        failed=sum(bool(sample.reason) for sample in samples),
    )


def _of(samples: Iterable[Sample], cell: Cell) -> list[Sample]:
    return [sample for sample in samples if (sample.method, sample.condition) == cell]


def _per_object(
    samples: Sequence[Sample], left: Mapping[Cell, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Seconds of the whole of `left`, were all objects as this one [n], and sizes of these [n].

    A sample that is missing is the mean of its method and condition, else of its method.
    """
    sizes = {(s.class_name, s.object_id): s.size for s in samples}
    seconds = {
        (s.method, s.condition, s.class_name, s.object_id): s.seconds
        for s in samples
        if math.isfinite(s.seconds)
    }
    columns = []
    for (method, condition), items in left.items():
        if not items:
            continue
        column = np.array([seconds.get((method, condition, *name), np.nan) for name in sizes])
        if np.isnan(column).any():
            known = column[~np.isnan(column)]
            if not len(known):
                known = np.array([s for key, s in seconds.items() if key[0] == method])
            column[np.isnan(column)] = known.mean() if len(known) else np.nan
        columns.append(items * column)
    nothing = np.zeros(len(sizes))
    return sum(columns, nothing), np.array([*sizes.values()], dtype=np.float64)


def _sum_of_means(samples: Sequence[Sample], left: Mapping[Cell, int], field: str) -> float:
    total = 0.0
    for cell, items in left.items():
        found = [getattr(s, field) for s in _of(samples, cell) if not math.isnan(s.seconds)]
        total += items * float(np.mean(found)) if found else 0.0
    return total


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
    """Tasks that may grow while they are done (see `bench.running.isolation.feed`)."""

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
