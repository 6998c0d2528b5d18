"""Peak memory of a run's main process against the number of images: it should not grow.

    python -m studies.memory --out DIR [--objects 25,500] [--rows 1000000]

Runs      The suite chair-robustness at condition 2048, by default with methods splat and blank, 20
          views an object, as many workers as cores; the images are those that the methods draw,
          so that 25 objects make 1,000 of them and 500 make 20,000. Ground truths come on top.
          Each run is a process of its own, with one worker process for each core; measured is the
          main one, which plans, keeps the journal, and makes records, tables, figures and report.
          Peaks are VmHWM of Linux; `start` is what that process has when all is imported that a
          run imports, before it begins. A second run of each finds all jobs in the journal:
          `resumed`.
Moments   Rows of 64 features, drawn in blocks and merged (`bench.metrics.frechet.merged`), against
          all of them in one array: how far the distances lie apart, and what each has added to the
          peak.

Writes DIR/memory.csv and one folder a run, which a second call goes on with. A run of 500 objects
takes some ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.commands.publish import run_suite
from bench.metrics.frechet import (
    centred,
    centred_to_frechet,
    merged_to_centred,
    moments,
)
from bench.running.options import Options
from bench.suites.speed.measure import peak_mib
from bench.tables.table import csv_text
from studies.arguments import names, numbers
from studies.tables import markdown

OBJECTS = (25, 500)
METHODS = ("splat", "blank")
VIEWS = 20
ROWS, WIDTH, BLOCK = 1_000_000, 64, 1000
HEAD = ("run", "objects", "images", "seconds", "at the start, MiB", "peak, MiB")
ALLOWED = 0.10  # growth of the peak from the smallest to the largest run


@dataclass(frozen=True)
class Peak:
    """The most memory of one process, in MiB: `start` before the run, `end` after it.

    what  "drawn" or "resumed"
    """

    what: str
    objects: int
    images: int
    seconds: float
    start: float
    end: float


@dataclass(frozen=True)
class Merging:
    """A distance by both ways, their relative difference, and MiB added to the peak by each."""

    rows: int
    distance: float
    difference: float
    merged_mib: float
    whole_mib: float


def own_peak() -> float:
    """Return the most memory that this process has had, in MiB.

    Raises ValueError where Linux is not.
    """
    peak = peak_mib()
    if peak is None:
        raise ValueError("no peak in /proc/self/status: this needs Linux")
    return peak


def measure_run(out: Path, objects: int, methods: Sequence[str], workers: int | None) -> Peak:
    """Carry out a run in this process, whose peak so far is the start."""
    start, begun = own_peak(), time.perf_counter()
    done = run_suite(
        Options(
            suite="chair-robustness",
            methods=tuple(methods),
            conditions=("2048",),
            limit=objects,
            views=VIEWS,
            workers=workers,
            device="cpu",
            out=out,
        )
    )
    return Peak(
        what="drawn" if done.done else "resumed",
        objects=objects,
        images=objects * VIEWS * len(methods),
        seconds=time.perf_counter() - begun,
        start=start,
        end=own_peak(),
    )


def blocks(seed: int, rows: int, factor: float) -> Iterator[NDArray[np.float32]]:
    """Yield rows of correlated features, BLOCK at a time."""
    mix = np.random.default_rng(99).standard_normal((WIDTH, WIDTH)) / np.arange(1, WIDTH + 1)
    for block in range(-(-rows // BLOCK)):
        drawn = np.random.default_rng((seed, block)).standard_normal((BLOCK, WIDTH))
        yield (factor * (drawn[: rows - block * BLOCK] @ mix) + factor).astype(np.float32)


def measure_merging(rows: int) -> Merging:
    """Measure both ways in turn: the first needs less, so that the second shows."""
    merged_to_centred(moments(block) for block in blocks(0, BLOCK, 1.0))  # what BLAS sets up
    before = own_peak()
    first, second = (
        merged_to_centred(moments(block) for block in blocks(seed, rows, factor))
        for seed, factor in ((1, 1.0), (2, 1.2))
    )
    distance, after = centred_to_frechet(first, second), own_peak()
    sets = [np.concatenate(list(blocks(seed, rows, f))) for seed, f in ((1, 1.0), (2, 1.2))]
    whole = centred_to_frechet(*(centred(features) for features in sets))
    apart = abs(distance - whole) / whole
    return Merging(rows, distance, apart, after - before, own_peak() - after)


def growth(peaks: Sequence[Peak]) -> float:
    """Return the growth of the peak from the fewest to the most images; 0.1 is 10 %."""
    ordered = sorted(peaks, key=lambda peak: peak.images)
    return ordered[-1].end / ordered[0].end - 1


def to_markdown(peaks: Sequence[Peak]) -> str:
    """Return a line for each run, and the growth of drawn and of resumed ones."""
    rows = [[peak.what, *(f"{value:.0f}" for value in astuple(peak)[1:])] for peak in peaks]
    lines = []
    for what in dict.fromkeys(peak.what for peak in peaks):
        grown = growth([peak for peak in peaks if peak.what == what])
        verdict = "flat" if abs(grown) <= ALLOWED else "not flat"
        lines.append(f"{what}: {grown:+.1%} from the fewest images to the most, {verdict}\n")
    return f"{markdown(HEAD, rows)}\n{''.join(lines)}"


def write_csv(path: Path, peaks: Sequence[Peak]) -> None:
    """Write all runs, a line each."""
    text = csv_text([field.name for field in fields(Peak)], map(astuple, peaks))
    path.write_text(text, encoding="utf-8")


def read_csv(path: Path) -> list[Peak]:
    """Return what `write_csv` has written; nothing where there is no file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    return [
        Peak(what, int(objects), int(images), *map(float, rest))
        for what, objects, images, *rest in rows
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out the runs, each in its own process; return 1 if memory grows with the images."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--objects", type=numbers, default=OBJECTS)
    parser.add_argument("--methods", type=names, default=METHODS)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--rows", type=int, default=ROWS, help="merged; 0: none")
    parser.add_argument("--alone", type=int, help=argparse.SUPPRESS)
    chosen = parser.parse_args(arguments)
    table = chosen.out / "memory.csv"
    if chosen.alone is not None:
        out = chosen.out / f"run-{chosen.alone}"
        peak = measure_run(out, chosen.alone, chosen.methods, chosen.workers)
        write_csv(table, [*read_csv(table), peak])
        return 0
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.rows:
        merging = measure_merging(chosen.rows)
        print(
            f"{merging.rows} rows of {WIDTH}: distance {merging.distance:.6f}, relative difference "
            f"{merging.difference:.1e}; merged +{merging.merged_mib:.0f} MiB, "
            f"at once +{merging.whole_mib:.0f} MiB",
            flush=True,
        )
    common = ["--out", str(chosen.out), "--methods", ",".join(chosen.methods)]
    if chosen.workers is not None:
        common += ["--workers", str(chosen.workers)]
    for objects in chosen.objects:
        command = [sys.executable, "-m", "studies.memory", *common, "--alone", str(objects)]
        for _ in ("drawn", "resumed"):
            subprocess.run(command, check=True)
    peaks = read_csv(table)
    print(to_markdown(peaks), end="")
    return int(abs(growth([p for p in peaks if p.what == "drawn"] or peaks)) > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
