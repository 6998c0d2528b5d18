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
from data_prep.files.safe_read import MIB

MOST_BYTES = 512 * MIB  # of an array: ten thousand images
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

    Raises KeyError for an array that it does not have, and BadInput for bytes that are no artifact,
    or would take more memory than the images of any job.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(artifact)) as archive:
            return {name: _array(archive, f"{name}.npy") for name in names}
    except (ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise BadInput(f"an artifact that is no .npz ({error}); start the run again") from error


def _array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    with archive.open(name) as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{name} of more than {MOST_BYTES // MIB} MiB")
    # A view of the bytes: what the header claims beyond them is refused, and nothing is allocated.
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{name} of another format")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    values = np.frombuffer(data, dtype, offset=stream.tell())
    return values.reshape(shape, order="F" if fortran else "C").copy()
