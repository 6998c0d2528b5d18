"""What a worker does: draw the ground truth of an object, or take one method over one cloud.

Jobs and their results are plain values that cross process boundaries. A job writes its pictures and
features into an artifact (a compressed .npz, written whole or not at all) and returns the records;
whether they count is decided by whoever keeps the journal.
"""

from __future__ import annotations

import functools
import io
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.methods import FLOORS, find_method
from bench.metric_table import Extractor, find_extractor
from bench.record import GROUND_TRUTH, Record
from bench.scores import scores
from data_prep.conditions import Perturbation
from data_prep.datasets import SceneObject
from data_prep.failures import BadInput, CannotWrite, MissingDependency, StageFailure
from data_prep.images import to_uint8
from data_prep.randomness import generator
from data_prep.sampling import sample_surface
from data_prep.scene import IMAGE_SIZE, PointCloud, Renderer, View

Pictures = NDArray[np.uint8]  # [V, IMAGE_SIZE, IMAGE_SIZE, 3]


@dataclass(frozen=True)
class Job:
    """One method on one cloud with all its views; or the ground truth (method GROUND_TRUTH).

    key           names everything that the result depends on
    perturbation  what `condition` is the name of
    artifact      where pictures and features go
    reference     the artifact of the ground truth; None where nothing is scored
    features      (id, weights file) of the extractors to run
    batch         views drawn in one call; None: all of them
    """

    key: str
    suite: str
    method: str
    condition: str
    perturbation: Perturbation
    object: SceneObject
    views: tuple[View, ...]
    seed: int
    device: str
    features: tuple[tuple[str, str], ...]
    artifact: Path
    reference: Path | None
    batch: int | None = None


@dataclass(frozen=True)
class Result:
    """What became of a job. `artifact_sha256` is None where there are no pictures.

    `unusable` is set where going on with other jobs of its kind makes no sense (a library or
    weights file is missing): the run ends with this message.
    """

    key: str
    records: tuple[Record, ...]
    artifact_sha256: str | None
    unusable: str | None = None


def do(job: Job) -> Result:
    """Carry out a job. Whatever a method raises becomes failed records with the reason."""
    try:
        if job.method == GROUND_TRUTH:
            return _draw_ground_truth(job)
        return _run_method(job)
    except (MissingDependency, CannotWrite) as error:
        return replace(failed(job, str(error)), unusable=str(error))
    except BadInput as error:
        return failed(job, f"input: {error}")
    except StageFailure as error:
        return failed(job, str(error))
    except MemoryError as error:  # refused at once: nothing was used up yet
        return failed(job, f"memory: {_first_line(error)}")
    except (Exception, SystemExit) as error:  # a method may call exit(); the run goes on
        return failed(job, f"{type(error).__name__}: {_first_line(error)}")


def failed(job: Job, reason: str) -> Result:
    """The result of a job that gave no pictures."""
    return Result(job.key, tuple(_records(job, "failed", reason=reason)), None)


