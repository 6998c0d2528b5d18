"""The records, jobs, features and images of a run, read from its store, mostly as data frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.records.job import (
    COLUMNS,
    IMAGES,
    JOB,
    OF_VIEWS,
    RECORDS_VERSION,
    SCORES,
    TIMES,
    TYPES,
    JobName,
    Result,
    unpack,
)
from bench.records.store import STORE, JobRow, ScoredMetric, Store, open_store
from data_prep.arrays import Floats, Floats32
from data_prep.failures import BadInput
from data_prep.files.atomic_write import atomic_write

_RECORDS = "records.parquet"
ImageKey = tuple[str, int]  # the name of the object, and the number of the view
NamedResult = tuple[JobName, Result]
_IMAGES_AT_ONCE = 2**16  # the number of images whose records are in memory at a time: some 20 MB
_SUMMED = (*SCORES, *TIMES)  # the columns whose values are summed over the views of a job


def _parts(jobs: Iterable[NamedResult], most: int) -> Iterator[list[NamedResult]]:
    """Yield the jobs in lists, each of which is complete once it has `most` images.

    The last list may have fewer images. No job is divided between two lists.
    """
    part: list[NamedResult] = []
    count = 0
    for name, result in jobs:
        part.append((name, result))
        count += result.count
        if count >= most:
            yield part
            part, count = [], 0
    if part:
        yield part


def job_frame(jobs: Sequence[NamedResult]) -> pd.DataFrame:
    """Return a frame with one row for each job, in their order.

    JOB                    the columns that name the job
    reason, notes          why it gave no images, and what the method says about its repairs
    planned                the number of its views
    drawn                  the number of its images: `planned`, or 0 for a job that failed
    TIMES                  its times
    ssim_sum, ssim_count   the sum of a score over its views, and the number of views that have the
                           score (it is not NaN); likewise for all SCORES and TIMES
    """
    counts = np.array([result.count for _, result in jobs], np.int64)
    has_images = np.array([result.has_images for _, result in jobs], bool)
    columns: dict[str, Any] = {}
    for i, name in enumerate(JOB):
        columns[name] = np.array([job_name[i] for job_name, _ in jobs], object)
    for name in ("reason", "notes"):
        columns[name] = np.array([getattr(result, name) for _, result in jobs], object)
    columns["planned"] = counts
    columns["drawn"] = np.where(has_images, counts, 0)
    for name in TIMES:
        columns[name] = np.array([getattr(result, name) for _, result in jobs], np.float64)
    job_of_view = np.repeat(np.arange(len(jobs)), counts)
    of_views: dict[str, Floats] = dict(zip(OF_VIEWS, _values(jobs).T, strict=True))
    for name in TIMES:
        of_views[name] = columns[name][job_of_view]
    for name in _SUMMED:
        values = of_views[name]
        known = ~np.isnan(values)
        sums = np.zeros(len(jobs))
        # `add.at` adds one value after the other, so that equal images have equal sums.
        np.add.at(sums, job_of_view[known], values[known])
        columns[f"{name}_sum"] = sums
        columns[f"{name}_count"] = np.bincount(job_of_view[known], minlength=len(jobs))
    texts = dict.fromkeys((*JOB, "reason", "notes"), object)
    return pd.DataFrame(columns, copy=False).astype(texts)


def _values(jobs: Sequence[NamedResult]) -> Floats:
    """Return the values of all views, job after job: float64 [V, OF_VIEWS]."""
    packed = b"".join(result.views for _, result in jobs)
    return np.frombuffer(packed, "<f8").reshape(-1, len(OF_VIEWS))


def _image_frame(jobs: Sequence[NamedResult]) -> pd.DataFrame:
    """Return a frame with one row for each view of some jobs, with the columns COLUMNS.

    The condition is that of the job's name, not that of its result: where a method does not look at
    the cloud, one result stands for all conditions.
    """
    results = [result for _, result in jobs]
    counts = [result.count for result in results]
    of_jobs: dict[str, list[Any]] = {"suite": [result.suite for result in results]}
    for i, name in enumerate(JOB):
        of_jobs[name] = [job_name[i] for job_name, _ in jobs]
    of_jobs["outcome"] = ["ok" if result.has_images else "failed" for result in results]
    for name in ("reason", "notes", *TIMES):
        of_jobs[name] = [getattr(result, name) for result in results]
    columns: dict[str, Any] = {}
    for name, values in of_jobs.items():
        columns[name] = np.repeat(np.array(values, TYPES.get(name, object)), counts)
    columns["view"] = np.concatenate([np.arange(count, dtype=TYPES["view"]) for count in counts])
    columns |= zip(OF_VIEWS, _values(jobs).T, strict=True)
    return pd.DataFrame({name: columns[name] for name in COLUMNS}, copy=False)


def _read_parts(directory: Path, **only: str) -> Iterator[list[NamedResult]]:
    """Yield the jobs in the store of a run in lists that fit into memory, sorted by name."""
    with open_store(directory) as store:
        if store.is_empty:
            raise BadInput(
                f"{directory}: no finished jobs in {STORE}; the run is not finished, start it again"
            )
        yield from _parts(store.results(**only), _IMAGES_AT_ONCE)


def read_records(directory: Path, columns: Sequence[str] = COLUMNS, **only: str) -> pd.DataFrame:
    """Return the records of a run, or some columns of them, sorted by job and view.

    only  values that the columns in JOB are to have, as in `method="blank"`

    Raises BadInput where the run is not finished, and where its store cannot be read or has changed
    since it was written.
    """
    parts = [_image_frame(part)[list(columns)] for part in _read_parts(directory, **only)]
    frame = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(columns))
    return frame.astype({name: TYPES.get(name, "str") for name in columns})


def write_records(directory: Path, store: Store, most: int = _IMAGES_AT_ONCE) -> None:
    """Write the records of the complete run to `records.parquet`, whole or not at all.

    The file is for scripts of users; this project does not read it. `most` images are in memory at
    a time.
    """
    kinds = {name: pa.from_numpy_dtype(kind) for name, kind in TYPES.items()}
    schema = pa.schema(
        [(name, kinds.get(name, pa.large_string())) for name in COLUMNS],
        {b"pc2pix_bench_schema": str(RECORDS_VERSION).encode()},
    )
    with (
        atomic_write(directory / _RECORDS) as new,
        new.open("wb") as file,  # by Python, since pyarrow cannot open a path that is not UTF-8
        pq.ParquetWriter(file, schema) as writer,
    ):
        for part in _parts(store.results(), most):
            table = pa.Table.from_pandas(_image_frame(part), schema, preserve_index=False)
            writer.write_table(table)


def read_job_sums(directory: Path) -> pd.DataFrame:
    """Return the jobs of a finished run as `job_frame` has them, sorted by name.

    The jobs that draw the ground truths have no row. The memory that it takes does not grow with
    the number of views. Raises as `read_records`.
    """
    parts = [job_frame(part) for part in _read_parts(directory)]
    return pd.concat(parts, ignore_index=True) if parts else job_frame([])


class Features(Protocol):
    """The features that one extractor has taken of the images of a run."""

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return all images of a method, condition and class that have features, sorted."""
        ...

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Return the features of `images`, [n, d]. Raises KeyError for an unknown image."""
        ...


class _StoredFeatures:
    """The features of one extractor in the store of a run, read when they are asked for."""

    def __init__(self, directory: Path, extractor: str) -> None:
        self._directory, self._extractor = directory, extractor

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return all images of a method, condition and class that have features, sorted."""
        with open_store(self._directory) as store:
            objects = store.images_with(self._extractor, method, condition, class_name)
        return [(obj, view) for obj, views in objects for view in range(views)]

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> Floats32:
        """Return the features of `images`, [n, d]. Raises BadInput where the store lacks one."""
        # For each object the views that are asked for, with the row that each has in the answer.
        rows: dict[str, list[tuple[int, int]]] = {}
        for row, (obj, view) in enumerate(images):
            rows.setdefault(obj, []).append((view, row))
        values = np.empty((0, 0), np.float32)
        first, last = min(rows, default=""), max(rows, default="")
        with open_store(self._directory) as store:
            for obj, of_views in store.features(
                self._extractor, method, condition, class_name, first=first, last=last
            ):
                if of_views.ndim != 2 or of_views.dtype != np.float32:
                    break
                if not values.size:
                    values = np.full((len(images), of_views.shape[1]), np.nan, np.float32)
                for view, row in rows.get(obj, ()):
                    if view < len(of_views) and of_views.shape[1] == values.shape[1]:
                        values[row] = of_views[view]
        known = np.isfinite(values).all(axis=1) if values.size else np.zeros(len(images), bool)
        if lacking := [images[row] for row in np.flatnonzero(~known).tolist()]:
            obj, view = min(lacking)
            whose = f"{method} at {condition}" if condition else method
            raise BadInput(
                f"{self._directory}: no features ({self._extractor}) of {whose} of "
                f"{class_name}/{obj}, view {view}; start the run again with its command, which "
                "takes them anew"
            )
        return values


