"""Records, features and the list of jobs as Parquet files.

What tables, reports and merged runs are made from, and what scripts may read.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.artifacts import Artifact, Item, artifact_path, read_artifact
from bench.record import COLUMNS, SCHEMA_VERSION, to_frame
from bench.tables import Features
from bench.work import Result
from data_prep.failures import BadInput
from data_prep.whole_files import whole_file

RECORDS = "records.parquet"
JOBS = "jobs.parquet"
FEATURES = "features"
_ITEM = ("method", "condition", "class", "object")
_SCHEMA_KEY = b"pc2pix_bench_schema"


def write_records(directory: Path, results: Sequence[Result]) -> pd.DataFrame:
    """Write `records.parquet`, whole or not at all, and return its frame."""
    frame = to_frame([record for result in results for record in result.records])
    table = pa.Table.from_pandas(frame, preserve_index=False)
    _write_table(directory / RECORDS, table)
    return frame


def read_records(directory: Path) -> pd.DataFrame:
    """The records of a run. Raises BadInput: none there, unreadable, or of another version."""
    return _read_table(directory / RECORDS, COLUMNS).to_pandas()


def _write_table(path: Path, table: pa.Table) -> None:
    table = table.replace_schema_metadata({_SCHEMA_KEY: str(SCHEMA_VERSION).encode()})
    with whole_file(path) as new:
        pq.write_table(table, new)


def _read_table(path: Path, columns: Sequence[str]) -> pa.Table:
    if not path.is_file():
        raise BadInput(f"{path.parent}: no {path.name}; the run is not finished, start it again")
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise BadInput(f"{path}: not readable ({error}); start the run again") from error
    try:
        schema = int((table.schema.metadata or {}).get(_SCHEMA_KEY, b"0"))
    except ValueError as error:
        raise BadInput(f"{path}: its schema is no number; start the run again") from error
    if schema > SCHEMA_VERSION:
        raise BadInput(
            f"{path}: schema {schema} is newer than {SCHEMA_VERSION}; update pc2pix-bench"
        )
    if 0 < schema < SCHEMA_VERSION:  # scores are missing that only the pictures could give
        raise BadInput(
            f"{path}: schema {schema} is older than {SCHEMA_VERSION}; start the run again with its "
            "command, to measure what is new"
        )
    lacking = [name for name in columns if name not in table.column_names]
    if lacking:
        raise BadInput(f"{path}: no column {', '.join(lacking)}; start the run again")
    return table


@dataclass(frozen=True)
class JobRow:
    """A finished job: `key` is its name in the journal; without an artifact, it failed."""

    key: str
    item: Item
    artifact_sha256: str | None


def write_jobs(directory: Path, jobs: Sequence[JobRow]) -> None:
    """Write `jobs.parquet`, whole or not at all: all jobs, ground truths too, in the given order;
    the checksum of an artifact is null where there is none."""
    columns: dict[str, Any] = {"key": [job.key for job in jobs]}
    columns |= {name: [job.item[i] for job in jobs] for i, name in enumerate(_ITEM)}
    columns["artifact_sha256"] = pa.array([job.artifact_sha256 for job in jobs], pa.string())
    _write_table(directory / JOBS, pa.table(columns))


def read_jobs(directory: Path) -> list[JobRow]:
    """The jobs of a finished run, in the order of its plan.

    Raises BadInput: none there, unreadable, or of another version.
    """
    columns = ("key", *_ITEM, "artifact_sha256")
    table = _read_table(directory / JOBS, columns)
    rows = zip(*(table.column(name).to_pylist() for name in columns), strict=True)
    return [JobRow(key, Item(*item), sha) for key, *item, sha in rows]


def artifacts_of(directory: Path, jobs: Iterable[JobRow]) -> list[Artifact]:
    """Where the pictures are of those jobs that have any."""
    return [
        Artifact(job.item, artifact_path(directory, job.key)) for job in jobs if job.artifact_sha256
    ]


def write_features(directory: Path, metric: str, artifacts: Sequence[Artifact]) -> None:
    """Collect one extractor's features from all artifacts into one file, which is written whole or
    not at all; without artifacts, there is none."""
    if not artifacts:
        return
    groups = (  # a few row groups, little memory
        pa.concat_tables(
            [_feature_table(artifact, metric) for artifact in artifacts[start : start + 64]]
        )
        for start in range(0, len(artifacts), 64)
    )
    first = next(groups)
    with (
        whole_file(directory / FEATURES / f"{metric}.parquet") as new,
        pq.ParquetWriter(new, first.schema) as writer,
    ):
        for table in chain([first], groups):
            writer.write_table(table)


def read_features(directory: Path, metric: str) -> Features | None:
    """Rows and features [n, d] of one extractor; None where they were not taken."""
    path = directory / FEATURES / f"{metric}.parquet"
    if not path.is_file():
        return None
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise BadInput(f"{path}: not readable ({error}); start the run again") from error
    column = table.column("features").combine_chunks()
    values: NDArray[np.float32] = column.flatten().to_numpy().reshape(len(table), -1)
    return Features(table.drop_columns(["features"]).to_pandas(), values)


def _feature_table(artifact: Artifact, metric: str) -> pa.Table:
    values = read_artifact(artifact.path)[metric]
    count, width = values.shape
    return pa.table(
        {
            "method": [artifact.item.method] * count,
            "condition": [artifact.item.condition] * count,
            "class": [artifact.item.class_name] * count,
            "object": [artifact.item.object_id] * count,
            "view": pa.array(range(count), pa.int32()),
            "features": pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), width),
        }
    )
