"""The images of a run in a folder by the names of its jobs, read when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.records.job import IMAGES, JobName, unpack
from bench.records.store import JobRow, open_store
from data_prep.failures import BadInput


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


class StoredArtifacts(Mapping[JobName, Artifact]):
    """The artifacts of the complete run in a folder by the names of its jobs, in its order."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def __getitem__(self, name: JobName) -> Artifact:
        with open_store(self._directory) as store:
            key = store.key_of(name)
        if key is None:
            raise KeyError(name)
        return Artifact(self._directory, key)

    def __iter__(self) -> Iterator[JobName]:
        with open_store(self._directory) as store:
            yield from (job.name for job in store.listed() if job.has_images)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def read_jobs(directory: Path) -> list[JobRow]:
    """Return the jobs of the complete run in a folder, in the order of its plan."""
    with open_store(directory) as store:
        return [*store.listed()]
