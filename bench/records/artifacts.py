"""Artifacts: the files of the images and features that jobs have drawn.

An artifact is a compressed .npz: `images`, uint8 [V, S, S, 3], and an array [V, d] for each feature
extractor. It is written whole or not at all by `bench.running.work`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.records.record import GROUND_TRUTH
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole
from data_prep.files.checksums import file_sha256


class JobName(NamedTuple):
    """The name of a job in tables and reports: one method on one cloud.

    The method of a ground truth is GROUND_TRUTH; it has no condition.
    """

    method: str
    condition: str
    class_name: str
    object_id: str

    @property
    def truth(self) -> JobName:
        """Return the name of the ground truth of its object."""
        return JobName(GROUND_TRUTH, "", self.class_name, self.object_id)

    @property
    def object(self) -> tuple[str, str]:
        """Return class and name of its object."""
        return self.class_name, self.object_id


def artifact_path(directory: Path, key: str) -> Path:
    """Return the place of a job's artifact in the directory of a run."""
    return directory / "artifacts" / key[:2] / f"{key}.npz"


def artifact_sha256(path: Path) -> str | None:
    """Return the checksum of an artifact; None where it cannot be read."""
    try:
        return file_sha256(path)
    except (BadInput, OSError):
        return None


def write_artifact(path: Path, data: bytes) -> None:
    """Write an artifact, whole or not at all. Raises CannotWrite: the run stops, and may go on."""
    try:
        write_whole(path, data)
    except OSError as error:
        raise CannotWrite(
            f"{path}: cannot be written ({error.strerror}); make room and run again"
        ) from error


def read_array(path: Path, name: str = "images") -> NDArray[Any]:
    """Return one array of an artifact; the others are not unpacked.

    Raises KeyError for an array that it does not have.
    """
    with np.load(path, allow_pickle=False) as arrays:
        return arrays[name]
