"""Thousands of damaged and malicious files, each given to its reader as the product would.

    python -m tests.robustness.fuzz_files [--files 2000] [--seed 0] [--keep DIR]

Makes files of all formats in a temporary folder (see `tests.robustness.fuzzing`), reads meshes and
clouds in workers with limits and everything else in this process, and prints, per format: files
read, refused (BadInput), lost (time limit, memory limit, death of the worker) and defects (any
other exception), the longest time, the most memory, and what a reader did that no reader may do:
write, execute, connect, read outside the file's folder. Canaries and a listing of the folder before
and after show what hooks cannot see.

A row `FAIL` is a defect; exit status 1. `--keep` keeps the files behind them.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.catalogue.suites import Limits
from bench.running.isolation import WorkerFailure, run_tasks
from tests.robustness.fuzzing import (
    CANARY,
    FORMATS,
    TRICKS,
    Files,
    Format,
    Reading,
    Task,
    case_rng,
    listing,
    make_case,
    playground,
    read,
    write_case,
)

LIMITS = Limits(time_s=10.0, memory_gib=2.0)
NOT_KEPT = shutil.ignore_patterns("pipe", "link")


@dataclass(frozen=True)
class Result:
    """A file and what became of it."""

    task: Task
    number: int
    reading: Reading | WorkerFailure
    in_worker: bool

    @property
    def failures(self) -> list[str]:
        """Return what must not happen and did, in words."""
        if isinstance(self.reading, WorkerFailure):
            return []  # contained, and a column of its own in the table
        problems = [f"event: {event}" for event in self.reading.events]
        if self.reading.outcome == "defect":
            problems.insert(0, f"defect: {self.reading.detail}")
        # Nobody kills this process, so that what exceeds the limits here is a failure.
        if not self.in_worker:
            if self.reading.seconds > LIMITS.time_s:
                problems.append(f"took {self.reading.seconds:.1f} s in the main process")
            if self.reading.peak_mib > 1024 * LIMITS.memory_gib:
                problems.append(f"took {self.reading.peak_mib:.0f} MiB in the main process")
        return problems


def main(
    arguments: Sequence[str] | None = None,
    formats: Mapping[str, Format] = FORMATS,
    tricks: float = TRICKS,
) -> int:
    """Run from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description="Damaged files, and what readers make of them.")
    parser.add_argument("--files", type=int, default=2000, help="in all, shared among the formats")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--formats", nargs="+", choices=formats, default=list(formats))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files that failed")
    options = parser.parse_args(arguments)
    counts = shares(options.files, len(options.formats))
    failed = 0
    print(HEADER)
    for name, count in zip(options.formats, counts, strict=True):
        with playground() as root:
            files = {
                number: make_case(
                    name, case_rng(options.seed, name, number), str(root), formats, tricks
                )
                for number in range(count)
            }
            results, changes = fuzz(root, name, files, options.workers, formats)
            print(table_row(name, results, changes), flush=True)
            for result in results:
                for failure in result.failures:
                    print(f"FAIL {name} {result.number} (seed {options.seed}): {failure}")
                    failed += 1
                if isinstance(result.reading, WorkerFailure):
                    print(f"lost {name} {result.number}: {result.reading.reason}")
                if options.keep and (result.failures or isinstance(result.reading, WorkerFailure)):
                    kept = options.keep / f"{name}-{options.seed}-{result.number}"
                    shutil.copytree(result.task.path.parent, kept, ignore=NOT_KEPT)
            for change in changes:
                print(f"FAIL {name}: {change}")
            failed += len(changes)
    print(f"{sum(counts)} files, {failed} failures, 0 crashes of the main process")
    return 1 if failed else 0


def shares(total: int, parts: int) -> list[int]:
    """Return `total` in `parts` as equal as can be."""
    return [total // parts + (i < total % parts) for i in range(parts)]


def fuzz(
    root: Path,
    name: str,
    cases: Mapping[int, Files],
    workers: int,
    formats: Mapping[str, Format],
) -> tuple[list[Result], list[str]]:
    """Return the results of one format's cases, and all changes in `root`, where none may be."""
    tasks = {
        Task(name, write_case(root / "cases" / str(number), files)): number
        for number, files in cases.items()
    }
    before = listing(root)
    in_worker = formats[name].in_worker
    if in_worker:
        done = run_tasks(tasks, read, workers, LIMITS)
    else:
        done = ((task, read(task, formats)) for task in tasks)
    results = [Result(task, tasks[task], reading, in_worker) for task, reading in done]
    after = listing(root)
    changes = [f"{path} was made" for path in after.keys() - before.keys()]
    changes += [f"{path} is gone" for path in before.keys() - after.keys()]
    kept = before.keys() & after.keys()
    changes += [f"{path} was changed" for path in kept if before[path] != after[path]]
    return sorted(results, key=lambda result: result.number), changes


COLUMNS = ("format", "files", "read", "refused", "lost", "defects", "longest s", "most MiB")
COLUMNS += ("events", "canaries")
HEADER = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|"


def table_row(name: str, results: Sequence[Result], changes: Sequence[str]) -> str:
    """Return one line of the table."""
    readings = [r.reading for r in results if isinstance(r.reading, Reading)]
    outcomes = [reading.outcome for reading in readings]
    cells = [
        name,
        len(results),
        outcomes.count("read"),
        outcomes.count("refused"),
        len(results) - len(readings),
        outcomes.count("defect"),
        f"{max((r.seconds for r in readings), default=0):.2f}",
        f"{max((r.peak_mib for r in readings), default=0):.0f}",
        sum(len(r.events) for r in readings),
        sum(CANARY in change for change in changes),
    ]
    return "| " + " | ".join(map(str, cells)) + " |"


if __name__ == "__main__":
    sys.exit(main())
