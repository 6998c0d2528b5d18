"""A store with one changed byte ends no process and is never read as something else.

A small run is read by a worker, whose end ends nothing else.
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
from bench.records.folder import open_folder, open_store
from bench.records.frames import read_features, read_records, read_scores
from bench.records.store import STORE, ScoredMetric
from bench.running.pool import WorkerFailure, run_tasks
from data_prep.failures import BadInput

STORED = Path(__file__).parents[1] / "bench" / "data" / "stored-run"
LIMITS = Limits(time_s=60.0, memory_gib=2.0)
EXTRACTOR, METRIC = "judge", ScoredMetric("dark", 1, "Darkness", True, 3)
MOST_LETTERS = 600  # of a refusal, with a path
STRIDE = 499  # 1 for every byte


@dataclass(frozen=True)
class Flip:
    """One byte of the store in `folder`, and the value that it gets."""

    folder: Path
    position: int
    value: int


def make_store(folder: Path) -> None:
    """Write the store, with scores by a further metric."""
    folder.mkdir()
    shutil.copyfile(STORED / STORE, folder / STORE)
    with open_folder(folder) as store:
        drawn = [row.key for row in store.listed() if row.has_images]
        store.put_scores(METRIC, {key: np.linspace(0, 1, 2) for key in drawn})


def read_contents(folder: Path) -> object:
    """Return everything that the readers of a store give."""
    with open_store(folder) as store:
        jobs = [(row, store.arrays(row.key)) for row in store.listed()]
    records = read_records(folder)
    features = read_features(folder, EXTRACTOR)
    assert features is not None
    cells = sorted({*zip(records["method"], records["condition"], strict=True)})
    of_cells = [(*cell, "chair", features.images(*cell, "chair")) for cell in cells]
    values = [features.of(*cell).tolist() for cell in of_cells]
    metric, scores = read_scores(folder, METRIC.id)
    return jobs, records.to_csv(), of_cells, values, metric, scores.to_csv()


@lru_cache
def own_copy(folder: Path) -> tuple[Path, object]:
    """Return a copy of a folder for this process, and the contents of its store."""
    copy = folder.with_name(f"{folder.name}-{os.getpid()}")
    shutil.copytree(folder, copy)
    return copy, read_contents(copy)


def outcome(flip: Flip) -> str:
    """Change a byte, read the store, change it back; return what became of it."""
    folder, expected = own_copy(flip.folder)
    path = folder / STORE
    data = path.read_bytes()
    path.write_bytes(data[: flip.position] + bytes([flip.value]) + data[flip.position + 1 :])
    try:
        contents = read_contents(folder)
    except BadInput as error:
        one_line = str(error).isprintable() and len(str(error)) < MOST_LETTERS
        return "refused" if one_line and "; " in str(error) else f"defects: {error}"
    except Exception as error:
        return f"defects: {type(error).__name__}: {error}"
    finally:
        path.write_bytes(data)
    return "read" if contents == expected else f"wrong: {flip.position} {flip.value}"


def flips(folder: Path) -> Iterator[Flip]:
    """Yield another value of each `STRIDE`th byte of the store, the same in every call."""
    data = (folder / STORE).read_bytes()
    for position in range(0, len(data), STRIDE):
        difference = random.Random(position).randrange(1, 256)
        yield Flip(folder, position, data[position] ^ difference)


@pytest.mark.slow
def test_no_changed_byte_is_read_as_something_else(tmp_path: Path) -> None:
    make_store(tmp_path / "run")
    tasks = flips(tmp_path / "run")
    results = run_tasks(tasks, outcome, 1, LIMITS, tasks_per_worker=10**6)
    outcomes = Counter("lost" if isinstance(r, WorkerFailure) else r for _, r in results)
    assert outcomes.keys() <= {"read", "refused"}
    assert outcomes["refused"] > outcomes["read"]  # free pages, and room within pages
