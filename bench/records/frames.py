"""The images, the jobs and the features of a run, read from its store."""

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
ImageKey = tuple[str, int]  # object, view
NamedResult = tuple[JobName, Result]
_IMAGES_AT_ONCE = 2**16  # whose records are in memory, some 20 MB
_SUMMED = (*SCORES, *TIMES)


def _parts(jobs: Iterable[NamedResult], most: int) -> Iterator[list[NamedResult]]:
    """Yield the jobs in lists of at least `most` images, but for the last; none is divided."""
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
    """Return one row for each job, in their order.

    It has the columns JOB, `reason` and `notes`; `planned` and `drawn`, its views and those with
    images, which are all or none; its times; and for each column of scores and times, as `ssim`,
    `ssim_sum` and `ssim_count`: the sum and the number of the values that are no NaN.
    """
    counts = np.array([result.count for _, result in jobs], np.int64)
    has_images = np.array([result.has_images for _, result in jobs], bool)
    columns: dict[str, Any] = {
        name: np.array([job_name[i] for job_name, _ in jobs], object) for i, name in enumerate(JOB)
    }
    for name in ("reason", "notes"):
        columns[name] = np.array([getattr(result, name) for _, result in jobs], object)
    columns["planned"], columns["drawn"] = counts, np.where(has_images, counts, 0)
    times = {name: [getattr(result, name) for _, result in jobs] for name in TIMES}
    columns |= {name: np.array(values, np.float64) for name, values in times.items()}
    job = np.repeat(np.arange(len(jobs)), counts)  # of each view
    of_views = dict(zip(OF_VIEWS, _values(jobs).T, strict=True))
    of_views |= {name: columns[name][job] for name in TIMES}
    for name in _SUMMED:
        values = of_views[name]
        known = ~np.isnan(values)
        sums = np.zeros(len(jobs))
        # One after the other: equal images have equal sums to the last bit.
        np.add.at(sums, job[known], values[known])
        columns[f"{name}_sum"] = sums
        columns[f"{name}_count"] = np.bincount(job[known], minlength=len(jobs))
    texts = dict.fromkeys((*JOB, "reason", "notes"), object)
    return pd.DataFrame(columns, copy=False).astype(texts)


def _values(jobs: Sequence[NamedResult]) -> Floats:
    """Return the values in OF_VIEWS of all views, job after job, [V, OF_VIEWS]."""
    packed = b"".join(result.views for _, result in jobs)
    return np.frombuffer(packed, "<f8").reshape(-1, len(OF_VIEWS))


def _image_frame(jobs: Sequence[NamedResult]) -> pd.DataFrame:
    """Return one row for each view of jobs.

    The condition is that of the name: one job stands for every condition where its method does not
    see the cloud.
    """
    names, results = zip(*jobs, strict=True)
    counts = [result.count for result in results]
    of_jobs = {
        "suite": [result.suite for result in results],
        **dict(zip(JOB, zip(*names, strict=True), strict=True)),
        "outcome": ["ok" if result.has_images else "failed" for result in results],
        **{n: [getattr(result, n) for result in results] for n in ("reason", "notes", *TIMES)},
    }
    columns: dict[str, Any] = {
        name: np.repeat(np.array(of_job, TYPES.get(name, object)), counts)
        for name, of_job in of_jobs.items()
    }
    columns["view"] = np.concatenate([np.arange(count, dtype=TYPES["view"]) for count in counts])
    columns |= zip(OF_VIEWS, _values(jobs).T, strict=True)
    return pd.DataFrame({name: columns[name] for name in COLUMNS}, copy=False)


def _read_parts(directory: Path, **only: str) -> Iterator[list[NamedResult]]:
    with open_store(directory) as store:
        if store.is_empty:
            raise BadInput(
                f"{directory}: no finished jobs in {STORE}; the run is not finished, start it again"
            )
        yield from _parts(store.results(**only), _IMAGES_AT_ONCE)


def read_records(directory: Path, columns: Sequence[str] = COLUMNS, **only: str) -> pd.DataFrame:
    """Return the records of a run, or some columns of them, sorted by name and view.

    `only` gives values of the columns that name a job, as `method="blank"`. Raises BadInput where
    the run is not finished, and where its store cannot be read or has changed.
    """
    parts = [_image_frame(part)[list(columns)] for part in _read_parts(directory, **only)]
    frame = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(columns))
    return frame.astype({name: TYPES.get(name, "str") for name in columns})


