"""Images of a finished run, read from its folder, and its clouds, made again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import FLOOR
from bench.records.frames import Artifact, stored_artifacts
from bench.records.job import Job, JobName
from bench.running.plan import plan
from bench.running.protocol import Protocol
from bench.running.work import cloud_under
from data_prep.failures import BadInput, StageFailure

_CACHED = 32  # jobs whose images are held in memory, about 1 MB each; and as many clouds


@dataclass(frozen=True, eq=False)
class Sources:
    """The images and clouds of a run, by the names of its jobs.

    artifacts  where the images of jobs are stored
    clouds     by the name of a job without its method, a job whose cloud is the same
    unseen     why clouds cannot be made again; empty where they can
    """

    artifacts: Mapping[JobName, Artifact]
    clouds: Mapping[JobName, Job]
    unseen: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", lru_cache(_CACHED)(Artifact.read_images))
        object.__setattr__(self, "_sampled", lru_cache(_CACHED)(_sampled))

    def images(self, item: JobName) -> NDArray[np.uint8] | None:
        """Return the images [V, H, W, 3] of a job; None where they are missing or unreadable."""
        artifact = self.artifacts.get(item)
        return None if artifact is None else self._read(artifact)  # type: ignore[attr-defined]

    def points(self, item: JobName) -> NDArray[np.float32] | None:
        """Return the points [N, 3] that a job has drawn; None where they cannot be made again."""
        job = self.clouds.get(item._replace(method=""))
        return None if job is None else self._sampled(job)  # type: ignore[attr-defined]


def open_sources(directory: Path, manifest: Mapping[str, Any], shown: Sequence[JobName]) -> Sources:
    """Open the images of a run, and the clouds of the objects and conditions of `shown`.

    Raises BadInput where its store cannot be read.
    """
    artifacts = stored_artifacts(directory)
    try:
        return Sources(artifacts, _cloud_jobs(manifest, shown), "")
    except BadInput as error:
        return Sources(artifacts, {}, f"The clouds cannot be made again: {error}.")


def _cloud_jobs(manifest: Mapping[str, Any], shown: Sequence[JobName]) -> dict[JobName, Job]:
    """Return a job for the cloud of each object and condition.

    Raises BadInput where the data set is not there.
    """
    conditions = dict.fromkeys(name.condition for name in shown if name.condition)
    objects = ("/".join(name.object) for name in shown)
    protocol = Protocol.from_manifest(manifest, (FLOOR,), conditions, objects)
    return {job.name._replace(method=""): job for job in plan(protocol).method_jobs}


def _sampled(job: Job) -> NDArray[np.float32] | None:
    try:
        return cloud_under(job, job.condition).points
    except (BadInput, StageFailure, OSError):  # the file has gone, or the condition has failed
        return None
