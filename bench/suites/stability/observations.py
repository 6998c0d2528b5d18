"""What the methods made of the cases: small values, taken from records and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.metrics.foreground import foreground
from bench.running.work import Job, Result
from bench.suites.stability.cases import CASES


@dataclass(frozen=True)
class Observation:
    """One method on one case.

    reason         why there are no pictures; empty where there are
    notes          what the method mended on its way
    shown          share of the pixels that are not white, mean over the views; None without
    mean_change    mean absolute difference to the pictures of the case it should be like, in grey
                   levels 0..255; None where there is none, or no pictures of either
    most_change    the largest
    prepare_s, draw_s  as in a record; None without pictures
    """

    case: str
    method: str
    reason: str
    notes: str
    shown: float | None
    mean_change: float | None
    most_change: int | None
    prepare_s: float | None
    draw_s: float | None


def observe(jobs: Sequence[Job], result: Callable[[str], Result]) -> list[Observation]:
    """An observation for each job, in their order; `result` gives that of a key."""
    first = {job.key: result(job.key).records[0] for job in jobs}
    drawn = {(job.method, job.condition): job for job in jobs if first[job.key].outcome == "ok"}
    likes = {case.id: case.like for case in CASES}
    observed = []
    for job in jobs:
        record = first[job.key]
        shown = mean = most = None
        if (job.method, job.condition) in drawn:
            pictures = _pictures(job)
            shown = float(foreground(pictures).mean())
            other = drawn.get((job.method, likes[job.condition] or ""))
            if other is not None:
                mean, most = _change(pictures, _pictures(other))
        observed.append(
            Observation(
                case=job.condition,
                method=job.method,
                reason=record.reason,
                notes=record.notes,
                shown=shown,
                mean_change=mean,
                most_change=most,
                prepare_s=record.prepare_s,
                draw_s=record.draw_s,
            )
        )
    return observed


def _change(pictures: NDArray[np.uint8], like: NDArray[np.uint8]) -> tuple[float, int]:
    """Mean and largest absolute difference; `like` is gone through again where it is shorter."""
    counterpart = like[np.arange(len(pictures)) % len(like)]
    difference = np.abs(pictures.astype(np.int16) - counterpart)
    return float(difference.mean()), int(difference.max())


def _pictures(job: Job) -> NDArray[np.uint8]:
    return job.made.pictures()
