"""Jobs, their results and the times of their parts: plain values that cross processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field, replace
from typing import Literal

from bench.records.artifacts import JobName
from bench.records.record import Record
from data_prep.clouds.conditions import Perturbation
from data_prep.datasets.objects import SceneObject
from data_prep.scene import View


@dataclass(frozen=True)
class JobTiming:
    """Wall time of a worker on one job, in seconds, by what it went into.

    Attributes
    ----------
    methods : float
        Loading, preparing and drawing.
    metrics : float
        Scores and features.
    rendering : float
        The ground truth.
    harness : float
        The rest: clouds and artifacts.
    """

    methods: float = 0.0
    metrics: float = 0.0
    rendering: float = 0.0
    harness: float = 0.0

    def __add__(self, other: JobTiming) -> JobTiming:
        pairs = zip(astuple(self), astuple(other), strict=True)
        return JobTiming(*(sum(pair) for pair in pairs))


NOTHING = JobTiming()
MOST_TEXT = 10_000  # characters of a reason, or of notes


def stored_text(text: str) -> str:
    """Return a text as every file can hold it: not endless, and without lone surrogates."""
    kept = text if len(text) <= MOST_TEXT else f"{text[:MOST_TEXT]} [...]"
    return kept.encode("utf-8", "backslashreplace").decode()


class Stopwatch:
    """Seconds by the fields of `JobTiming`, since the creation of the stopwatch."""

    def __init__(self, clock: Callable[[], float] | None = None) -> None:
        self._clock = clock or time.perf_counter
        self._start = self._clock()
        self._seconds: dict[str, float] = {}

    @contextmanager
    def on(self, part: str) -> Iterator[None]:
        """Count the time of the block for `part`, also where an exception ends it."""
        start = self._clock()
        try:
            yield
        finally:
            taken = self._clock() - start
            self._seconds[part] = self._seconds.get(part, 0.0) + taken

    def timing(self) -> JobTiming:
        """Return the times so far. Time not counted for a named part is that of the harness."""
        total = self._clock() - self._start
        return JobTiming(**self._seconds, harness=total - sum(self._seconds.values()))


def shares(timing: JobTiming, available_s: float) -> dict[str, float]:
    """Return the parts of `available_s`, the time of all workers together, by `JobTiming`'s fields.

    `timing` is the sum over all jobs. Time that no method, metric or rendering has used counts as
    harness: workers that start, wait or idle while the tables are made.
    """
    named = {
        part: getattr(timing, part) / available_s for part in ("methods", "metrics", "rendering")
    }
    return named | {"harness": 1.0 - sum(named.values())}


@dataclass(frozen=True)
class Job:
    """One method on one cloud with all its views; or the ground truth (method GROUND_TRUTH).

    Attributes
    ----------
    key : str
        A digest of everything that the result depends on.
    perturbation : Perturbation
        The change of the cloud that `condition` is the name of.
    reference_key : str or None
        The key of the ground truth; None where nothing is scored.
    features : tuple of (str, str)
        Id and weights file of each extractor to run.
    address : str
        The text by which the method is found; "" where that is its id.
    batch : int or None
        Views drawn in one call; None for all of them.
    reference : bytes or None
        The artifact of the ground truth; it is there when the job is handed to a worker.
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
    reference_key: str | None
    address: str = ""
    batch: int | None = None
    reference: bytes | None = field(default=None, repr=False, compare=False)

    @property
    def name(self) -> JobName:
        """Return the name of the job in tables and reports."""
        return JobName(self.method, self.condition, self.object.class_name, self.object.object_id)


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a job.

    Attributes
    ----------
    key : str
        The key of the job.
    records : tuple of Record
        One for each view; empty where they are left in the store (`without_contents`).
    artifact_sha256 : str or None
        Checksum of the artifact; None where the job gave no images.
    reason : str
        Why there are no images; empty where there are.
    unusable : str or None
        Why going on with other jobs of this kind makes no sense (a library or weights file is
        missing); the run ends with this message.
    timing : JobTiming
        Zeros for a job of an earlier start, and for one whose worker died.
    artifact : bytes or None
        Images and features, on their way from the worker to the store.
    """

    key: str
    records: tuple[Record, ...]
    artifact_sha256: str | None
    reason: str = ""
    unusable: str | None = None
    timing: JobTiming = NOTHING
    artifact: bytes | None = field(default=None, repr=False)

    @property
    def has_images(self) -> bool:
        """Return whether the job gave images."""
        return self.artifact_sha256 is not None

    def without_contents(self) -> Result:
        """Return the result without records and artifact, which are left in the store."""
        return replace(self, records=(), artifact=None)


def failed(job: Job, reason: str, taken_s: float | None = None) -> Result:
    """Return the result of a job that gave no images, after so many seconds; None if unknown."""
    draw_s, reason = None if taken_s is None else 0.0, stored_text(reason)
    records = records_of(job, "failed", reason=reason, prepare_s=taken_s, draw_s=draw_s)
    return Result(job.key, tuple(records), None, reason)


def records_of(
    job: Job,
    outcome: Literal["ok", "failed"],
    *,
    reason: str = "",
    notes: str = "",
    prepare_s: float | None = None,
    draw_s: float | None = None,
) -> Sequence[Record]:
    """Return the records of a job, one for each view, without scores."""
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
            notes=stored_text(notes),
            prepare_s=prepare_s,
            draw_s=draw_s,
        )
        for i, view in enumerate(job.views)
    ]
