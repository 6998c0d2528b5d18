"""The paper's full protocol with sleepers for methods: what the harness itself costs at that size.

    python -m benchmarks.full_protocol --costs DIR|FILE [--objects 1357] [--methods a,b]
                                       [--workers 16] [--scale 10] [--pilot 6] [--out DIR]

1,357 objects x the conditions and methods of chair-robustness x 20 views go through the path that
a run takes: jobs from `bench.running.protocol`, `do_jobs`, a journal with a forced write a job,
worker processes that are fed, limited and replaced. Only the work is not done: a worker sleeps, and
returns 20 records. How long is drawn from what was measured, object by object, so that an object
that is dear to one method is dear to all as it was. `--costs` is what `bench plan --samples FILE`
has kept (whole jobs), or the folder of a finished run, whose records have the time of methods
alone.

Sleepers need no core, so there may be more workers than cores, and the clock may be scaled: an item
sleeps for its cost / scale. The harness is not scaled: what it adds to an item (workers that wait
for their next task, for a new process) stays what it is in milliseconds, or grows, as results come
faster than one process can write them down. So

* overhead at true cost = (workers x wall time - all sleep - tail) / (all sleep x scale) is an upper
  bound;
* a run with `--scale 1` on fewer `--objects` measures it directly: there both are the same.

The tail, workers without a task while the last ones are done, is told apart: it is a matter of the
longest items, not of the harness, and scales with them. Ground truths, tables and figures are no
part of this. At the end, the estimate of `bench plan` from a pilot of N of these objects is
compared with the outcome, and so are those of 500 other pilots.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES, Limits
from bench.records.job import Job, Result, failed
from bench.records.journal import open_journal, read_manifest
from bench.running.executors import do_jobs
from bench.running.isolation import Lost, TaskPool
from bench.running.pilot import CANDIDATES, Amount, Pilot, Sample, estimate, size_of, spread
from bench.running.protocol import Protocol, plan
from data_prep.datasets import open_dataset
from data_prep.failures import BadInput
from data_prep.randomness import generator

SUITE = "chair-robustness"
PILOTS = 500
WITHIN = 0.15


@dataclass(frozen=True)
class Costs:
    """Seconds [objects, methods, conditions] of a job each, and the sizes [objects]."""

    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    seconds: NDArray[np.float64]
    sizes: NDArray[np.float64]

    def of(self, objects: NDArray[np.intp]) -> Costs:
        """Those of the objects with these numbers, each as often as it is named."""
        return replace(self, seconds=self.seconds[objects], sizes=self.sizes[objects])


@dataclass(frozen=True)
class Overhead:
    """Seconds of all workers together, beside sleep [s]; all on the scaled clock.

    starting  until each has its first task
    between   tasks: waiting for the next one, for a new process, waking up late
    tail      without a task while the last ones are done, and until the pool is closed
    """

    sleep: float
    starting: float
    between: float
    tail: float


@dataclass(frozen=True)
class Nap:
    """A result, and from when to when its worker was at it (`time.monotonic`)."""

    result: Result
    begin: float
    end: float


def read_costs(source: Path, methods: Sequence[str] | None = None) -> Costs:
    """From a pilot's samples or a run's records; objects that lack an item are left out.

    Raises BadInput where that leaves nothing.
    """
    table = _of_run(source) if source.is_dir() else _of_pilot(source)
    if methods:
        table = table[table.method.isin(methods)]
    names = [list(dict.fromkeys(table[column])) for column in ("object_id", "method", "condition")]
    cells = table.pivot_table(index="object_id", columns=["method", "condition"], values="seconds")
    cells = cells.reindex(columns=pd.MultiIndex.from_product(names[1:])).reindex(names[0]).dropna()
    if cells.empty:
        raise BadInput(f"{source}: no object has a time for every method and condition")
    sizes = table.drop_duplicates("object_id").set_index("object_id")["size"]
    seconds = cells.to_numpy().reshape(len(cells), len(names[1]), len(names[2]))
    return Costs(tuple(names[1]), tuple(names[2]), seconds, sizes[cells.index].to_numpy(float))


def _of_pilot(path: Path) -> pd.DataFrame:
    table = pd.read_csv(path, dtype={"condition": str})
    return table[table.condition.notna()]  # not the ground truths


def _of_run(directory: Path) -> pd.DataFrame:
    manifest = read_manifest(directory)
    records = pd.read_parquet(directory / "records.parquet")
    records["seconds"] = records.prepare_s + manifest["views"] * records.draw_s
    table = records[records["view"] == 0].rename(columns={"object": "object_id"})
    dataset, sizes = open_dataset(manifest["dataset"]), {}
    for class_name in dict.fromkeys(table["class"]):
        count = len(manifest["objects"])
        for obj in dataset.objects(class_name, count, count):
            rng = generator(manifest["seed"], "cloud", class_name, obj.object_id)
            sizes[obj.object_id] = float(size_of(obj.cloud(rng).points))
    return table.assign(size=table.object_id.map(sizes))


def jobs_of(costs: Costs, objects: int, directory: Path) -> tuple[Job, ...]:
    """The items of the protocol, in the order of a run: object, condition, method."""
    suite = find(SUITE, SUITES, "suite")
    protocol = Protocol(
        suite=suite,
        dataset="procedural",
        methods=costs.methods,
        conditions=costs.conditions,
        objects=open_dataset("procedural").objects(suite.classes[0], objects, objects),
        views=suite.views,
        seed=0,
        device="cpu",
        features=(),
        feature_identity={},
        environment={},
    )
    return plan(protocol, directory).items


def nap(task: tuple[Job, float]) -> Nap:
    """In a worker: 20 records, and sleep for the rest of the time."""
    job, seconds = task
    begin = time.monotonic()
    records = tuple(
        replace(record, outcome="ok", reason="", ssim=0.5, prepare_s=seconds, draw_s=0.0)
        for record in failed(job, "").records
    )
    time.sleep(max(0.0, begin + seconds - time.monotonic()))
    return Nap(Result(job.key, records, "0" * 64), begin, time.monotonic())


class Sleepers:
    """An executor like `JobPool`, whose workers sleep for `seconds` (by key)."""

    def __init__(self, seconds: Mapping[str, float], workers: int, limits: Limits) -> None:
        self._seconds = seconds
        self._pool: TaskPool[tuple[Job, float], Nap] = TaskPool(nap, workers, limits)
        self.room = self._pool.room
        self.spans: list[tuple[float, float]] = []

    def submit(self, job: Job) -> None:
        """Have it slept over."""
        self._pool.submit((job, self._seconds[job.key]))

    def collect(self) -> Iterator[Result]:
        """The results of those that have ended."""
        for (job, _), found in self._pool.collect():
            if isinstance(found, Lost):
                yield failed(job, found.reason)
            else:
                self.spans.append((found.begin, found.end))
                yield found.result

    def close(self) -> None:
        """Stop."""
        self._pool.close()


def overhead_of(
    spans: NDArray[np.float64], sleep: float, workers: int, begin: float, end: float
) -> Overhead:
    """What became of the time of all workers from `begin` to `end`; `spans` [n, 2] of tasks.

    Workers that never had a task count as starting and, after the last task has begun, as tail.
    """
    begins = np.sort(spans[:, 0])
    last = float(begins[-1])
    firsts = begins[:workers]
    starting = float((firsts - begin).sum()) + (workers - len(firsts)) * (last - begin)
    busy_at_end = np.clip(spans[:, 1] - np.maximum(spans[:, 0], last), 0.0, None).sum()
    tail = workers * (end - last) - float(busy_at_end)
    return Overhead(sleep, starting, workers * (end - begin) - sleep - starting - tail, tail)


def planned(costs: Costs, names: Sequence[int], count: int, workers: int, seed: int) -> Amount:
    """What `bench plan` would say of items with `costs`, with a pilot of `count` of the objects."""
    rng = np.random.default_rng(seed)
    some = rng.choice(len(names), min(len(names), CANDIDATES), replace=False)
    sizes = {("chair", str(i)): float(costs.sizes[i]) for i in sorted(some.tolist())}
    samples = tuple(
        Sample(
            m, c, *name, sizes[name], float(costs.seconds[int(name[1]), i, j]), 0, 0, 0, None, ""
        )
        for name in spread(sizes, count)
        for i, m in enumerate(costs.methods)
        for j, c in enumerate(costs.conditions)
    )
    left = {(m, c): len(names) for m in costs.methods for c in costs.conditions}
    return estimate(Pilot(samples, {}, 0.0, tuple(sizes.values())), left, workers).total.core_s


def main() -> None:
    """Run it, and print what came out."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--costs", type=Path, required=True, help="FILE of bench plan, or a run")
    options.add_argument("--objects", type=int, default=1357)
    options.add_argument("--methods", help="comma-separated; default: those that have costs")
    options.add_argument("--workers", type=int, default=16)
    options.add_argument("--scale", type=float, default=10.0)
    options.add_argument("--pilot", type=int, default=6)
    options.add_argument(
        "--out", type=Path, help="where the journal goes; default: nowhere for long"
    )
    given = options.parse_args()
    measured = read_costs(given.costs, given.methods and given.methods.split(","))
    rng = np.random.default_rng(0)
    costs = measured.of(rng.integers(len(measured.sizes), size=given.objects))
    with tempfile.TemporaryDirectory() as scratch:
        simulate(costs, given.workers, given.scale, given.pilot, given.out or Path(scratch) / "run")