def read_artifact(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an artifact: `images` and one per feature extractor."""
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)


def _draw_ground_truth(job: Job) -> Result:
    from data_prep.render import render

    pictures = render(job.object.load(), job.views)
    sha = _write_artifact(job, pictures)
    return Result(job.key, tuple(_records(job, "ok")), sha)


def _first_line(error: BaseException) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else "no message"


def _run_method(job: Job) -> Result:
    method = find_method(job.method)
    try:
        renderer = _renderer(job.method, job.device)
    except BadInput as error:  # unusable weights fail every item alike
        return replace(failed(job, str(error)), unusable=str(error))
    truth = None if job.reference is None else read_artifact(job.reference)["images"]
    cloud = _cloud(job)
    if not method.sees_mesh:
        cloud = PointCloud(cloud.points)
    rng = generator(job.seed, "method", job.method, job.condition, *_identity(job))
    start = time.perf_counter()
    state = renderer.prepare(cloud, rng)
    prepared = time.perf_counter()
    batches = _batches(job)
    drawn = [renderer.draw(state, views, rng) for views in batches]
    done = time.perf_counter()
    pictures = np.concatenate(
        [_checked(images, len(views)) for images, views in zip(drawn, batches, strict=True)]
    )
    if job.method not in FLOORS:
        _refuse_blank(pictures, truth)
    records = _records(
        job,
        "ok",
        notes="; ".join(getattr(state, "notes", ())),
        prepare_s=prepared - start,
        draw_s=(done - prepared) / len(job.views),
    )
    if truth is not None:
        scored = scores(truth, pictures)
        records = [
            replace(record, **{name: _or_none(values[i]) for name, values in scored.items()})
            for i, record in enumerate(records)
        ]
    sha = _write_artifact(job, pictures)
    return Result(job.key, tuple(records), sha)


def _batches(job: Job) -> list[tuple[View, ...]]:
    if job.batch is None:
        return [job.views]
    return [job.views[i : i + job.batch] for i in range(0, len(job.views), job.batch)]


def _refuse_blank(pictures: Pictures, truth: Pictures | None) -> None:
    """Raises StageFailure where a picture is of one colour throughout, unless the true one is.

    A renderer that has lost its context gives such, and so does one that looks the wrong way;
    as the picture of an object it is none.
    """
    flat = _is_flat(pictures)
    if truth is not None:
        flat &= ~_is_flat(truth)
    if flat.any():
        raise StageFailure("draw", f"{int(flat.sum())} of {len(flat)} pictures are blank")


def _is_flat(pictures: Pictures) -> NDArray[np.bool_]:
    return (pictures == pictures[:, :1, :1]).all(axis=(1, 2, 3))


def _or_none(score: np.float64) -> float | None:
    return float(score) if np.isfinite(score) else None


def _cloud(job: Job) -> PointCloud:
    """The perturbed cloud. It depends on seed, object and condition, never on the method."""
    sampled = sample_surface(job.object.load(), generator(job.seed, "cloud", *_identity(job)))
    return job.perturbation.apply(sampled, generator(job.seed, job.condition, *_identity(job)))


def _identity(job: Job) -> tuple[str, str]:
    return job.object.class_name, job.object.object_id


def _checked(images: NDArray[np.float32], count: int) -> Pictures:
    expected = (count, IMAGE_SIZE, IMAGE_SIZE, 3)
    if not isinstance(images, np.ndarray) or images.dtype.kind != "f":
        found = getattr(images, "dtype", type(images).__name__)
        raise StageFailure("draw", f"pictures are {found}, expected float32 in [0, 1]")
    if images.shape != expected:
        raise StageFailure("draw", f"pictures of shape {images.shape}, expected {expected}")
    bad = int((~np.isfinite(images)).sum())
    if bad:
        raise StageFailure("draw", f"{bad} pixel values are not finite")
    return to_uint8(images)


def _write_artifact(job: Job, pictures: Pictures) -> str:
    arrays: dict[str, NDArray[Any]] = {"images": pictures}
    for extractor, weights in job.features:
        arrays[extractor] = _extractor(extractor, weights)(pictures)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    try:
        write_whole(job.artifact, data)
    except OSError as error:  # no fault of the method: the run has to stop, and can go on later
        raise CannotWrite(
            f"{job.artifact}: cannot be written ({error.strerror}); make room and run again"
        ) from error
    return sha256(data).hexdigest()


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all, also after a power cut."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Put on disk which files a folder has: a new file's own fsync does not."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _records(
    job: Job,
    outcome: Literal["ok", "failed"],
    *,
    reason: str = "",
    notes: str = "",
    prepare_s: float | None = None,
    draw_s: float | None = None,
) -> Sequence[Record]:
    return [
        Record(
            suite=job.suite,
            method=job.method,
            condition=job.condition,
            class_name=job.object.class_name,
            object=job.object.object_id,
            view=i,
            azimuth_deg=view.azimuth_deg,
            elevation_deg=view.elevation_deg,
            outcome=outcome,
            reason=reason,
            notes=notes,
            ssim=None,
            luminance=None,
            contrast=None,
            structure=None,
            ssim_object=None,
            thin_recall=None,
            thin_precision=None,
            prepare_s=prepare_s,
            draw_s=draw_s,
        )
        for i, view in enumerate(job.views)
    ]


@functools.cache
def _renderer(method: str, device: str) -> Renderer:
    return find_method(method).load(device)


@functools.cache
def _extractor(name: str, weights: str) -> Extractor:
    return find_extractor(name).load(weights)
