"""Where a finished run keeps its images, and its clouds made again. Reads, never writes."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.lookup import find
from bench.catalogue.methods import FLOOR
from bench.catalogue.suites import SUITES
from bench.records.artifacts import Item, read_artifact
from bench.records.job import Job
from bench.records.parquet import artifacts_of, read_jobs
from bench.running.protocol import Protocol, objects_to_search, plan
from bench.running.work import cloud_of
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput

CACHED = 32  # artifacts held in memory, of about 1 MB each


@dataclass(frozen=True, eq=False)
class Sources:
    """Images and clouds by item.

    artifacts  where the images are
    clouds     jobs whose clouds are the items', by item with an empty method
    unseen     why there are no clouds; empty where there are
    """

    artifacts: Mapping[Item, Path]
    clouds: Mapping[Item, Job]
    unseen: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", lru_cache(CACHED)(_read))
        object.__setattr__(self, "_sampled", lru_cache(CACHED)(_sampled))

    def images(self, item: Item) -> NDArray[np.uint8] | None:
        """The images [V, H, W, 3] of an item; None where they are missing or unreadable."""
        path = self.artifacts.get(item)
        return None if path is None else self._read(path)  # type: ignore[attr-defined]

    def points(self, item: Item) -> NDArray[np.float32] | None:
        """The points [N, 3] that an item was drawn from; None where they cannot be made again."""
        job = self.clouds.get(item._replace(method=""))
        return None if job is None else self._sampled(job)  # type: ignore[attr-defined]


def open_sources(directory: Path, manifest: Mapping[str, Any], shown: Sequence[Item]) -> Sources:
    """What there is of a run; clouds only of the objects and conditions of `shown`.

    Raises BadInput where its list of jobs cannot be read.
    """
    there = artifacts_of(directory, read_jobs(directory))
    artifacts = {artifact.item: artifact.path for artifact in there if artifact.path.is_file()}
    try:
        return Sources(artifacts, _cloud_jobs(directory, manifest, shown), "")
    except BadInput as error:
        return Sources(artifacts, {}, f"The clouds cannot be made again: {error}.")


def _cloud_jobs(
    directory: Path, manifest: Mapping[str, Any], shown: Sequence[Item]
) -> dict[Item, Job]:
    """Raises BadInput where the dataset is no longer there."""
    suite = find(str(manifest["suite"]), SUITES, "suite")
    dataset, count = open_dataset(manifest["dataset"]), objects_to_search(manifest)
    wanted = {item.object for item in shown}
    objects = tuple(
        obj
        for class_name in dict.fromkeys(name for name, _ in wanted)
        for obj in dataset.objects(class_name, None, count)
        if (obj.class_name, obj.object_id) in wanted
    )
    protocol = Protocol(
        suite=suite,
        dataset=dataset.id,
        methods=(FLOOR,),
        conditions=tuple(dict.fromkeys(item.condition for item in shown if item.condition)),
        objects=objects,
        views=manifest["views"],
        seed=manifest["seed"],
        device=manifest["device"],
        features=(),
        feature_identity={},
        environment={},
    )
    return {job.item._replace(method=""): job for job in plan(protocol, directory).items}


def _read(path: Path) -> NDArray[np.uint8] | None:
    if not zipfile.is_zipfile(path):  # NumPy would leave such a file open
        return None
    try:
        return read_artifact(path)["images"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _sampled(job: Job) -> NDArray[np.float32] | None:
    try:
        return cloud_of(job).points
    except (BadInput, OSError):  # the file has gone, or is another one now
        return None