def simulate(costs: Costs, workers: int, scale: float, pilot: int, directory: Path) -> None:
    """Sleep through the protocol, and print overhead, memory and how good the plan was."""
    objects = len(costs.sizes)
    begin = time.monotonic()
    jobs = jobs_of(costs, objects, directory)
    print(f"{len(jobs):,} items planned in {time.monotonic() - begin:.1f} s", flush=True)
    in_order = costs.seconds.transpose(0, 2, 1).ravel() / scale
    seconds = {job.key: float(s) for job, s in zip(jobs, in_order, strict=True)}
    sleepers: list[Sleepers] = []

    def start(_: int) -> Sleepers:
        limits = find(SUITE, SUITES, "suite").limits
        sleepers.append(Sleepers(seconds, workers, limits))
        return sleepers[0]

    with open_journal(directory) as journal:
        cpu, begin = time.process_time(), time.monotonic()
        settled = do_jobs(jobs, journal, "sleepers", start)
        end = time.monotonic()
        cpu = time.process_time() - cpu
    lost = sum(one.artifact_sha256 is None for one in settled.values())
    spans = np.array(sleepers[0].spans)
    found = overhead_of(spans, float(in_order.sum()), workers, begin, end)
    report(found, len(jobs), workers, scale, end - begin)
    append_ms, force_ms = journal_ms(jobs[0], directory / "apart")
    journal_mb = sum(f.stat().st_size for f in (directory / "journal").glob("*.jsonl")) / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    print(
        f"{lost} lost; the run's own process: {1000 * cpu / len(jobs):.2f} ms of a core an item\n"
        f"a line of the journal: {append_ms:.2f} ms, forced to disk in {force_ms:.2f} ms of them; "
        f"{journal_mb:,.0f} MB of it; the run's own process took {peak:.0f} MiB at most"
    )
    outcome = (found.sleep + found.tail) * scale + found.starting + found.between
    compare(costs, pilot, workers, outcome)


