"""Parquet files of a run with each of their bytes changed, given to their readers.

    python -m tests.robustness.flip_bytes [--values 3] [--stride 1] [--workers 1]

Takes small files of records, features and scores. Each byte of each file gets some other values,
one at a time, and the file is read in a worker, whose end ends nothing else. Prints how many files
were read as they had been written, refused in one line, read as something else (`wrong`), left by
another exception (`defects`), and ended their worker (`lost`), for the data and for what comes
after them: seal, footer, its length. Exit status 1 where one of the last three is not 0.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bench.catalogue.suites import Limits
from bench.records.image_scores import ScoredMetric, read_scores, write_scores
from bench.records.parquet import FEATURES, RECORDS, read_features, read_records
from bench.records.seal import SEAL
from bench.running.isolation import WorkerFailure, run_tasks
from data_prep.failures import BadInput

STORED = Path(__file__).parents[1] / "bench" / "data" / "stored-run"
LIMITS = Limits(time_s=60.0, memory_gib=2.0)
EXTRACTOR, METRIC = "judge", ScoredMetric("dark", 1, "Darkness", True, 3)
FILES = (RECORDS, f"{FEATURES}/{EXTRACTOR}.parquet", f"scores/{METRIC.id}.parquet")
DATA, REST = "data", "seal and footer"
OUTCOMES = ("read", "refused", "wrong", "defects", "lost")
MOST_LETTERS = 600  # of a refusal, with a path


@dataclass(frozen=True)
class Flip:
    """One byte of a file of `folder`, and the value that it gets."""

    folder: Path
    file: str
    position: int
    value: int


def make_files(folder: Path) -> None:
    """Write the files."""
    for name in (RECORDS, f"{FEATURES}/{EXTRACTOR}.parquet"):
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        shutil.copyfile(STORED / name, path)
    records = read_records(folder)
    write_scores(folder, METRIC, records, np.linspace(0, 1, len(records)))


def read_contents(folder: Path, file: str) -> object:
    """Return everything that the reader of a file gives."""
    if file == RECORDS:
        return read_records(folder).to_csv()
    if file.startswith(FEATURES):
        features = read_features(folder, EXTRACTOR)
        assert features is not None
        records = read_records(folder)
        cells = sorted({*zip(records["method"], records["condition"], strict=True)})
        return [
            (
                images := features.images(*cell, "chair"),
                features.of(*cell, "chair", images).tolist(),
            )
            for cell in cells
        ]
    metric, scores = read_scores(folder, METRIC.id)
    return metric, scores.to_csv()


@lru_cache
def own_copy(folder: Path) -> tuple[Path, dict[str, object]]:
    """Return a copy of a folder for this process, and the contents of its files."""
    copy = folder.with_name(f"{folder.name}-{os.getpid()}")
    shutil.copytree(folder, copy)
    return copy, {file: read_contents(copy, file) for file in FILES}


def outcome(flip: Flip) -> str:
    """Change a byte, read the file, change it back; return what became of it."""
    folder, expected = own_copy(flip.folder)
    path = folder / flip.file
    data = path.read_bytes()
    path.write_bytes(data[: flip.position] + bytes([flip.value]) + data[flip.position + 1 :])
    try:
        contents = read_contents(folder, flip.file)
    except BadInput as error:
        one_line = str(error).isprintable() and len(str(error)) < MOST_LETTERS
        return "refused" if one_line and "; " in str(error) else "defects"
    except Exception:
        return "defects"
    finally:
        path.write_bytes(data)
    return "read" if contents == expected[flip.file] else "wrong"


def flips(folder: Path, file: str, values: int, stride: int) -> Iterator[Flip]:
    """Yield `values` other values of every so many-th byte of a file, the same in every call."""
    data = (folder / file).read_bytes()
    for position in range(0, len(data), stride):
        rng = random.Random(f"{file} {position}")
        for difference in rng.sample(range(1, 256), values):
            yield Flip(folder, file, position, data[position] ^ difference)


def part_start(data: bytes) -> int:
    """Return where the seal of a file begins."""
    return data.rindex(SEAL)


def count_outcomes(tasks: Iterable[Flip], workers: int = 1) -> dict[tuple[str, str], Counter[str]]:
    """Return how many changed files had each outcome, by file and part."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    for flip, result in run_tasks(tasks, outcome, workers, LIMITS, tasks_per_worker=10**6):
        at_rest = flip.position >= part_start((flip.folder / flip.file).read_bytes())
        name = "lost" if isinstance(result, WorkerFailure) else result
        counts.setdefault((flip.file, REST if at_rest else DATA), Counter())[name] += 1
        if name in ("defects", "lost"):
            print(f"{name}: {flip.file}, byte {flip.position} set to {flip.value}")
    return counts


def main(arguments: Sequence[str] | None = None) -> int:
    """Run from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description="Parquet files with one byte changed.")
    parser.add_argument("--values", type=int, default=3, help="for each byte, at most 255")
    parser.add_argument("--stride", type=int, default=1, help="take every so many-th byte only")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="flip-") as name:
        folder = Path(name) / "run"
        folder.mkdir()
        make_files(folder)
        tasks = (f for file in FILES for f in flips(folder, file, options.values, options.stride))
        counts = count_outcomes(tasks, options.workers)
    print(f"| file | part | {' | '.join(OUTCOMES)} |\n{'|---' * (2 + len(OUTCOMES))}|")
    failed = 0
    for (file, part), of_part in counts.items():
        print(f"| {file} | {part} | {' | '.join(str(of_part[name]) for name in OUTCOMES)} |")
        failed += of_part["defects"] + of_part["lost"] + of_part["wrong"]
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
