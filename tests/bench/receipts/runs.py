"""Runs for the tests of receipts, and their jobs computed again in this process."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

from bench.receipts.receipt import make_receipt, to_text, with_digest
from bench.receipts.verify import Verdict, VerifierChoices, verify
from bench.records.run_folder import read_manifest
from bench.records.store import STORE
from bench.running.isolation import library_threads
from bench.running.work import run_job


class InProcess:
    """An executor of jobs in this process, one at a time on one thread."""

    capacity = 1

    def __init__(self, count: int) -> None:
        self._ended: list = []

    def submit(self, job) -> None:
        with library_threads(1):
            self._ended.append(run_job(job))

    def wait_any(self):
        ended, self._ended = self._ended, []
        yield from ended

    def close(self) -> None:
        pass


def verified(
    receipt: Path, folder: Path | None, environment_of: Path, gl: str = "", **choices
) -> Verdict:
    """Verify with the driver of the run in a folder, or another one named `gl`, in this process."""
    environment = read_manifest(environment_of)["environment"] | ({"gl": gl} if gl else {})
    return verify(
        receipt, VerifierChoices(folder, **choices), lambda: environment, lambda n: InProcess(n)
    )


def write_receipt(path: Path, receipt: dict) -> Path:
    """Write a receipt with the digest that it should have."""
    path.write_text(to_text(with_digest(receipt)))
    return path


def receipt_of(folder: Path, path: Path) -> Path:
    path.write_text(to_text(make_receipt(folder)))
    return path


def execute(folder: Path, *commands: tuple) -> None:
    """Alter the store of a folder behind its back."""
    with closing(sqlite3.connect(folder / STORE)) as connection, connection:
        for command, *values in commands:
            connection.execute(command, values)


def alter_manifest(folder: Path, **entries) -> None:
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))
