"""Outcomes of the suite `stability`: observations of each method, and their verdicts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.silhouette import foreground
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.artifacts import unpack_images
from bench.records.job import Job
from bench.records.store import Store
from bench.suites.stability.cases import CASES, Case
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
from data_prep.arrays import Floats
from data_prep.scene import UInt8Images


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
    ssim_change, lpips_change  largest change of the score against the true images, mean over the
                   views, in a repetition of the case; None without repetitions
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
    ssim_change: float | None = None
    lpips_change: float | None = None


def observe(jobs: Sequence[Job], store: Store) -> list[Observation]:
    """Return an observation for each method and case, in their order; the store has all jobs."""
    case_of = {condition: case for case in CASES for condition in case.conditions}
    repetitions: dict[tuple[str, Case], list[Job]] = {}
    for job in jobs:
        repetitions.setdefault((job.method, case_of[job.condition]), []).append(job)
    # The first failure of several stands for them.
    records = {
        key: min((store.records(job.key)[0] for job in group), key=lambda r: r.outcome == "ok")
        for key, group in repetitions.items()
    }
    drawn = {
        (method, case.id): group
        for (method, case), group in repetitions.items()
        if records[method, case].outcome == "ok"
    }
    observations = []
    for (method, case), record in records.items():
        shown = mean = most = ssim = lpips = None
        if (method, case.id) in drawn:
            images = _images(drawn[method, case.id], store)
            shown = float(foreground(images).mean())
            if others := drawn.get((method, case.like or "")):
                like = _images(others, store)
                # A case may have more images than its `like`, which is repeated then.
                counterpart = like[np.arange(len(images)) % len(like)]
                difference = np.abs(images.astype(np.int16) - counterpart)
                mean, most = float(difference.mean()), int(difference.max())
                if case.repetitions > 1:
                    ssim, lpips = _score_changes(others[0], like, images)
        observations.append(
            Observation(
                case=case.id,
                method=method,
                reason=record.reason,
                notes=record.notes,
                shown=shown,
                mean_change=mean,
                most_change=most,
                prepare_s=record.prepare_s,
                draw_s=record.draw_s,
                ssim_change=ssim,
                lpips_change=lpips,
            )
        )
    return observations


def _images(jobs: Sequence[Job], store: Store) -> UInt8Images:
    return np.concatenate([unpack_images(store.artifact(job.key)) for job in jobs])


def _score_changes(job: Job, like: UInt8Images, images: UInt8Images) -> tuple[float, float | None]:
    """Return the largest changes of SSIM and LPIPS from `like`; no LPIPS without its package."""
    from bench.metrics.lpips_network import lpips  # imports torch

    drawn = np.concatenate([like, images])
    truth = np.resize(job.object.truth(job.views), drawn.shape)

    def largest_change(scores: Floats) -> float:
        values = scores.reshape(-1, len(like)).mean(axis=1)
        return float(np.abs(values - values[0]).max())

    ssim = largest_change(ssim_per_image(truth, drawn).ssim)
    try:
        return ssim, largest_change(lpips(truth, drawn, single=True))
    except WeightsUnavailable:
        return ssim, None


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
    if observed.ssim_change is not None:
        words += f"; ssim moves by up to {observed.ssim_change:.2g}"
    if observed.lpips_change is not None:
        words += f", lpips by {observed.lpips_change:.2g}"
    return f"{words}; {observed.notes}" if observed.notes else words
