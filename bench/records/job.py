"""A job, its result, and the times of its parts: plain values that cross processes."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bench.records.artifacts import Artifact, Item
from bench.records.record import Record
from data_prep.clouds.conditions import Perturbation
from data_prep.datasets.objects import SceneObject
from data_prep.scene import View


@dataclass(frozen=True)
class JobTiming:
    """Wall time of a worker on one job, in seconds, by what it went into.

    methods    loading, preparing, drawing
    metrics    scores and features
    rendering  the ground truth
    harness    the rest: clouds, artifacts
    """

    methods: float = 0.0
    metrics: float = 0.0
    rendering: float = 0.0
    harness: float = 0.0


NOTHING = JobTiming()


class Stopwatch:
    """Seconds by the fields of `JobTiming`, since it was made."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._seconds: dict[str, float] = {}

    @contextmanager
    def on(self, part: str) -> Iterator[None]:
        """Within, time goes to `part`, also where an exception ends it."""
        start = time.perf_counter()
        try:
            yield
        finally:
            taken = time.perf_counter() - start
            self._seconds[part] = self._seconds.get(part, 0.0) + taken

    def timing(self) -> JobTiming:
        """What went nowhere by name, went into the harness."""
        total = time.perf_counter() - self._start
        return JobTiming(**self._seconds, harness=total - sum(self._seconds.values()))


def shares(timing: Iterable[JobTiming], available_s: float) -> dict[str, float]:
    """Parts of 1 by the fields of `JobTiming`, of the seconds that all workers together had.

    What no method, metric or rendering has used counts as harness: workers that start, wait or
    idle while the tables are made.
    """
    every = list(timing)
    named = {
        part: sum(getattr(one, part) for one in every) / available_s
        for part in ("methods", "metrics", "rendering")
    }
    return named | {"harness": 1.0 - sum(named.values())}


@dataclass(frozen=True)
class Job:
    """One method on one cloud with all its views; or the ground truth (method GROUND_TRUTH).

    key           names everything that the result depends on
    perturbation  what `condition` is the name of
    artifact      where images and features go
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

    @property
    def item(self) -> Item:
        """What it draws."""
        return Item(self.method, self.condition, self.object.class_name, self.object.object_id)

    @property
    def made(self) -> Artifact:
        """What it leaves behind where it ends well."""
        return Artifact(self.item, self.artifact)


@dataclass(frozen=True)
class Result:
    """What became of a job. `artifact_sha256` is None where there are no images.

    `timing` is zeros for a job that was done by an earlier start, or whose worker died.
    `unusable` is set where going on with other jobs of its kind makes no sense (a library or
    weights file is missing): the run ends with this message.
    """

    key: str
    records: tuple[Record, ...]
    artifact_sha256: str | None
    unusable: str | None = None
    timing: JobTiming = NOTHING


def failed(job: Job, reason: str) -> Result:
    """The result of a job that gave no images."""
    return Result(job.key, tuple(records_of(job, "failed", reason=reason)), None)


def records_of(
    job: Job,
    outcome: Literal["ok", "failed"],
    *,
    reason: str = "",
    notes: str = "",
    prepare_s: float | None = None,
    draw_s: float | None = None,
) -> Sequence[Record]:
    """The records of a job, one a view, without scores."""
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
            prepare_s=prepare_s,
            draw_s=draw_s,
        )
        for i, view in enumerate(job.views)
    ]
