"""Artifacts: the images and features that a job has drawn.

An artifact is the bytes of a compressed .npz: `images`, uint8 [V, S, S, 3], and an array [V, d] for
each feature extractor. The store of a run (`bench.records.store`) keeps it under the job's key.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.records.record import GROUND_TRUTH
from data_prep.failures import BadInput

IMAGES = "images"  # the array of them


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


def unpack_images(artifact: bytes) -> NDArray[np.uint8]:
    """Return the images [V, S, S, 3] of an artifact. Raises BadInput as `unpack`."""
    return unpack(artifact)[IMAGES]


def pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return an artifact of these arrays."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def unpack(artifact: bytes, names: Sequence[str] = (IMAGES,)) -> dict[str, NDArray[Any]]:
    """Return some arrays of an artifact; the others are not unpacked.

    Raises KeyError for an array that it does not have, and BadInput for bytes that are no artifact.
    """
    try:
        with np.load(io.BytesIO(artifact), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in names}
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise BadInput(f"an artifact that is no .npz ({error}); start the run again") from error
