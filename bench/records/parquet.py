"""Records, features and the list of jobs as Parquet files.

What tables, reports and merged runs are made from, and what scripts may read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby, islice
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from bench.records.artifacts import Artifact, Item, artifact_path
from bench.records.features import FeatureFile
from bench.records.record import COLUMNS, SCHEMA_VERSION, TYPES, Record, to_frame
from data_prep.failures import BadInput
from data_prep.files.atomic_write import atomic_write

# Arrow's own pool keeps what has been freed: some 35 MB after the records of 20,000 images.
pa.set_memory_pool(pa.system_memory_pool())

RECORDS = "records.parquet"
JOBS = "jobs.parquet"
FEATURES = "features"
_ITEM = ("method", "condition", "class", "object")
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
    directory: Path, jobs: Iterable[JobRow], records: Callable[[JobRow], Sequence[Record]]
) -> None:
    """Write `records.parquet`, whole or not at all: the records of all jobs, sorted.

    records  gives those of a job; they are asked for some jobs at a time, so that memory does not
             grow with their number. A job may stand for several conditions: the records get that
             of the item

    Sorted by method, condition, class, object and view, whatever the order of the jobs.
    """
    rows = chain.from_iterable(
        records_of_item(job.item, records(job)) for job in sorted(jobs, key=lambda job: job.item)
    )
    with (
        atomic_write(directory / RECORDS) as new,
        pq.ParquetWriter(new, _RECORDS_SCHEMA) as writer,
    ):
        while group := list(islice(rows, _ROW_GROUP)):
            frame = to_frame(group)
            writer.write_table(
                pa.Table.from_pandas(frame, schema=_RECORDS_SCHEMA, preserve_index=False)
            )


def records_of_item(item: Item, records: Iterable[Record]) -> list[Record]:
    """The records of the job that an item was done by, as those of the item, by view."""
    own = (replace(record, condition=item.condition) for record in records)
    return sorted(own, key=lambda record: record.view)


def read_records(directory: Path, columns: Sequence[str] = COLUMNS) -> pd.DataFrame:
    """The records of a run, or some columns of them.

    Raises BadInput: none there, unreadable, or of another version.
    """
    table = _read_table(directory / RECORDS, COLUMNS, columns)
    return table.to_pandas(use_threads=False)


def _write_table(path: Path, table: pa.Table) -> None:
    table = table.replace_schema_metadata({_SCHEMA_KEY: str(SCHEMA_VERSION).encode()})
    with atomic_write(path) as new:
        pq.write_table(table, new)


def _read_table(
    path: Path, columns: Sequence[str], wanted: Sequence[str] | None = None
) -> pa.Table:
    """Those `wanted` of its columns, None: all. All of `columns` have to be there."""
    if not path.is_file():
        raise BadInput(f"{path.parent}: no {path.name}; the run is not finished, start it again")
    try:
        there = pq.read_schema(path)
        known = [name for name in wanted or there.names if name in there.names]
        table = pq.read_table(path, columns=known, use_threads=False)  # threads take memory each
    except (pa.ArrowException, OSError) as error:
        raise BadInput(f"{path}: not readable ({error}); start the run again") from error
    try:
        schema = int((there.metadata or {}).get(_SCHEMA_KEY, b"0"))
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
    lacking = [name for name in columns if name not in there.names]
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
    """Where the images are of those jobs that have any."""
    return [
        Artifact(job.item, artifact_path(directory, job.key)) for job in jobs if job.artifact_sha256
    ]


def write_features(directory: Path, metric: str, artifacts: Sequence[Artifact]) -> None:
    """Collect one extractor's features from all artifacts into one file, which is written whole or
    not at all; without artifacts, there is none.

    Sorted as the records are; a row group is of one cell (`bench.records.features`), and only its
    artifacts are in memory.
    """
    groups = (
        pa.concat_tables([_feature_table(artifact, metric) for artifact in some])
        for some in _by_cell(artifacts)
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


def _by_cell(artifacts: Sequence[Artifact]) -> Iterator[list[Artifact]]:
    """Cells in order, each in parts of up to _ARTIFACTS."""
    ordered = sorted(artifacts, key=lambda artifact: artifact.item)
    for _, of_cell in groupby(ordered, lambda artifact: artifact.item[:3]):
        while some := list(islice(of_cell, _ARTIFACTS)):
            yield some


def read_features(directory: Path, metric: str) -> FeatureFile | None:
    """The features of one extractor; None where they were not taken.

    Raises BadInput for a file that cannot be read.
    """
    path = directory / FEATURES / f"{metric}.parquet"
    return FeatureFile(path) if path.is_file() else None


def _feature_table(artifact: Artifact, metric: str) -> pa.Table:
    values = artifact.array(metric)
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
