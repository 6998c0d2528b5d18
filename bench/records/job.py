"""Jobs, their results and the columns of their records: plain values that cross processes.

A record is a row of `records.parquet`: one image by a suite, method, condition, object and view.
"""

from __future__ import annotations

import io
import time
import zlib
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats
from data_prep.clouds.conditions import Perturbation
from data_prep.datasets.objects import SceneObject
from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB
from data_prep.scene import View

# The version of the manifest's form; manifests of other versions are refused, never guessed at.
SCHEMA_VERSION = 5
# The version of what a job gives, in the key of every job and in `records.parquet`: raise it when
# that changes, and finished jobs are done again.
RECORDS_VERSION = 4

CLAIMED = "times as claimed"  # the note in records of images that others have drawn
GROUND_TRUTH = "ground-truth"  # what the job that draws the true images has for a method's id
JOB = ["method", "condition", "class", "object"]  # the columns that name a job
# Seconds to prepare a cloud, and to draw a view. These columns alone differ from run to run.
TIMES = ("prepare_s", "draw_s")
SCORES = (
    "ssim",
    "luminance",
    "contrast",
    "structure",
    "psnr",
    "ssim_object",
    "silhouette_iou",
    "thin_recall",
    "thin_precision",
    "lpips",
)
OF_VIEWS = ("azimuth_deg", "elevation_deg", *SCORES)  # the values that each view has
# The columns of `records.parquet`, in their order.
COLUMNS = (
    "suite",
    *JOB,
    "view",
    "azimuth_deg",
    "elevation_deg",
    "outcome",
    "reason",
    "notes",
    *SCORES,
    *TIMES,
)
# The types of the columns; those that are not here are text.
TYPES = {"view": "int32", **dict.fromkeys((*OF_VIEWS, *TIMES), "float64")}


# The name of the images among the arrays of a job; the others, its features, have the ids of their
# extractors.
IMAGES = "images"
MOST_BYTES = 512 * MIB  # the largest array that is read; ten thousand images have 469 MiB


class JobName(NamedTuple):
    """The name of a job in tables and reports; that of a ground truth has no condition."""

    method: str
    condition: str
    class_name: str
    object_id: str

    @property
    def truth(self) -> JobName:
        """Return the name of the job that draws the true images of the same object."""
        return JobName(GROUND_TRUTH, "", self.class_name, self.object_id)

    @property
    def object(self) -> tuple[str, str]:
        """Return the class and the name of the object."""
        return self.class_name, self.object_id


MOST_TEXT = 10_000  # the most characters that are stored of a reason, and of notes


def stored_text(text: str) -> str:
    """Return a text that any file can hold: cut where it is long, and without lone surrogates."""
    kept = text if len(text) <= MOST_TEXT else f"{text[:MOST_TEXT]} [...]"
    return kept.encode("utf-8", "backslashreplace").decode()


@contextmanager
def timed(part: str, seconds: MutableMapping[str, float]) -> Iterator[None]:
    """Add the time of the block to `seconds[part]`, also where an exception ends it."""
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[part] = seconds.get(part, 0.0) + time.perf_counter() - start


def tenths(seconds: Mapping[str, float]) -> dict[str, float]:
    """Return the seconds of stages as manifests have them, rounded to tenths."""
    return {stage: round(taken, 1) for stage, taken in seconds.items()}


def shares(seconds: Mapping[str, float], available_s: float) -> dict[str, float]:
    """Return what part of the workers' time went into methods, metrics, rendering and the harness.

    seconds      the seconds of all jobs, by "methods", "metrics" and "rendering"
    available_s  the time of all workers together

    The harness has the rest: the making of clouds, and the time in which workers start, wait, or
    idle while the tables are made.
    """
    parts = ("methods", "metrics", "rendering")
    named = {part: seconds.get(part, 0.0) / available_s for part in parts}
    return named | {"harness": 1.0 - sum(named.values())}


