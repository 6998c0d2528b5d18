"""Images of a finished run, read from its folder, and its clouds, made again."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import FLOOR
from bench.records.artifacts import JobName, read_array
from bench.records.job import Job
from bench.records.parquet import artifacts_of, read_jobs
from bench.running.plan import plan
from bench.running.protocol import stored_protocol
from bench.running.work import cloud_of
from data_prep.failures import BadInput

CACHED = 32  # artifacts held in memory, of about 1 MB each


@dataclass(frozen=True, eq=False)
class Sources:
    """The images and clouds of a run, by the names of its jobs.

    Attributes
    ----------
    artifacts : mapping
        The file of a job's images.
    clouds : mapping
        A job with the same cloud, by the name with an empty method.
    unseen : str
        Why there are no clouds; empty where there are.
    """

    artifacts: Mapping[JobName, Path]
    clouds: Mapping[JobName, Job]
    unseen: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", lru_cache(CACHED)(_read))
        object.__setattr__(self, "_sampled", lru_cache(CACHED)(_sampled))

    def images(self, item: JobName) -> NDArray[np.uint8] | None:
        """Return the images [V, H, W, 3] of a job; None where they are missing or unreadable."""
        path = self.artifacts.get(item)
        return None if path is None else self._read(path)  # type: ignore[attr-defined]

    def points(self, item: JobName) -> NDArray[np.float32] | None:
        """Return the points [N, 3] that a job has drawn; None where they cannot be made again."""
        job = self.clouds.get(item._replace(method=""))
        return None if job is None else self._sampled(job)  # type: ignore[attr-defined]


def open_sources(directory: Path, manifest: Mapping[str, Any], shown: Sequence[JobName]) -> Sources:
    """Return images and clouds of a run; clouds only of the objects and conditions of `shown`.

    Raises BadInput where its list of jobs cannot be read.
    """
    listed = artifacts_of(directory, read_jobs(directory))
    artifacts = {name: path for name, path in listed.items() if path.is_file()}
    try:
        return Sources(artifacts, _cloud_jobs(directory, manifest, shown), "")
    except BadInput as error:
        return Sources(artifacts, {}, f"The clouds cannot be made again: {error}.")


def _cloud_jobs(
    directory: Path, manifest: Mapping[str, Any], shown: Sequence[JobName]
) -> dict[JobName, Job]:
    """Return a job for the cloud of each object and condition. Raises BadInput without dataset."""
    conditions = dict.fromkeys(name.condition for name in shown if name.condition)
    protocol = stored_protocol(manifest, (name.object for name in shown), (FLOOR,), conditions)
    return {job.name._replace(method=""): job for job in plan(protocol, directory).method_jobs}


def _read(path: Path) -> NDArray[np.uint8] | None:
    if not zipfile.is_zipfile(path):  # NumPy would leave such a file open
        return None
    try:
        return read_array(path)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _sampled(job: Job) -> NDArray[np.float32] | None:
    try:
        return cloud_of(job).points
    except (BadInput, OSError):  # the file has gone, or is another one now
        return None
