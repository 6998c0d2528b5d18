"""A run of 200 items of which 14 hang, crash, hog memory, raise or draw no pictures.

    python -m tests.robustness.faults

Three times the same run of surface reconstruction, of 40 chairs under 5 conditions: in the second,
two items misbehave for each fault, chosen by the checksum of their clouds; in the first and the
last all are healthy, so that a machine that gets slower or faster on the way does not count. The
method is one, announced as another package announces its own. The run has to end, exactly the
faulty items have to be failed, and each for the reason that its fault deserves: else the exit
status is 1. Prints what was found, and how many healthy items were done in a second, with faults
and without (the floor, which every run measures, is drawn for all items each time). A hang costs a
worker the time limit, and a worker that died or was killed is replaced, which takes some seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import bench.running.run
from baselines.reconstruction.surface import SurfaceApss
from bench.catalogue.methods import Method
from bench.catalogue.suites import SUITES, Limits, Suite
from bench.commands.publish import run_suite
from bench.records.job import Job
from bench.records.parquet import read_records
from bench.running.isolation import TASKS_PER_WORKER
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import Protocol, find_methods
from bench.running.work import cloud_of
from data_prep.datasets.registry import open_dataset
from data_prep.randomness import generator
from data_prep.scene import Points, Renderer
from tests.robustness.faulty_methods import FAULTS, Faulty, announce

ID = "faulty-apss"
PLAN = "PC2PIX_BENCH_FAULTS"  # the file with faults by checksum of the points
PROCESSES = "PC2PIX_BENCH_FAULTS_PROCESSES"  # where each process says that it uses the method
VIEWS = 2
ITEMS_PER_FAULT = 2
REASONS: Mapping[str, str] = {
    "hang": r"timeout: no result within \d+ s",
    "segfault": r"crash: the worker died \(SIGSEGV\)",
    "memory-hog": r"memory: the worker used more than [\d.]+ GiB",
    "exception": r"ValueError: 12 of 34 parts are missing",
    "wrong-shape": r"draw: pictures of shape .*",
    "nan": r"draw: \d+ pixel values are not finite",
    "blank": r"draw: 2 of 2 pictures are blank",
}


def _load(device: str) -> Renderer:
    """In a worker, once a process."""
    del device
    with Path(os.environ[PROCESSES]).open("a") as file:
        file.write(f"{os.getpid()}\n")
    faults: dict[str, str] = json.loads(Path(os.environ[PLAN]).read_text())
    return Faulty(SurfaceApss(), lambda points: faults.get(_checksum(points)))


METHOD = Method(ID, _load, lambda: "", 1, "surface-apss, which misbehaves on the items of a plan")


@dataclass(frozen=True)
class Found:
    """What came of a run: the reasons of failed items by their names, and what it took.

    `processes` are those that drew at least one item.
    """

    failed: Mapping[str, str]
    items: int
    processes: int
    seconds: float

    @property
    def rate(self) -> float:
        """Healthy items in a second."""
        return (self.items - len(self.failed)) / self.seconds

    @property
    def lost(self) -> int:
        """Workers that died or had to be killed."""
        return sum(
            reason.startswith(("timeout: ", "memory: the worker", "crash: "))
            for reason in self.failed.values()
        )


def main() -> None:
    """Run all three from the command line."""
    parser = argparse.ArgumentParser(description="A run some of whose items hang and crash.")
    parser.add_argument("--objects", type=int, default=40)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--time-limit-s", type=float, default=15.0)
    parser.add_argument("--memory-limit-gib", type=float, default=2.0)
    options = parser.parse_args()
    limits = Limits(options.time_limit_s, options.memory_limit_gib)
    suite = replace(SUITES[0], methods=(ID,), limits=limits)
    bench.running.run.SUITES = (suite,)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        announce(root, {ID: "tests.robustness.faults:METHOD"})
        sys.path.insert(0, folder)  # spawned workers get it too
        jobs = planned(suite, options.objects)
        faulty = choose(jobs)
        before = run(root / "before", options, {})
        found = run(root / "faulty", options, faulty)
        after = run(root / "after", options, {})
    print(table(jobs, faulty, found))
    print(summary(found, (before, after), limits, options.workers))
    if before.failed or after.failed or problems(jobs, faulty, found):
        raise SystemExit(1)


def planned(suite: Suite, objects: int) -> list[Job]:
    """The items of the method under test."""
    dataset = open_dataset("procedural")
    protocol = Protocol(
        suite=suite,
        dataset=dataset.id,
        methods=find_methods(suite.methods),
        conditions=suite.conditions,
        objects=dataset.objects("chair", objects, objects),
        views=VIEWS,
        seed=0,
        device="cpu",
        features=(),
        feature_identity={},
        environment={},
    )
    return list(plan(protocol, Path()).method_jobs)


def choose(jobs: list[Job]) -> dict[str, str]:
    """Two items for each fault, drawn at random: name to fault."""
    order = generator("faults").permutation(len(jobs))[: ITEMS_PER_FAULT * len(FAULTS)]
    return {_name(jobs[i]): FAULTS[k % len(FAULTS)] for k, i in enumerate(order)}


def run(out: Path, options: argparse.Namespace, faulty: Mapping[str, str]) -> Found:
    """A run in which these items misbehave."""
    jobs = planned(bench.running.run.SUITES[0], options.objects)
    faults = {
        _checksum(cloud_of(job).points): faulty[_name(job)] for job in jobs if _name(job) in faulty
    }
    files = {PLAN: out.with_suffix(".json"), PROCESSES: out.with_suffix(".processes")}
    files[PLAN].write_text(json.dumps(faults))
    os.environ.update({name: str(path) for name, path in files.items()})
    finished = run_suite(
        Options(
            suite=SUITES[0].id,
            limit=options.objects,
            views=VIEWS,
            workers=options.workers,
            device="cpu",
            out=out,
        )
    )
    frame = read_records(finished.directory)
    frame = frame[frame["method"] == ID].drop_duplicates(["condition", "object"])
    names = frame["condition"] + " " + frame["object"]
    failed = (frame["outcome"] != "ok").to_numpy()
    return Found(
        failed=dict(zip(names[failed], frame["reason"][failed], strict=True)),
        items=len(frame),
        processes=len(files[PROCESSES].read_text().split()),
        seconds=finished.seconds["items"],
    )


def problems(jobs: list[Job], faulty: Mapping[str, str], found: Found) -> list[str]:
    """Items that failed and should not have, or the other way round, or for another reason."""
    return [
        f"{name}: {faulty.get(name, 'healthy')}, but {found.failed.get(name, 'not failed')!r}"
        for name in map(_name, jobs)
        if (name in faulty or name in found.failed)
        and not (
            name in faulty
            and name in found.failed
            and re.fullmatch(REASONS[faulty[name]], found.failed[name])
        )
    ]


def table(jobs: list[Job], faulty: Mapping[str, str], found: Found) -> str:
    """By fault, the reasons in the records; then what is wrong."""
    rows = [
        f"| {fault} | {count} | {reason} |"
        for fault in FAULTS
        for reason, count in Counter(
            found.failed.get(name, "not failed") for name, f in faulty.items() if f == fault
        ).items()
    ]
    wrong = problems(jobs, faulty, found)
    return "\n".join(
        [
            "| fault | items | reason in the records |\n|---|---|---|",
            *rows,
            f"\n{len(found.failed)} of {found.items} items failed; "
            f"{len(wrong)} of all are not as they should be",
            *wrong,
        ]
    )


def summary(found: Found, healthy: Sequence[Found], limits: Limits, workers: int) -> str:
    """Rates and processes."""
    rate = sum(one.rate for one in healthy) / len(healthy)
    without = (f"without faults: {_speed(one)}" for one in healthy)
    lines = (
        f"{workers} workers (fresh ones after {TASKS_PER_WORKER} tasks), limits "
        f"{limits.time_s:g} s and {limits.memory_gib:g} GiB an item",
        f"with faults: {_speed(found)}; {found.lost} workers had to be replaced",
        *without,
        f"throughput with faults / mean without: {found.rate / rate:.3f}",
    )
    return "\n".join(lines)


def _speed(found: Found) -> str:
    return (
        f"{found.items - len(found.failed)} healthy items in {found.seconds:.0f} s, "
        f"{found.rate:.3f} a second, {found.processes} processes"
    )


def _name(job: Job) -> str:
    return f"{job.condition} {job.object.object_id}"


def _checksum(points: Points) -> str:
    return sha256(points.tobytes()).hexdigest()


if __name__ == "__main__":
    main()