@dataclass(frozen=True)
class Job:
    """One method on one cloud with all its views; or the ground truth (method GROUND_TRUTH)."""

    key: str  # a checksum of everything that the result depends on
    suite: str
    method: str
    condition: str
    perturbation: Perturbation  # the change of the cloud that the condition stands for
    object: SceneObject
    views: tuple[View, ...]
    seed: int
    device: str
    # The id and the weights file of each extractor whose features are taken of the images.
    features: tuple[tuple[str, str], ...]
    reference_key: str | None  # the key of the ground truth's job; None where nothing is scored
    address: str = ""  # the address by which the method is found; "" where that is its id
    batch: int | None = None  # how many views are drawn in one call; None for all of them
    # The packed images of the ground truth. A job gets them when it is handed to a worker.
    reference: bytes | None = field(default=None, repr=False, compare=False)

    @property
    def name(self) -> JobName:
        """Return the name of the job in tables and reports."""
        return JobName(self.method, self.condition, self.object.class_name, self.object.object_id)


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a job."""

    key: str  # the key of the job
    suite: str = ""
    reason: str = ""  # why the job gave no images; "" where it gave them
    notes: str = ""  # what the method says about its repairs of the cloud
    prepare_s: float | None = None  # seconds for the cloud; None where unknown
    draw_s: float | None = None  # seconds for an image; None where unknown
    # The directions and scores of the views, packed by `pack_views`; empty where they are left in
    # the store.
    views: bytes = field(default=b"", repr=False)
    # The packed images (IMAGES) and the packed features by the ids of their extractors; empty where
    # they are left in the store.
    arrays: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    # Why other jobs would fail, too, as where a library or a weights file is missing. The run ends
    # with this message.
    unusable: str | None = None
    # The seconds of a worker for "methods" (loading, preparing, drawing), "metrics" and
    # "rendering" (of the ground truth). It is empty for a job that was done before this start of
    # the run, and for one whose worker died.
    timing: Mapping[str, float] = field(default_factory=dict)
    environment: str = ""  # where it is stored: the environment that it was made in, as JSON

    @property
    def has_images(self) -> bool:
        """Return whether the job gave images."""
        return not self.reason

    @property
    def count(self) -> int:
        """Return the number of views."""
        return len(self.views) // (8 * len(OF_VIEWS))

    @property
    def of_views(self) -> dict[str, Floats]:
        """Return the values [V] of the views by the names in OF_VIEWS; NaN where there is none."""
        values = np.frombuffer(self.views, "<f8").reshape(-1, len(OF_VIEWS))
        return dict(zip(OF_VIEWS, values.T, strict=True))


def failed(job: Job, reason: str, taken_s: float | None = None) -> Result:
    """Return the result of a job that gave no images.

    reason   why; an error of a method by others may have no text
    taken_s  the seconds until it failed, which count as those for the cloud; None where unknown
    """
    return Result(
        key=job.key,
        suite=job.suite,
        reason=stored_text(reason) or "no reason given",
        prepare_s=taken_s,
        draw_s=None if taken_s is None else 0.0,
        views=pack_views(job.views),
    )


def pack_views(views: Sequence[View], scores: Mapping[str, Floats] | None = None) -> bytes:
    """Return the directions and scores of views as the bytes of a float64 array [V, OF_VIEWS].

    scores  float64 [V] by the names in SCORES; a missing score, and one that is not finite, is NaN

    These bytes take a third of what compressed JSON takes, and are read without being parsed.
    """
    values = np.full((len(views), len(OF_VIEWS)), np.nan, "<f8")
    values[:, :2] = [(view.azimuth_deg, view.elevation_deg) for view in views]
    for name, of_views in (scores or {}).items():
        values[:, OF_VIEWS.index(name)] = np.where(np.isfinite(of_views), of_views, np.nan)
    return values.tobytes()


def pack(array: NDArray[Any]) -> bytes:
    """Return an array as bytes: those of a .npy file, compressed by zlib."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, (1, 0), allow_pickle=False)
    return zlib.compress(buffer.getvalue())


def unpack(data: bytes) -> NDArray[Any]:
    """Return the array that `pack` has made these bytes of.

    Raises BadInput for other bytes, and for an array of more than MOST_BYTES, which no job gives.
    """
    try:
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(data, MOST_BYTES)
        if not unpacking.eof:
            raise ValueError(f"cut short, or of more than {MOST_BYTES // MIB} MiB")
        # The array is made of the bytes that are there: where the header claims more of them, it is
        # refused before any memory is allocated for it.
        stream = io.BytesIO(content)
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError("of another format")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        values = np.frombuffer(content, dtype, offset=stream.tell())
        return values.reshape(shape, order="F" if fortran else "C").copy()
    except (ValueError, zlib.error) as error:
        raise BadInput(f"no packed array ({error}); start the run again") from error
