"""From a pilot's measurements to what a run costs. Pure: nothing is measured here.

What an object costs goes by its size (how much of its box it fills): the surfaces of the paper take
one chair five times as long as another. A handful of objects says little about the mean of all;
but sizes are cheap to know of many, so costs are taken to the mean size along a line ("regression
estimator", Cochran, Sampling Techniques, 1977, chapter 7).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.records.record import GROUND_TRUTH
from bench.running.isolation import TASKS_PER_WORKER

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
