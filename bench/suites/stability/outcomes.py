"""Outcomes of the suite `stability`: observations of each method, and their verdicts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrics.silhouette import foreground
from bench.records.artifacts import unpack_images
from bench.records.job import Job
from bench.records.store import Store
from bench.suites.stability.cases import CASES
from bench.suites.stability.expectations import (
    ROUNDED_MEAN,
    Agrees,
    Changes,
    Draws,
    Either,
    Expectation,
    Fails,
    Kind,
    NoExpectation,
    expectation,
    in_words,
)


@dataclass(frozen=True)
class Observation:
    """The result of one method on one case, as small values from records and images.

    reason         why the method drew no images; empty where it drew them
    notes          repairs by the method on its way
    shown          share of the pixels that are not white, mean over the views; None without images
    mean_change    mean absolute difference to the images of the case's `like`, in grey levels
                   0..255; None without `like`, or without images of either
    most_change    largest absolute difference to them
    prepare_s, draw_s  as in a record; None without images
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


def observe(jobs: Sequence[Job], store: Store) -> list[Observation]:
    """Return an observation for each job, in their order; the store has all of them."""
    first = {job.key: store.records(job.key)[0] for job in jobs}
    drawn = {(job.method, job.condition): job for job in jobs if first[job.key].outcome == "ok"}
    likes = {case.id: case.like for case in CASES}
    observations = []
    for job in jobs:
        record = first[job.key]
        shown = mean = most = None
        if (job.method, job.condition) in drawn:
            images = unpack_images(store.artifact(job.key))
            shown = float(foreground(images).mean())
            other = drawn.get((job.method, likes[job.condition] or ""))
            if other is not None:
                like = unpack_images(store.artifact(other.key))
                # A case may have more views than its `like`, which is repeated then.
                counterpart = like[np.arange(len(images)) % len(like)]
                difference = np.abs(images.astype(np.int16) - counterpart)
                mean, most = float(difference.mean()), int(difference.max())
        observations.append(
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
    return observations


@dataclass(frozen=True)
class CaseOutcome:
    """The verdict on one case of one method, which is a cell of a matrix of cases and methods.

    case      kebab-case id
    group     kind of case, such as "outlier"; the cases of a group follow each other
    subject   the method
    expected  in words: a value with its tolerance, an invariant, or a named failure
    observed  in words; compared with `expected`
    kind      the verdict, see `KINDS`
    """

    case: str
    group: str
    subject: str
    expected: str
    observed: str
    kind: Kind


def outcome(observation: Observation) -> CaseOutcome:
    """Return the verdict on one observation."""
    case = next(case for case in CASES if case.id == observation.case)
    expected = expectation(observation.method, case)
    return CaseOutcome(
        case=case.id,
        group=case.group,
        subject=observation.method,
        expected=in_words(expected, case.like),
        observed=_observed_in_words(observation),
        kind=verdict(expected, observation),
    )


def verdict(expected: Expectation, observed: Observation) -> Kind:
    """Return whether an observation is as expected."""
    change = observed.mean_change
    match expected:
        case Fails():
            fits = observed.reason and re.match(expected.reason, observed.reason)
            return expected.kind if fits else "unexpected"
        case Either():
            for option in expected.options:
                if (kind := verdict(option, observed)) != "unexpected":
                    return kind
            return "unexpected"
        case NoExpectation() if observed.reason:
            return "refused" if names_stage(observed.reason) else "unexpected"
        case NoExpectation():
            return "holds" if change is None or change <= ROUNDED_MEAN else "differs"
        case _ if observed.reason:
            return "unexpected"
        case Draws():
            return "holds"
        case Agrees():
            agrees = change is not None and change <= expected.mean
            if expected.most is not None:
                agrees &= observed.most_change is not None and observed.most_change <= expected.most
            return "holds" if agrees else "unexpected"
        case Changes():
            return "differs" if change is not None and change > expected.mean else "unexpected"


def names_stage(reason: str) -> bool:
    """Return whether the reason of a failure names a stage of the method."""
    # A stage is named in kebab-case; Python's exceptions and lost workers are no stages.
    return re.match(r"(?!timeout|memory|crash)[a-z][a-z0-9-]*: ", reason) is not None


def _observed_in_words(observed: Observation) -> str:
    if observed.reason:
        return f"failed: {observed.reason}"
    words = f"images, {100 * (observed.shown or 0):.1f} % not white"
    if observed.mean_change is not None:
        words += f"; change {observed.mean_change:.3g}, at most {observed.most_change}"
    return f"{words}; {observed.notes}" if observed.notes else words
