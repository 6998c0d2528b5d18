"""Digests of what a run has stored, and of what it was made from."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from bench.catalogue.suites import Suite
from bench.catalogue.truth import stored_suite
from bench.records.artifacts import IMAGES, JobName, unpack
from bench.records.parquet import RECORDS, read_records
from bench.records.record import COLUMNS, GROUND_TRUTH, TIMES, Record
from bench.records.store import STORE, JobRow, Store, open_store
from bench.running.plan import views_of
from bench.tables.table import TABLES
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import MIB

PARTS = 32  # digests of jobs in a receipt, at most
PART_DIGITS = 16  # of each in the receipt; the digest of all jobs is of whole ones
# One job stands for every condition where its method does not see the cloud: the condition of its
# records is the first one that it was asked for.
SCORED = tuple(name for name in Record.__dataclass_fields__ if name not in (*TIMES, "condition"))
UNREADABLE = f"{STORE}: cannot be read"
MOST_TABLE_BYTES = 256 * MIB
# Libraries raise these, beside BadInput, while they read a file of which bytes were changed.
DAMAGED = (
    *(ValueError, LookupError, TypeError, AttributeError, OverflowError, EOFError, OSError),
    *(zlib.error, pa.ArrowException),
)


@dataclass(frozen=True)
class FolderDigests:
    """The digests of a run's folder.

    Attributes
    ----------
    entries : dict
        Entries of a receipt: jobs, records and tables.
    problems : list of str
        What is missing or altered, by the folder's own checksums.
    parts : list of (str, list of str)
        Digest of each part of the jobs, and the names of its objects.
    """

    entries: dict[str, Any]
    problems: list[str]
    parts: list[tuple[str, list[str]]]


def digest_folder(directory: Path, manifest: Mapping[str, Any]) -> FolderDigests:
    """Return the digests of the jobs, records and tables in a folder."""
    problems: list[str] = []
    try:
        with open_store(directory) as store:
            jobs, parts = digest_jobs(store, manifest, problems)
    except DAMAGED as error:
        jobs, parts = {"count": 0, "parts": "", "sha256": ""}, []
        problems.append(f"{UNREADABLE} ({error})")
    try:
        records = digest_records(directory)
    except DAMAGED as error:
        records = ""
        problems.append(f"{RECORDS}: cannot be read ({error})")
    if not (tables := digest_tables(directory, stored_suite(manifest))):
        problems.append(f"{directory / TABLES}: no tables")
    return FolderDigests({"jobs": jobs, "records": records, "tables": tables}, problems, parts)


def digest_tables(directory: Path, suite: Suite) -> dict[str, str]:
    """Return the checksum of each CSV file of tables, but for those of times."""
    timed = {f"{spec.name}.csv" for spec in suite.tables if spec.kind in ("frontier", "points")}
    paths = sorted((directory / TABLES).glob("*.csv"))
    return {p.name: file_sha256(p, MOST_TABLE_BYTES) for p in paths if p.name not in timed}


def digest_jobs(
    store: Store, manifest: Mapping[str, Any], problems: list[str]
) -> tuple[dict[str, Any], list[tuple[str, list[str]]]]:
    """Return the entry of a receipt on the jobs of a run, and its parts with their objects.

    Jobs that are missing or altered are added to `problems`.
    """
    objects = list(map(str, manifest["objects"]))
    keys: set[str] = set()
    parts = []
    for members in deal(objects):
        digests = []
        for name in members:
            rows = store.listed_of(*name.partition("/")[::2])
            lacking = _expected(manifest, name) - {row.name for row in rows}
            problems += [f"no {job_title(job)} in its store" for job in sorted(lacking)]
            keys |= {row.key for row in rows}
            digests += digest_object(store, rows, problems)
        parts.append((part_digest(digests), members))
    listed = sum(1 for _ in store.listed())
    expected = len(objects) * (1 + len(manifest["methods"]) * len(manifest["conditions"]))
    if listed != expected:
        problems.append(f"{listed} jobs are listed in its store, not {expected}")
    return jobs_entry([digest for digest, _ in parts], len(keys)), parts


def part_digest(jobs: Iterable[str]) -> str:
    """Return the digest of a part from those of its jobs, in any order."""
    return sha256("".join(sorted(jobs)).encode()).hexdigest()


def jobs_entry(parts: Sequence[str], count: int) -> dict[str, Any]:
    """Return the entry of a receipt on `count` jobs, from the digests of their parts."""
    return {
        "count": count,
        "parts": "".join(digest[:PART_DIGITS] for digest in parts),
        "sha256": sha256("".join(parts).encode()).hexdigest(),
    }


def deal(objects: Sequence[str]) -> list[list[str]]:
    """Return the objects dealt to at most `PARTS` parts, one after the other."""
    count = min(PARTS, len(objects))
    return [list(objects[number::count]) for number in range(count)]


def _expected(manifest: Mapping[str, Any], name: str) -> set[JobName]:
    """Return the names of the jobs that an object has in a run."""
    class_name, _, obj = name.partition("/")
    cells = [(m, c) for m in manifest["methods"] for c in manifest["conditions"]]
    return {
        JobName(method, condition, class_name, obj)
        for method, condition in [(GROUND_TRUTH, ""), *cells]
    }


def job_title(name: JobName) -> str:
    """Return the name of a job as messages have it."""
    at = f" at {name.condition}" if name.condition else ""
    return f"{name.method}{at} of {'/'.join(name.object)}"


def digest_object(store: Store, rows: Iterable[JobRow], problems: list[str]) -> list[str]:
    """Return a digest for each job of an object; one without results has a problem instead."""
    digests, contents = [], dict[str, str]()
    for row in rows:
        try:
            if row.key not in contents:
                contents[row.key] = _contents_sha256(store, row)
        except KeyError:
            problems.append(f"{job_title(row.name)}: not in its store")
            continue
        except DAMAGED as error:
            problems.append(f"{job_title(row.name)}: {error}")
            continue
        digests.append(_sha256([*row.name, row.key, contents[row.key]]))
    return digests


def _contents_sha256(store: Store, row: JobRow) -> str:
    """Return a digest of the records without times, the images and the features of a job.

    Raises KeyError for a job that the store does not have, and one of DAMAGED where it has changed.
    """
    result = store.find([row.key])[row.key]
    records = [[getattr(record, name) for name in SCORED] for record in store.records(row.key)]
    arrays = arrays_sha256(store.artifact(row.key)) if row.artifact_sha256 else {}
    return _sha256([result.reason, records, arrays])


def arrays_sha256(artifact: bytes) -> dict[str, str]:
    """Return a digest of the type, the shape and the values of each array of an artifact.

    The bytes of an artifact are compressed, and another zlib compresses to others.
    """
    digests = {}
    for name, array in sorted(unpack_all(artifact).items()):
        digest = sha256(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
        digests[name] = digest.hexdigest()
    return digests


def unpack_all(artifact: bytes) -> dict[str, Any]:
    """Return all arrays of an artifact. Raises BadInput for bytes that are none."""
    try:
        with zipfile.ZipFile(io.BytesIO(artifact)) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
    except zipfile.BadZipFile as error:
        raise BadInput(
            f"images that are no .npz ({error}); start the run again with its command"
        ) from error
    if IMAGES not in names:
        raise BadInput(f"no images among {', '.join(names)}; start the run again with its command")
    return unpack(artifact, names)


def digest_records(directory: Path) -> str:
    """Return a digest of `records.parquet` without the times, column by column.

    Raises one of DAMAGED for a file that cannot be read.
    """
    frame = read_records(directory, [name for name in COLUMNS if name not in TIMES])
    digest = sha256()
    for name in frame.columns:
        values = frame[name].astype(object).where(frame[name].notna(), None).tolist()
        digest.update(f"{name} {json.dumps(values)}\n".encode())
    return digest.hexdigest()


def digest_inputs(objects: Sequence[SceneObject], views: int, seed: int) -> dict[str, Any]:
    """Return the entry of a receipt on the objects of a run and the directions they are seen from.

    Clouds follow from objects, seed and conditions; true images are among the jobs.
    """
    digest = sha256()
    for obj in objects:
        seen = [[v.azimuth_deg, v.elevation_deg] for v in views_of(obj, views, seed)]
        identity = [obj.class_name, obj.object_id, obj.fingerprint(), seen]
        digest.update(json.dumps(identity).encode())
    return {"objects": len(objects), "sha256": digest.hexdigest()}


def _sha256(value: object) -> str:
    return sha256(json.dumps(value).encode()).hexdigest()
