"""Count the tamperings with a run that its receipt finds, and the honest receipts refused.

    python -m studies.receipts FOLDER [--tamperings 1000] [--draws 100] [--workers 1,2]

FOLDER is a small finished run. Tamperings change one byte of a copy of its files, or of the code
and weights of a copy of this tree; they are looked for by checksums alone, and what is not found is
asked whether it changes a result. Honest verifications compute a part of the jobs again, each by
another draw.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sqlite3
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from bench.catalogue.methods import find_method
from bench.receipts.folder import compare_folder, compare_manifest, remake
from bench.receipts.receipt import (
    describe_manifest,
    find_objects,
    make_receipt,
    to_text,
    weights_of,
)
from bench.receipts.verify import VerifierChoices, verify
from bench.records.job import Job, Result
from bench.records.record import TIMES
from bench.records.run_folder import MANIFEST, read_finished, read_manifest
from bench.records.store import STORE, unpack_columns
from bench.running.environment import RESULT_CODE, ROOT, SUFFIXES, code_sha256
from bench.running.executors import JobPool
from bench.running.protocol import name_of
from data_prep.failures import BadInput
from data_prep.randomness import generator

UNMEASURED = (  # entries of a manifest that no result depends on
    *("command", "started", "finished", "stage_seconds", "worker_shares", "workers", "cluster"),
    *("machine", "git", "versions"),
)


@contextmanager
def one_byte_changed(path: Path, rng: np.random.Generator) -> Iterator[None]:
    """Change a random byte of a file within the block."""
    data = path.read_bytes()
    other = bytearray(data)
    other[rng.integers(len(data))] ^= int(rng.integers(1, 256))
    path.write_bytes(other)
    try:
        yield
    finally:
        path.write_bytes(data)


def differences(receipt: dict[str, Any], folder: Path, scratch: Path) -> list[str]:
    """Return what a verification by checksums alone says of a folder."""
    try:
        manifest = read_finished(folder)
        described = describe_manifest(folder, manifest)
        objects = [name_of(obj) for obj in find_objects(receipt["request"])]
        lines = compare_manifest(receipt, described, manifest["objects"], objects)
        lines = lines or compare_folder(receipt, folder, manifest)
        if not lines:  # tables are made again only where no checksum differs: this is dear
            lines, _ = remake(folder, manifest, [*receipt["metrics"]], scratch, True)
    except BadInput as error:
        return [str(error)]
    return lines


def stored_results(folder: Path) -> object:
    """Return everything in the store that results depend on: names, keys, records and images."""
    with closing(sqlite3.connect(folder / STORE)) as connection:
        rows = connection.execute(
            "SELECT method, condition, class, object, key, artifact_sha256, reason, records, data "
            "FROM listed LEFT JOIN jobs USING (key) LEFT JOIN artifacts USING (id) "
            "ORDER BY method, condition, class, object"
        ).fetchall()
    untimed = []
    for *rest, records, data in rows:
        columns = unpack_columns(records)
        untimed.append((rest, {n: v for n, v in columns.items() if n not in TIMES}, data))
    return untimed


def results_in(path: Path) -> object:
    """Return everything in a file that results depend on; None where it cannot be read.

    The times, places and loads of a run are no results, nor are the parts of a file that its
    readers skip.
    """
    try:
        if path.name == STORE:
            return stored_results(path.parent)
        if path.name == MANIFEST:
            manifest = json.loads(path.read_bytes())
            return {name: value for name, value in manifest.items() if name not in UNMEASURED}
        if path.suffix == ".parquet":
            frame = pd.read_parquet(path)
            return frame.drop(columns=[name for name in TIMES if name in frame]).to_csv()
    except (sqlite3.Error, BadInput, ValueError, OSError, pa.ArrowException):
        return None
    return path.read_bytes()


def tamper(paths: list[Path], count: int, find: Callable[[], list[str]]) -> Counter[str]:
    """Change one byte of one of the files `count` times, and count what became of it."""
    outcomes: Counter[str] = Counter()
    before = {path: results_in(path) for path in paths}
    rng = generator("studies.receipts", str(len(paths)), count)
    sizes = np.array([path.stat().st_size for path in paths], float)
    for _ in range(count):
        path = paths[rng.choice(len(paths), p=sizes / sizes.sum())]
        with one_byte_changed(path, rng):
            if find():
                outcomes["found"] += 1
            else:
                same = results_in(path) == before[path]
                outcomes["not found, no result" if same else "MISSED"] += 1
    return outcomes


def tamper_with_all(folder: Path, count: int) -> Iterator[tuple[str, Counter[str]]]:
    """Yield what was tampered with, and the outcomes, of `count` tamperings in all."""
    with TemporaryDirectory() as place:
        copy = Path(shutil.copytree(folder, Path(place) / "run"))
        receipt, scratch = make_receipt(copy), Path(place) / "scratch"
        kinds: dict[str, tuple[list[Path], int]] = {
            "tables": (sorted(copy.glob("tables/*")), 2 * count // 10),
            "records": ([copy / "records.parquet"], 2 * count // 10),
            "store": ([copy / STORE], 2 * count // 10),
            "features": (sorted(copy.glob("features/*")), count // 10),
            "manifest": ([copy / MANIFEST], count // 10),
        }
        for kind, (paths, part) in kinds.items():
            yield kind, tamper(paths, part, lambda: differences(receipt, copy, scratch))
        yield "code", tamper_with_code(Path(place), receipt, count // 10)
        yield "weights", tamper_with_weights(Path(place), count // 10)


def tamper_with_code(place: Path, receipt: dict[str, Any], count: int) -> Counter[str]:
    """Return the outcomes of tamperings with the code that results depend on."""
    tree = place / "tree"
    for name in RESULT_CODE:
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    names = [path for name in RESULT_CODE for path in sorted((tree / name).rglob("*"))]
    paths = [path for path in names if path.suffix in SUFFIXES and path.stat().st_size]
    expected = receipt["code"]["sha256"]
    return tamper(
        paths,
        count,
        lambda: [] if code_sha256(RESULT_CODE, tree) == expected else ["code"],
    )


def tamper_with_weights(place: Path, count: int) -> Counter[str]:
    """Return the outcomes of tamperings with a copy of the weights of a network."""
    source = find_method("splat-net@chair-tiny").weights_file
    assert source is not None
    path = place / source().name
    shutil.copy(source(), path)
    method = f"splat-net@{path}"
    honest = weights_of({method: find_method(method).identity()})

    def find() -> list[str]:
        try:
            return [] if weights_of({method: find_method(method).identity()}) == honest else ["w"]
        except BadInput as error:
            return [str(error)]

    return tamper([path], count, find)


class KeptPool:
    """An executor whose worker processes stay for the next verification."""

    def __init__(self, pool: JobPool) -> None:
        self._pool, self.capacity = pool, pool.capacity

    def submit(self, job: Job) -> None:
        """Start a job."""
        self._pool.submit(job)

    def wait_any(self) -> Iterator[Result]:
        """Yield the results of jobs that have ended."""
        return self._pool.wait_any()

    def close(self) -> None:
        """Leave the processes as they are."""


def verify_honestly(folder: Path, draws: int, workers: int, first: int) -> tuple[int, float]:
    """Return how many of `draws` verifications are refused, and the seconds of one."""
    from bench.catalogue.truth import stored_suite

    manifest = read_manifest(folder)
    refused, begun = 0, time.perf_counter()
    with TemporaryDirectory() as place:
        path = Path(place) / "receipt.json"
        path.write_text(to_text(make_receipt(folder)))
        limits = stored_suite(manifest).limits
        with closing(JobPool(workers, workers, limits)) as pool:
            for seed in range(first, first + draws):
                verdict = verify(
                    path,
                    VerifierChoices(folder, seed=seed),
                    lambda: manifest["environment"],
                    lambda count: KeptPool(pool),
                )
                refused += bool(verdict.differences)
                for line in verdict.differences:
                    print(line, file=sys.stderr)
    return refused, (time.perf_counter() - begun) / draws


def main() -> None:
    """Print the outcomes of tamperings and of honest verifications."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tamperings", type=int, default=1000)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--workers", default="1,2")
    arguments = parser.parse_args()
    every: Counter[str] = Counter()
    for kind, counts in tamper_with_all(arguments.folder, arguments.tamperings):
        print(f"{kind}: {json.dumps(counts)}", flush=True)
        every += counts
    print(f"all: {json.dumps(every)}", flush=True)
    workers = [int(text) for text in arguments.workers.split(",")]
    for number, count in enumerate(workers):
        draws = arguments.draws // len(workers)
        if draws:
            refused, seconds = verify_honestly(arguments.folder, draws, count, number * draws)
            print(
                f"{count} workers: {refused} of {draws} refused, {seconds:.1f} s each", flush=True
            )


if __name__ == "__main__":
    main()
