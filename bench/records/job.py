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

SCHEMA_VERSION = 5  # of the manifest; others are refused, never guessed at
RECORDS_VERSION = 4  # of what a job gives, in the key of every job and in `records.parquet`

CLAIMED = "times as claimed"  # in the notes of records of images that were drawn elsewhere
GROUND_TRUTH = "ground-truth"  # stands where a method's id stands, in features and images
JOB = ["method", "condition", "class", "object"]  # the columns that name a job
TIMES = ("prepare_s", "draw_s")  # the columns that differ from run to run
SCORES = (
    *("ssim", "luminance", "contrast", "structure", "psnr", "ssim_object"),
    *("silhouette_iou", "thin_recall", "thin_precision", "lpips"),
)
OF_VIEWS = ("azimuth_deg", "elevation_deg", *SCORES)
COLUMNS = (  # of `records.parquet`
    *("suite", *JOB, "view", "azimuth_deg", "elevation_deg", "outcome", "reason", "notes"),
    *(*SCORES, *TIMES),
)
TYPES = {"view": "int32", **dict.fromkeys((*OF_VIEWS, *TIMES), "float64")}  # of all but text


IMAGES = "images"  # beside the ids of extractors, whose features are arrays of a job, too
MOST_BYTES = 512 * MIB  # of an array: ten thousand images


class JobName(NamedTuple):
    """The name of a job in tables and reports; that of a ground truth has no condition."""

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


MOST_TEXT = 10_000  # characters of a reason, or of notes


def stored_text(text: str) -> str:
    """Return a text as every file can hold it: not endless, and without lone surrogates."""
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
    """Return the seconds of stages as manifests have them."""
    return {stage: round(taken, 1) for stage, taken in seconds.items()}


def shares(seconds: Mapping[str, float], available_s: float) -> dict[str, float]:
    """Return the parts of `available_s`, the time of all workers together.

    `seconds` are those of all jobs. Time that no method, metric or rendering has used counts as
    harness: clouds, and workers that start, wait or idle while the tables are made.
    """
    parts = ("methods", "metrics", "rendering")
    named = {part: seconds.get(part, 0.0) / available_s for part in parts}
    return named | {"harness": 1.0 - sum(named.values())}


@dataclass(frozen=True)
class Job:
    """One method on one cloud with all its views; or the ground truth (method GROUND_TRUTH)."""

    key: str  # a digest of everything that the result depends on
    suite: str
    method: str
    condition: str
    perturbation: Perturbation  # the change of the cloud that `condition` is the name of
    object: SceneObject
    views: tuple[View, ...]
    seed: int
    device: str
    features: tuple[tuple[str, str], ...]  # id and weights file of each extractor to run
    reference_key: str | None  # of the ground truth; None where nothing is scored
    address: str = ""  # by which the method is found; "" where that is its id
    batch: int | None = None  # views drawn in one call; None for all of them
    # The packed images of the ground truth, there when the job is handed to a worker.
    reference: bytes | None = field(default=None, repr=False, compare=False)

    @property
    def name(self) -> JobName:
        """Return the name of the job in tables and reports."""
        return JobName(self.method, self.condition, self.object.class_name, self.object.object_id)


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a job."""

    key: str  # of the job
    suite: str = ""
    reason: str = ""  # why there are no images; empty where there are
    notes: str = ""
    prepare_s: float | None = None  # as in the records
    draw_s: float | None = None
    # Directions and scores of the views, by `pack_views`, and packed images and features by name;
    # empty where they are left in the store.
    views: bytes = field(default=b"", repr=False)
    arrays: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    # Why going on with other jobs of this kind makes no sense (a library or weights file is
    # missing); the run ends with this message.
    unusable: str | None = None
    # Seconds of a worker for methods (loading, preparing, drawing), metrics and the rendering of
    # the ground truth; empty for a job of an earlier start, and for one whose worker died.
    timing: Mapping[str, float] = field(default_factory=dict)
    environment: str = ""  # that it was made in, once it is stored, as JSON

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
    """Return the result of a job that gave no images, after so many seconds; None if unknown."""
    draw_s, views = None if taken_s is None else 0.0, pack_views(job.views)
    reason = stored_text(reason) or "no reason given"  # which a stranger's error need not have
    return Result(job.key, job.suite, reason, "", taken_s, draw_s, views)


def pack_views(views: Sequence[View], scores: Mapping[str, Floats] | None = None) -> bytes:
    """Return directions, and scores [V] by column, as float64 [V, OF_VIEWS]; NaN for no score.

    These bytes are a third of JSON that is deflated, and read without being parsed.
    """
    values = np.full((len(views), len(OF_VIEWS)), np.nan, "<f8")
    values[:, :2] = [(view.azimuth_deg, view.elevation_deg) for view in views]
    for name, of_views in (scores or {}).items():
        values[:, OF_VIEWS.index(name)] = np.where(np.isfinite(of_views), of_views, np.nan)
    return values.tobytes()


def pack(array: NDArray[Any]) -> bytes:
    """Return an array as bytes: a .npy file, deflated."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, (1, 0), allow_pickle=False)
    return zlib.compress(buffer.getvalue())


def unpack(data: bytes) -> NDArray[Any]:
    """Return the array in bytes by `pack`.

    Raises BadInput for other bytes, and for an array that would take more memory than the images of
    any job.
    """
    try:
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(data, MOST_BYTES)
        if not unpacking.eof:
            raise ValueError(f"cut short, or of more than {MOST_BYTES // MIB} MiB")
        # A view of the bytes: what the header claims beyond them is refused, and nothing allocated.
        stream = io.BytesIO(content)
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError("of another format")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        values = np.frombuffer(content, dtype, offset=stream.tell())
        return values.reshape(shape, order="F" if fortran else "C").copy()
    except (ValueError, zlib.error) as error:
        raise BadInput(f"no packed array ({error}); start the run again") from error