def write_records(directory: Path, store: Store, most: int = _IMAGES_AT_ONCE) -> None:
    """Write the records of the complete run to `records.parquet`, whole or not at all.

    Nothing here reads that file: it is for the scripts of others.
    """
    kinds = {name: pa.from_numpy_dtype(kind) for name, kind in TYPES.items()}
    schema = pa.schema(
        [(name, kinds.get(name, pa.large_string())) for name in COLUMNS],
        {b"pc2pix_bench_schema": str(RECORDS_VERSION).encode()},
    )
    with (
        atomic_write(directory / _RECORDS) as new,
        new.open("wb") as file,  # pyarrow opens no path that is not UTF-8
        pq.ParquetWriter(file, schema) as writer,
    ):
        for part in _parts(store.results(), most):
            table = pa.Table.from_pandas(_image_frame(part), schema, preserve_index=False)
            writer.write_table(table)


def read_job_sums(directory: Path) -> pd.DataFrame:
    """Return the jobs of a finished run as `job_frame`, sorted by name. Raises as `read_records`.

    Ground truths are no rows, and memory does not grow with the number of views.
    """
    parts = [job_frame(part) for part in _read_parts(directory)]
    return pd.concat(parts, ignore_index=True) if parts else job_frame([])


class Features(Protocol):
    """The features of one extractor by method, condition and class."""

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return all images that have features, sorted; an empty list where none have."""
        ...

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[Any]:
        """Return the features of `images`, [n, d]. Raises KeyError for an unknown image."""
        ...


class _StoredFeatures:
    """The features of one extractor in the store of a run; only those asked for are in memory."""

    def __init__(self, directory: Path, extractor: str) -> None:
        self._directory, self._extractor = directory, extractor

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """Return all images that have features, sorted."""
        with open_store(self._directory) as store:
            objects = store.images_with(self._extractor, method, condition, class_name)
        return [(obj, view) for obj, views in objects for view in range(views)]

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> Floats32:
        """Return the features of `images`, [n, d]. Raises BadInput where the store lacks one."""
        rows: dict[str, list[tuple[int, int]]] = {}  # of each object: view, row
        for row, (obj, view) in enumerate(images):
            rows.setdefault(obj, []).append((view, row))
        values = np.empty((0, 0), np.float32)
        cell = (method, condition, class_name)
        with open_store(self._directory) as store:
            for obj, of_views in store.features(
                self._extractor, *cell, first=min(rows, default=""), last=max(rows, default="")
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
    """Return the features of one extractor; None where they were not taken."""
    with open_store(directory) as store:
        return _StoredFeatures(directory, extractor) if store.has_features(extractor) else None


def scored_metrics(directory: Path) -> list[str]:
    """Return the ids of the metrics that a run was scored by with `bench score`, sorted."""
    with open_store(directory) as store:
        return [*store.metrics()]


def read_scores(directory: Path, metric_id: str) -> tuple[ScoredMetric, pd.DataFrame]:
    """Return a metric of `bench score` and the existing images: the columns JOB, view and value.

    Raises BadInput where any of the run's images has no value.
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
        """Return images [V, H, W, 3], or features [V, d]. Raises KeyError without, and BadInput."""
        with open_store(self.directory) as store:
            return unpack(store.array(self.key, name))

    def read_images(self) -> NDArray[np.uint8] | None:
        """Return the images [V, H, W, 3]; None where they are missing, altered or unreadable."""
        with suppress(BadInput, KeyError):
            return self.read()
        return None


def stored_artifacts(directory: Path) -> dict[JobName, Artifact]:
    """Return the artifacts of a complete run by the names of its jobs, in the order of its plan."""
    jobs = read_jobs(directory)
    return {job.name: Artifact(directory, job.key) for job in jobs if job.has_images}


def read_jobs(directory: Path) -> list[JobRow]:
    """Return the jobs of the complete run in a folder, in the order of its plan."""
    with open_store(directory) as store:
        return [*store.listed()]
