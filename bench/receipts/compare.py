"""The comparison of results in a run's store with those of the same jobs computed again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.metrics import column
from bench.checking.tolerances import OBJECT_RENDERING, object_tolerance
from bench.receipts.digests import SCORED, job_title, unpack_all
from bench.records.artifacts import IMAGES
from bench.records.job import Job
from bench.records.record import GROUND_TRUTH, Record
from bench.records.store import Store

SCORES = {column(metric): metric for metric in OBJECT_RENDERING}


@dataclass(frozen=True)
class StoredJob:
    """The results of a job: its records, and its arrays by name, none where it failed."""

    records: list[Record]
    arrays: dict[str, Any]


def read_job(store: Store, key: str) -> StoredJob:
    """Return the results of a job.

    Raises KeyError for a job that is not in the store, and BadInput where it has changed.
    """
    records = store.records(key)
    has_images = store.find([key])[key].has_images
    return StoredJob(records, unpack_all(store.artifact(key)) if has_images else {})


def compare_job(job: Job, stored: StoredJob, here: StoredJob, same_environment: bool) -> list[str]:
    """Return a line for each metric of a job that differs from the value computed here.

    In the same environment records, images and features have to be equal. In another one the means
    over the views of the object may differ by the tolerances of golden values, and true images are
    compared by `bench.receipts.rescore`.
    """
    title = job_title(job.name)
    if len(stored.records) != len(here.records):
        return [f"{title}: {len(stored.records)} records in the run, {len(here.records)} here"]
    if outcome := _other_outcome(stored.records, here.records):
        return [f"{title}: {outcome}"]
    if not same_environment:
        if job.method == GROUND_TRUTH:
            return []
        return [f"{title}: {line}" for line in _beyond_tolerance(job, stored, here)]
    lines = _other_records(stored.records, here.records)
    for name in sorted(stored.arrays.keys() | here.arrays.keys()):
        difference = _array_difference(name, stored.arrays.get(name), here.arrays.get(name))
        lines += [difference] if difference else []
    return [f"{title}: {line}" for line in lines]


def _other_outcome(stored: Sequence[Record], here: Sequence[Record]) -> str:
    for was, now in zip(stored, here, strict=True):
        if was.outcome != now.outcome:
            told = [r.outcome + f" ({r.reason})" * bool(r.reason) for r in (was, now)]
            return f"view {was.view} {told[0]} in the run, {told[1]} here"
    return ""


def _other_records(stored: Sequence[Record], here: Sequence[Record]) -> list[str]:
    """Return a line for each field that differs, with the view where it differs most."""
    lines = []
    for field in SCORED:
        pairs = [(getattr(a, field), getattr(b, field)) for a, b in zip(stored, here, strict=True)]
        other = [(number, *pair) for number, pair in enumerate(pairs) if pair[0] != pair[1]]
        if not other:
            continue
        view, was, now = max(other, key=lambda triple: _distance(*triple[1:]))
        by = _distance(was, now)
        move = f", by {by:.3g}" if 0 < by < math.inf else ""
        views = f"{len(other)} of {len(pairs)} views, most view {view}"
        lines.append(f"{SCORES.get(field, field)} {was} in the run, {now} here{move} ({views})")
    return lines


def _distance(was: object, now: object) -> float:
    if isinstance(was, int | float) and isinstance(now, int | float):
        return abs(now - was)
    return math.inf


def _array_difference(
    name: str, stored: NDArray[np.generic] | None, here: NDArray[np.generic] | None
) -> str:
    """Return how an array differs from that computed here; empty where both are equal."""
    title = name if name == IMAGES else f"features of {name}"
    if stored is None or here is None:
        return f"{title}: only {'here' if stored is None else 'in the run'}"
    if (stored.dtype, stored.shape) != (here.dtype, here.shape):
        return f"{title}: {stored.dtype} {list(stored.shape)} in the run, {list(here.shape)} here"
    if np.array_equal(stored, here):
        return ""
    moves = np.abs(stored.astype(np.float64) - here.astype(np.float64))
    views = int((moves.reshape(len(moves), -1).max(axis=1) != 0).sum())
    unit = " levels of 255" if name == IMAGES else ""
    return f"{title} of {views} of {len(moves)} views differ, by up to {moves.max():.3g}{unit}"


def _beyond_tolerance(job: Job, stored: StoredJob, here: StoredJob) -> list[str]:
    """Return a line for each mean over the views that differs by more than another environment."""
    lines = []
    for field, metric in SCORES.items():
        was, now = (_mean([getattr(r, field) for r in s.records]) for s in (stored, here))
        allowed = object_tolerance(job.method, metric, same_environment=False)
        if abs(was - now) <= allowed or (math.isnan(was) and math.isnan(now)):
            continue
        lines.append(
            f"{metric} {was:.6f} in the run, {now:.6f} here, by {abs(was - now):.3g}, "
            f"allowed {allowed:g}"
        )
    return lines


def _mean(values: Sequence[float | None]) -> float:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else math.nan