def report(found: Overhead, items: int, workers: int, scale: float, wall: float) -> None:
    """Print where the time of the workers went."""
    own, true = found.starting + found.between, found.sleep * scale
    print(
        f"{workers} workers, clock x {scale:g}: {wall:.1f} s; sleep {found.sleep:.0f} s of a "
        f"worker, true cost {true / 3600:.2f} h\n"
        f"on this clock: overhead {own / found.sleep:.2%} (starting {found.starting:.1f} s, "
        f"between items {found.between:.1f} s), tail {found.tail / found.sleep:.2%}\n"
        f"an item: {1000 * found.between / items:.2f} ms beside {1000 * true / items:.0f} ms of "
        f"true cost; overhead at true cost: at most {own / true:.2%}"
    )


def journal_ms(job: Job, directory: Path) -> tuple[float, float]:
    """Milliseconds that a journal takes for a line, and of these its forced write (medians)."""
    result, times, forced = nap((job, 0.0)).result, [], []
    with open_journal(directory) as journal:
        for _ in range(200):
            begin = time.perf_counter()
            journal.append(result)
            times.append(time.perf_counter() - begin)
    (path,) = (directory / "journal").glob("*.jsonl")
    line = path.read_bytes().partition(b"\n")[0]
    with (directory / "line").open("wb") as file:
        for _ in range(200):
            file.write(line)
            file.flush()
            begin = time.perf_counter()
            os.fsync(file.fileno())
            forced.append(time.perf_counter() - begin)
    return 1000 * float(np.median(times)), 1000 * float(np.median(forced))


def compare(costs: Costs, count: int, workers: int, outcome: float) -> None:
    """Print what `bench plan` would have said, with one pilot and with many, beside the outcome."""
    names = range(len(costs.sizes))
    said = planned(costs, names, count, workers, 0)
    print(
        f"planned with a pilot of {count}: {said.value / 3600:.2f} h [{said.low / 3600:.2f}, "
        f"{said.high / 3600:.2f}] of a core; outcome {outcome / 3600:.2f} h: "
        f"{said.value / outcome - 1:+.1%}"
    )
    others = [planned(costs, names, count, workers, seed) for seed in range(1, PILOTS + 1)]
    errors = np.array([other.value / outcome - 1 for other in others])
    within = float((np.abs(errors) <= WITHIN).mean())
    held = float(np.mean([o.low <= outcome <= o.high for o in others if math.isfinite(o.low)]))
    print(
        f"{PILOTS} other pilots of {count}: {within:.0%} within {WITHIN:.0%} of the outcome, error "
        f"{errors.mean():+.1%} +- {errors.std():.1%}; it lies in {held:.0%} of their intervals"
    )


if __name__ == "__main__":
    main()
