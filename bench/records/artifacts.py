"""Files of finished images and features, and what they belong to.

An artifact is a compressed .npz, written whole or not at all by `bench.running.work`: `images`,
uint8 [V, S, S, 3], and one array [V, d] for each feature extractor.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.records.record import GROUND_TRUTH
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole
from data_prep.files.checksums import file_sha256


class Item(NamedTuple):
    """One method on one cloud; of a ground truth the method is GROUND_TRUTH, without condition."""

    method: str
    condition: str
    class_name: str
    object_id: str

    @property
    def truth(self) -> Item:
        """The true images of its object."""
        return Item(GROUND_TRUTH, "", self.class_name, self.object_id)

    @property
    def object(self) -> tuple[str, str]:
        """Class and name."""
        return self.class_name, self.object_id


@dataclass(frozen=True)
class Artifact:
    """The images of an item are in the file `path`."""

    item: Item
    path: Path

    def images(self) -> NDArray[np.uint8]:
        """All views [V, S, S, 3]."""
        return self.array("images")

    def array(self, name: str) -> NDArray[Any]:
        """One of its arrays; the others are not unpacked. Raises KeyError where there is none."""
        with np.load(self.path, allow_pickle=False) as arrays:
            return arrays[name]


def artifact_path(directory: Path, key: str) -> Path:
    """Where the artifact of a job has its place in the directory of a run."""
    return directory / "artifacts" / key[:2] / f"{key}.npz"


def artifact_sha256(path: Path) -> str | None:
    """The checksum of an artifact; None where it cannot be read."""
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


def read_artifact(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an artifact: `images` and one per feature extractor."""
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)
