"""Speed-up by more workers, and the overhead of distributing the work.

    python -m studies.scaling [--workers 1,2] [--ray] [--limit 8] [--rounds 1]

The items of `chair-robustness` (ground truths are made before and are not timed), by processes of
this machine and, with `--ray`, by a Ray cluster on it; every round takes all of them in turn, from
nothing. Printed for each: items a second, how many times those of the first row, and the overhead:
the part of the workers' time in which none of their jobs was done. That is starting processes,
handing out jobs, keeping results, and idling at the end while the last job is done.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.records.journal import open_journal
from bench.running.executors import JobPool, run_jobs
from bench.running.factory import executor_factory
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import protocol_of
from bench.running.ray import LOCAL
from studies.arguments import names, numbers
from studies.tables import markdown

SUITE = "chair-robustness"
Workers = tuple[int, str | None]  # how many, and where: None for processes of this machine


@dataclass(frozen=True)
class Measured:
    """One round: seconds from the first item to the last, and those of jobs in workers."""

    workers: int
    items: int
    wall_s: float
    jobs_s: float

    @property
    def rate(self) -> float:
        """The number of items a second."""
        return self.items / self.wall_s

    @property
    def overhead(self) -> float:
        """The part of the workers' time that went into no job."""
        return 1 - self.jobs_s / (self.workers * self.wall_s)


def measure(of: Workers, options: Options) -> Measured:
    """Carry out all items in a folder of their own and return the times."""
    workers, ray = of
    options = replace(options, workers=workers, ray=ray)
    suite = find(SUITE, SUITES, "suite")
    protocol, _ = protocol_of(suite, options)
    with tempfile.TemporaryDirectory() as folder, open_journal(Path(folder, "run")) as journal:
        planned = plan(protocol, journal.directory)
        truths = partial(JobPool, workers=workers, limits=suite.limits)
        run_jobs(planned.ground_truths, journal, "ground truth", truths)
        with executor_factory(options, protocol) as executor:
            start = time.perf_counter()
            done = run_jobs(planned.method_jobs, journal, f"{workers} workers", executor.start)
            wall_s = time.perf_counter() - start
    jobs_s = sum(sum(astuple(job.timing)) for job in done.values())
    return Measured(workers, len(done), wall_s, jobs_s)


def report(kinds: Sequence[Workers], rounds: Sequence[Sequence[Measured]]) -> str:
    """Return a Markdown table; medians over rounds."""
    first = [taken[0].rate for taken in rounds]
    rows = []
    for i, (workers, ray) in enumerate(kinds):
        taken = [round_[i] for round_ in rounds]
        faster = median(m.rate / base for m, base in zip(taken, first, strict=True))
        rows.append(
            [
                f"{workers} of Ray" if ray else str(workers),
                str(taken[0].items),
                f"{median(m.wall_s for m in taken):.1f}",
                f"{median(m.rate for m in taken):.2f}",
                f"{faster:.2f}",
                f"{median(m.overhead for m in taken):.1%}",
            ]
        )
    head = ["workers", "items", "seconds", "items/s", "times the first", "overhead"]
    return markdown(head, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(prog="studies.scaling", description=__doc__)
    parser.add_argument("--workers", type=numbers, default=(1, 2), help="comma-separated")
    parser.add_argument("--ray", action="store_true", help="also on a Ray cluster of this machine")
    parser.add_argument("--limit", type=int, default=8, help="chairs")
    parser.add_argument("--methods", type=names, help="comma-separated; default: the suite's")
    parser.add_argument("--conditions", type=names, help="comma-separated; default: the suite's")
    parser.add_argument("--views", type=int, help="default: the suite's")
    parser.add_argument("--rounds", type=int, default=1)
    args = parser.parse_args(arguments)
    places = (None, LOCAL) if args.ray else (None,)
    kinds: list[Workers] = [(count, place) for place in places for count in args.workers]
    options = Options(
        SUITE,
        methods=args.methods,
        conditions=args.conditions,
        limit=args.limit,
        views=args.views,
    )
    rounds = [[measure(workers, options) for workers in kinds] for _ in range(args.rounds)]
    print(report(kinds, rounds), end="")


if __name__ == "__main__":
    main()
