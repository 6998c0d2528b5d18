"""Parquet files of records and features, from which tables, reports and scripts read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.records.artifacts import JobName, unpack
from bench.records.features import FeatureFile, may_hold, unreadable
from bench.records.record import COLUMNS, SCHEMA_VERSION, TYPES, Record
from bench.records.seal import check_seal, file_with_seal
from bench.records.store import DamagedJob, JobRow, Store
from data_prep.failures import BadInput

# Arrow's own pool keeps what has been freed: some 35 MB after the records of 20,000 images.
pa.set_memory_pool(pa.system_memory_pool())

RECORDS = "records.parquet"
FEATURES = "features"
_SCHEMA_KEY = b"pc2pix_bench_schema"
_FIELDS = tuple(Record.__dataclass_fields__)  # in the order of the columns
_ROW_GROUP = 2**16  # records written at a time: a footer is 3 kB, and these some 50 MB in memory
_ARTIFACTS = 256  # whose features are written at a time, 5 MB
_RECORDS_SCHEMA = pa.schema(
    [
        (name, pa.from_numpy_dtype(TYPES[name]) if name in TYPES else pa.large_string())
        for name in COLUMNS
    ],
    {_SCHEMA_KEY: str(SCHEMA_VERSION).encode()},
)


def write_records(
    directory: Path,
    jobs: Iterable[tuple[JobName, Mapping[str, Sequence[Any]]]],
    row_group: int = _ROW_GROUP,
) -> None:
    """Write `records.parquet`, whole or not at all: the records of all jobs by view.

    Parameters
    ----------
    directory : Path
    jobs : iterable of (JobName, mapping)
        Name and records of each job, sorted by name: a list of values for each field of `Record`.
        They are taken one after the other, so that memory does not grow with their number. The
        condition is that of the name: one job stands for every condition where its method does not
        see the cloud.
    row_group : int
        Records written at a time.
    """
    with (
        file_with_seal(directory / RECORDS) as new,
        pq.ParquetWriter(new, _RECORDS_SCHEMA) as writer,
    ):
        columns: dict[str, list[Any]] = {name: [] for name in _FIELDS}
        for name, records in jobs:
            by_view = sorted(range(len(records["view"])), key=records["view"].__getitem__)
            for field, values in columns.items():
                values += (records[field][i] for i in by_view)
            columns["condition"][len(columns["condition"]) - len(by_view) :] = [
                name.condition
            ] * len(by_view)
            if len(columns["view"]) >= row_group:
                _write_group(writer, columns)
                columns = {name: [] for name in _FIELDS}
        if columns["view"]:
            _write_group(writer, columns)


def _write_group(writer: pq.ParquetWriter, columns: Mapping[str, Sequence[Any]]) -> None:
    arrays = [
        pa.array(values, kind)
        for values, kind in zip(columns.values(), _RECORDS_SCHEMA.types, strict=True)
    ]
    writer.write_table(pa.Table.from_arrays(arrays, schema=_RECORDS_SCHEMA))


def read_records(directory: Path, columns: Sequence[str] = COLUMNS, **only: str) -> pd.DataFrame:
    """Return the records of a run, or some columns of them, in one frame.

    `only` gives a value that a text column has to have, as `method="blank"`: only the records with
    that value are in memory. Raises BadInput as `read_batches`.
    """
    with _open_records(directory, dictionaries=False) as file:
        none = pa.schema([file.schema_arrow.field(name) for name in columns]).empty_table()
        parts = pa.concat_tables([none, *_batches(file, directory, columns, only)])
        return parts.to_pandas(use_threads=False)


def read_batches(
    directory: Path, columns: Sequence[str] = COLUMNS, **only: str
) -> Iterator[pd.DataFrame]:
    """Yield the records of a run part by part, text as categories; `only` as `read_records`.

    One part is in memory at a time. Raises BadInput for a file that is missing, unreadable or of
    another version.
    """
    with _open_records(directory, dictionaries=True) as file:
        for batch in _batches(file, directory, columns, only):
            yield batch.to_pandas(use_threads=False)


def _batches(
    file: pq.ParquetFile, directory: Path, columns: Sequence[str], only: Mapping[str, str]
) -> Iterator[pa.Table]:
    read = list(dict.fromkeys((*columns, *only)))
    try:
        for number in range(file.num_row_groups):
            if all(may_hold(file.metadata, number, name, value) for name, value in only.items()):
                # `iter_batches` keeps what it has read, and threads take memory each.
                part = file.read_row_group(number, read, use_threads=False)
                for name, value in only.items():
                    part = part.filter(pc.call_function("equal", [part[name], pa.scalar(value)]))
                if len(part):
                    yield part.select(columns)
    except (pa.ArrowException, OSError) as error:
        raise unreadable(directory / RECORDS, error) from error


def _open_records(directory: Path, dictionaries: bool) -> pq.ParquetFile:
    """Return the open file of the records of a run; `dictionaries` reads text as categories.

    Raises BadInput for a file that is missing, unreadable or of another version.
    """
    path = directory / RECORDS
    if not path.is_file():
        raise BadInput(f"{directory}: no {path.name}; the run is not finished, start it again")
    text = [name for name in COLUMNS if name not in TYPES] if dictionaries else None
    try:
        check_seal(path)
        file = pq.ParquetFile(path, read_dictionary=text)
    except (pa.ArrowException, OSError) as error:
        raise unreadable(path, error) from error
    stored = file.schema_arrow
    try:
        schema = int((stored.metadata or {}).get(_SCHEMA_KEY, b"0"))
    except ValueError as error:
        raise BadInput(f"{path}: its schema is no number; start the run again") from error
    if schema > SCHEMA_VERSION:
        raise BadInput(
            f"{path}: schema {schema} is newer than {SCHEMA_VERSION}; update pc2pix-bench"
        )
    if schema < SCHEMA_VERSION:  # scores are missing that only the images could give
        raise BadInput(
            f"{path}: of version 1.0.0 or earlier (schema {schema}, now {SCHEMA_VERSION}); start "
            "the run again with its command"
        )
    if lacking := [name for name in COLUMNS if name not in stored.names]:
        raise BadInput(f"{path}: no column {', '.join(lacking)}; start the run again")
    for name in TYPES:
        kind = stored.field(name).type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise BadInput(f"{path}: column {name} is {kind}, no numbers; start the run again")
    return file


def write_features(
    directory: Path, store: Store, metrics: Sequence[str], jobs_per_group: int = _ARTIFACTS
) -> None:
    """Collect the features of the complete run into a file for each extractor.

    A file is written whole or not at all, and sorted as the records are; only the features of one
    row group are in memory. Where no job has images, no file is written. Raises BadInput for an
    artifact that has changed.
    """
    drawn = (job for job in store.listed(by_name=True) if job.artifact_sha256)
    writers: dict[str, pq.ParquetWriter] = {}
    with ExitStack() as files:
        for jobs in _row_groups(drawn, jobs_per_group):
            read = [_features(store, job.key, metrics) for job in jobs]
            for metric in metrics:
                table = pa.concat_tables(
                    _feature_table(job.name, arrays[metric])
                    for job, arrays in zip(jobs, read, strict=True)
                )
                if metric not in writers:
                    path = directory / FEATURES / f"{metric}.parquet"
                    new = files.enter_context(file_with_seal(path))
                    writers[metric] = files.enter_context(pq.ParquetWriter(new, table.schema))
                writers[metric].write_table(table)


def _features(store: Store, key: str, metrics: Sequence[str]) -> dict[str, NDArray[Any]]:
    artifact = store.artifact(key)
    try:
        return unpack(artifact, metrics)
    except (BadInput, KeyError) as error:
        raise DamagedJob(store.path, key, "features") from error


def _row_groups(jobs: Iterable[JobRow], most: int) -> Iterator[list[JobRow]]:
    """Yield sorted jobs in parts of up to `most`, of one method, condition and class each."""
    for _, group in groupby(jobs, lambda job: job.name[:3]):
        while part := list(islice(group, most)):
            yield part


def read_features(directory: Path, metric: str) -> FeatureFile | None:
    """Return the features of one extractor; None where they were not taken.

    Raises BadInput for a file that cannot be read.
    """
    path = directory / FEATURES / f"{metric}.parquet"
    return FeatureFile(path) if path.is_file() else None


def _feature_table(name: JobName, values: NDArray[np.float32]) -> pa.Table:
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
