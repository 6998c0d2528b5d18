"""Parquet files of records, features and jobs, from which tables, reports and merges are made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby, islice
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from bench.records.artifacts import JobName, artifact_path, read_array
from bench.records.features import GROUP, FeatureFile, unreadable
from bench.records.record import COLUMNS, SCHEMA_VERSION, TYPES, Record, to_frame
from data_prep.failures import BadInput
from data_prep.files.atomic_write import atomic_write

# Arrow's own pool keeps what has been freed: some 35 MB after the records of 20,000 images.
pa.set_memory_pool(pa.system_memory_pool())

RECORDS = "records.parquet"
JOBS = "jobs.parquet"
FEATURES = "features"
_NAME = (*GROUP, "object")  # the columns of a `JobName`
_SCHEMA_KEY = b"pc2pix_bench_schema"
_ROW_GROUP = 512  # records written at a time: 1 MB in memory
_ARTIFACTS = 16  # whose features are written at a time
_RECORDS_SCHEMA = pa.schema(
    [
        (name, pa.from_numpy_dtype(TYPES[name]) if name in TYPES else pa.large_string())
        for name in COLUMNS
    ],
    {_SCHEMA_KEY: str(SCHEMA_VERSION).encode()},
)


def write_records(
    directory: Path,
    jobs: Iterable[JobRow],
    records: Callable[[JobRow], Sequence[Record]],
    row_group: int = _ROW_GROUP,
) -> None:
    """Write `records.parquet`, whole or not at all: the records of all jobs.

    They are sorted by method, condition, class, object and view, whatever the order of the jobs.

    Parameters
    ----------
    directory : Path
    jobs : iterable of JobRow
    records : callable
        Returns the records of one job. It is called for some jobs at a time, so that memory does
        not grow with their number.
    row_group : int
        Records written at a time.
    """
    rows = chain.from_iterable(
        named_records(job.name, records(job)) for job in sorted(jobs, key=lambda job: job.name)
    )
    with (
        atomic_write(directory / RECORDS) as new,
        pq.ParquetWriter(new, _RECORDS_SCHEMA) as writer,
    ):
        while group := list(islice(rows, row_group)):
            frame = to_frame(group)
            writer.write_table(
                pa.Table.from_pandas(frame, schema=_RECORDS_SCHEMA, preserve_index=False)
            )


def named_records(name: JobName, records: Iterable[Record]) -> list[Record]:
    """Return the records of a job by view, with the condition of `name`.

    One job stands for every condition where its method does not see the cloud.
    """
    renamed = (replace(record, condition=name.condition) for record in records)
    return sorted(renamed, key=lambda record: record.view)


def read_records(directory: Path, columns: Sequence[str] = COLUMNS) -> pd.DataFrame:
    """Return the records of a run, or some columns of them.

    Raises BadInput for a file that is missing, unreadable or of another version.
    """
    table = _read_table(directory / RECORDS, COLUMNS, columns)
    return table.to_pandas(use_threads=False)


def _read_table(
    path: Path, columns: Sequence[str], wanted: Sequence[str] | None = None
) -> pa.Table:
    """Return the `wanted` columns of a file (None: all); `columns` are those it has to have.

    Raises BadInput for a file that is missing, unreadable or of another version.
    """
    if not path.is_file():
        raise BadInput(f"{path.parent}: no {path.name}; the run is not finished, start it again")
    try:
        stored = pq.read_schema(path)
        known = [name for name in wanted or stored.names if name in stored.names]
        table = pq.read_table(path, columns=known, use_threads=False)  # threads take memory each
    except (pa.ArrowException, OSError) as error:
        raise unreadable(path, error) from error
    try:
        schema = int((stored.metadata or {}).get(_SCHEMA_KEY, b"0"))
    except ValueError as error:
        raise BadInput(f"{path}: its schema is no number; start the run again") from error
    if schema > SCHEMA_VERSION:
        raise BadInput(
            f"{path}: schema {schema} is newer than {SCHEMA_VERSION}; update pc2pix-bench"
        )
    if 0 < schema < SCHEMA_VERSION:  # scores are missing that only the images could give
        raise BadInput(
            f"{path}: schema {schema} is older than {SCHEMA_VERSION}; start the run again with its "
            "command, to measure what is new"
        )
    lacking = [name for name in columns if name not in stored.names]
    if lacking:
        raise BadInput(f"{path}: no column {', '.join(lacking)}; start the run again")
    return table


@dataclass(frozen=True)
class JobRow:
    """A finished job, a row of `jobs.parquet`: its key in the journal, and its name.

    `artifact_sha256` is None for a job that failed.
    """

    key: str
    name: JobName
    artifact_sha256: str | None


def write_jobs(directory: Path, jobs: Sequence[JobRow]) -> None:
    """Write `jobs.parquet`, whole or not at all: the jobs and ground truths in the given order."""
    columns: dict[str, Any] = {"key": [job.key for job in jobs]}
    columns |= {column: [job.name[i] for job in jobs] for i, column in enumerate(_NAME)}
    columns["artifact_sha256"] = pa.array([job.artifact_sha256 for job in jobs], pa.string())
    table = pa.table(columns, metadata={_SCHEMA_KEY: str(SCHEMA_VERSION).encode()})
    with atomic_write(directory / JOBS) as new:
        pq.write_table(table, new)


def read_jobs(directory: Path) -> list[JobRow]:
    """Return the jobs of a finished run, in the order of its plan.

    Raises BadInput for a file that is missing, unreadable or of another version.
    """
    columns = ("key", *_NAME, "artifact_sha256")
    table = _read_table(directory / JOBS, columns)
    rows = zip(*(table.column(name).to_pylist() for name in columns), strict=True)
    return [JobRow(key, JobName(*name), sha) for key, *name, sha in rows]


def artifacts_of(directory: Path, jobs: Iterable[JobRow]) -> dict[JobName, Path]:
    """Return the artifacts of the jobs that have any, by name, in the order of the jobs."""
    return {job.name: artifact_path(directory, job.key) for job in jobs if job.artifact_sha256}


def write_features(directory: Path, metric: str, artifacts: Mapping[JobName, Path]) -> None:
    """Collect one extractor's features from all artifacts into one file, whole or not at all.

    They are sorted as the records are; only the artifacts of one row group are in memory. Without
    artifacts no file is written.
    """
    groups = (
        pa.concat_tables([_feature_table(name, artifacts[name], metric) for name in names])
        for names in _row_groups(artifacts)
    )
    first = next(groups, None)
    if first is None:
        return
    with (
        atomic_write(directory / FEATURES / f"{metric}.parquet") as new,
        pq.ParquetWriter(new, first.schema) as writer,
    ):
        for table in chain([first], groups):
            writer.write_table(table)


def _row_groups(names: Iterable[JobName]) -> Iterator[list[JobName]]:
    """Yield sorted names in parts of up to _ARTIFACTS, of one method, condition and class each."""
    for _, group in groupby(sorted(names), lambda name: name[:3]):
        while part := list(islice(group, _ARTIFACTS)):
            yield part


def read_features(directory: Path, metric: str) -> FeatureFile | None:
    """Return the features of one extractor; None where they were not taken.

    Raises BadInput for a file that cannot be read.
    """
    path = directory / FEATURES / f"{metric}.parquet"
    return FeatureFile(path) if path.is_file() else None


def _feature_table(name: JobName, artifact: Path, metric: str) -> pa.Table:
    values = read_array(artifact, metric)
    count, width = values.shape
    return pa.table(
        {
            "method": [name.method] * count,
            "condition": [name.condition] * count,
            "class": [name.class_name] * count,
            "object": [name.object_id] * count,
            "view": pa.array(range(count), pa.int32()),
            "features": pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), width),
        }
    )