def read_features(directory: Path, extractor: str) -> _StoredFeatures | None:
    """Return the features of one extractor in the store of a run; None where it has none."""
    with open_store(directory) as store:
        return _StoredFeatures(directory, extractor) if store.has_features(extractor) else None


def scored_metrics(directory: Path) -> list[str]:
    """Return the ids of the metrics by which `bench score` has scored a run, sorted."""
    with open_store(directory) as store:
        return [*store.metrics()]


def read_scores(directory: Path, metric_id: str) -> tuple[ScoredMetric, pd.DataFrame]:
    """Return a metric of `bench score`, and its value for each image of a run.

    The frame has a row for each image that was drawn, with the columns JOB, `view` and `value`.
    Raises BadInput where one of these images has no value.
    """
    again = f"run 'bench score {directory} --metrics {metric_id}'"
    with open_store(directory) as store:
        metric = store.metrics().get(metric_id)
        if metric is None:
            raise BadInput(f"{directory}: is not scored by {metric_id}; {again} first")
        scores = [*store.scores(metric_id)]
    named = []
    for name, values in scores:
        if values is None:
            raise BadInput(f"{directory}: was scored by {metric_id} before it was changed; {again}")
        named += [(*name, view, value) for view, value in enumerate(values.tolist())]
    return metric, pd.DataFrame(named, columns=[*JOB, "view", "value"])


@dataclass(frozen=True)
class Artifact:
    """The images and features of a job in the store of a folder, read when they are asked for."""

    directory: Path
    key: str

    def read(self, name: str = IMAGES) -> NDArray[Any]:
        """Return the images [V, H, W, 3], or the features [V, d] of an extractor.

        Raises KeyError where the job has none, and BadInput where they cannot be read.
        """
        with open_store(self.directory) as store:
            return unpack(store.array(self.key, name))

    def read_images(self) -> NDArray[np.uint8] | None:
        """Return the images [V, H, W, 3]; None where they are missing, altered or unreadable."""
        with suppress(BadInput, KeyError):
            return self.read()
        return None


def stored_artifacts(directory: Path) -> dict[JobName, Artifact]:
    """Return the images and features of a complete run by job, in the order of its plan."""
    jobs = read_jobs(directory)
    return {job.name: Artifact(directory, job.key) for job in jobs if job.has_images}


def read_jobs(directory: Path) -> list[JobRow]:
    """Return the jobs of the complete run in a folder, in the order of its plan."""
    with open_store(directory) as store:
        return [*store.listed()]
