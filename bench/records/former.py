"""Run folders of earlier versions, which kept a journal and a file for each job.

    journal/NNNN.jsonl        one line for each finished job: a checksum, a blank, JSON
    artifacts/KK/KEY.npz      images and features of each job
    jobs.parquet              the jobs of the last complete run

Such a folder gets a store once; then its old files are removed. A job whose line or artifact is
damaged is not brought over, and is done again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from bench.records.artifacts import JobName
from bench.records.job import Result
from bench.records.record import Record
from bench.records.seal import check_seal
from bench.records.store import STORE, open_store
from data_prep.failures import CannotWrite
from data_prep.progress import log

JOURNAL, ARTIFACTS, JOBS = "journal", "artifacts", "jobs.parquet"
_FIELDS = Record.__dataclass_fields__.keys()


def is_former(directory: Path) -> bool:
    """Return whether a folder still has the files of an earlier version."""
    return (directory / JOURNAL).is_dir()


def import_former(directory: Path) -> None:
    """Bring the jobs of a former folder into its store, and remove the files they were in.

    Nothing is done in another folder. A kill loses nothing: the next command goes on. The caller
    holds the folder's lock. Raises CannotWrite where there is no room.
    """
    if not is_former(directory):
        return
    left_out = 0
    with open_store(directory, write=True) as store:
        for result in _read_journal(directory / JOURNAL):
            artifact = _read_artifact(directory, result)
            if result is None or (result.has_images and artifact is None):
                left_out += 1
            else:
                store.append(replace(result, artifact=artifact))
        if jobs := [*_read_jobs(directory / JOBS)]:
            store.list_jobs(jobs)
        count = store.appended
    try:
        shutil.rmtree(directory / ARTIFACTS, ignore_errors=True)
        (directory / JOBS).unlink(missing_ok=True)
        shutil.rmtree(directory / JOURNAL)  # the last: it is what a former folder is known by
    except OSError as error:
        raise CannotWrite(
            f"{directory}: its files of an earlier version cannot be removed ({error.strerror}); "
            "copy it to a folder that can be written"
        ) from error
    lost = f"; {left_out} damaged ones are done again" if left_out else ""
    log(f"{directory}: {count} jobs of an earlier version are now in {STORE}{lost}")


def _read_journal(folder: Path) -> Iterator[Result | None]:
    """Yield the result of each line, in the order of writing; None for a damaged line."""
    for file in sorted(path for path in folder.glob("*.jsonl") if path.stem.isdecimal()):
        with file.open("rb") as lines:
            for line in lines:
                checksum, _, body = line.removesuffix(b"\n").partition(b" ")
                if sha256(body).hexdigest().encode() != checksum:
                    if line != b"\n":
                        yield None
                    continue
                values = json.loads(body)
                if any(record.keys() != _FIELDS for record in values["records"]):
                    continue  # of an older schema, on which its key depends: no job has it now
                records = tuple(Record(**record) for record in values["records"])
                sha = values["artifact_sha256"]
                reason = records[0].reason if records and sha is None else ""
                yield Result(values["key"], records, sha, reason)


def _read_artifact(directory: Path, result: Result | None) -> bytes | None:
    """Return the artifact of a result; None where it has none, or a missing or altered one."""
    if result is None or not result.has_images:
        return None
    path = directory / ARTIFACTS / result.key[:2] / f"{result.key}.npz"
    with suppress(OSError):
        data = path.read_bytes()
        if sha256(data).hexdigest() == result.artifact_sha256:
            return data
    return None


def _read_jobs(path: Path) -> Iterator[tuple[str, JobName]]:
    """Yield key and name of each job of the complete run; nothing where the list is unreadable."""
    names = ("key", "method", "condition", "class", "object")
    with suppress(OSError, pa.ArrowException, KeyError):
        check_seal(path)  # it has none: another process reads it first
        table = pq.read_table(path)
        for key, *name in zip(*(table.column(n).to_pylist() for n in names), strict=True):
            yield key, JobName(*name)
