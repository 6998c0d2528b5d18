"""Parquet files with one changed byte end no process and are never read as something else.

Small files of records, features and scores are read by a worker, whose end ends nothing else.
"""

from __future__ import annotations

import os
import random
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

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
MOST_LETTERS = 600  # of a refusal, with a path
STRIDE = 7  # 1 for every byte


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


def flips(folder: Path, file: str) -> Iterator[Flip]:
    """Yield another value of each `STRIDE`th byte of a file, the same in every call."""
    data = (folder / file).read_bytes()
    for position in range(0, len(data), STRIDE):
        difference = random.Random(f"{file} {position}").randrange(1, 256)
        yield Flip(folder, file, position, data[position] ^ difference)


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_no_changed_byte_is_read_as_something_else(tmp_path: Path, file: str) -> None:
    (tmp_path / "run").mkdir()
    make_files(tmp_path / "run")
    tasks = flips(tmp_path / "run", file)
    results = run_tasks(tasks, outcome, 1, LIMITS, tasks_per_worker=10**6)
    outcomes = Counter("lost" if isinstance(r, WorkerFailure) else r for _, r in results)
    assert outcomes.keys() <= {"read", "refused"}
    # only a changed SEAL leaves the rest as it was
    assert outcomes["read"] <= len(SEAL)
    assert outcomes["refused"] > 50
