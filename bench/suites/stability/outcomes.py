"""Outcomes of the suite `stability`: observations of each method, their verdicts, the matrix."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.silhouette import foreground
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.job import Job, unpack
from bench.records.store import Store
from bench.suites.stability.cases import CASES
from bench.suites.stability.expectations import (
    KINDS,
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
from bench.tables.grid import BOLD, Block, Cell, grid
from bench.tables.markdown import cell
from bench.tables.table import Table
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images


class Observation(NamedTuple):
    """The result of one method on one case, as small values from records and images."""

    case: str
    method: str
    reason: str  # why the method drew no images; empty where it drew them
    notes: str  # what the method says that it did to the points, such as leaving some out
    shown: float | None = None  # share of the pixels that are not white; None without images
    # The absolute differences between these images and those of the case named as `like`, in grey
    # levels 0..255: their mean and their maximum. None where the case names none, or where images
    # of either case are missing.
    mean_change: float | None = None
    most_change: int | None = None
    prepare_s: float | None = None  # seconds for preparing the cloud
    draw_s: float | None = None  # seconds for drawing all views
    # By how much the scores against the true images, means over the views, change at most in a
    # repetition of the case; None for cases without repetitions.
    ssim_change: float | None = None
    lpips_change: float | None = None


def observe(jobs: Sequence[Job], store: Store) -> list[Observation]:
    """Return an observation for each method and case, in the order of the jobs.

    The store has to hold the results of all jobs.
    """
    case_of = {condition: case for case in CASES for condition in case.conditions}
    repetitions: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        repetitions.setdefault((job.method, case_of[job.condition].id), []).append(job)
    # Of the repetitions of a case the first that failed stands for all, or else the first one.
    records = {
        key: min((store.result(job.key) for job in group), key=lambda r: r.has_images)
        for key, group in repetitions.items()
    }
    drawn = {key for key, record in records.items() if record.has_images}
    observations = []
    for (method, case_id), record in records.items():
        seen: dict[str, Any] = {}
        case, like_id = case_of[case_id], case_of[case_id].like or ""
        if (method, case_id) in drawn:
            images = _images(repetitions[method, case_id], store)
            seen["shown"] = float(foreground(images).mean())
            if (method, like_id) in drawn:
                others = repetitions[method, like_id]
                like = _images(others, store)
                # A case may have more images than its `like`, which is repeated then.
                counterpart = like[np.arange(len(images)) % len(like)]
                difference = np.abs(images.astype(np.int16) - counterpart)
                seen |= {"mean_change": float(difference.mean()), "most_change": difference.max()}
                if case.repetitions > 1:
                    seen |= _score_changes(others[0], like, images)
        times = {"prepare_s": record.prepare_s, "draw_s": record.draw_s}
        observations.append(
            Observation(case_id, method, record.reason, record.notes, **times, **seen)
        )
    return observations


def _images(jobs: Sequence[Job], store: Store) -> UInt8Images:
    return np.concatenate([unpack(store.array(job.key)) for job in jobs])


def _score_changes(job: Job, like: UInt8Images, images: UInt8Images) -> dict[str, float]:
    """Return by how much SSIM and LPIPS of repetitions differ at most from those of `like`.

    LPIPS is left out where its weights are not installed.
    """
    from bench.metrics.lpips_network import lpips  # imports torch

    drawn = np.concatenate([like, images])
    truth = np.resize(job.object.truth(job.views), drawn.shape)

    def largest_change(scores: Floats) -> float:
        values = scores.reshape(-1, len(like)).mean(axis=1)
        return float(np.abs(values - values[0]).max())

    changes = {"ssim_change": largest_change(ssim_per_image(truth, drawn).ssim)}
    with suppress(WeightsUnavailable):
        changes["lpips_change"] = largest_change(lpips(truth, drawn, single=True))
    return changes


def outcomes_of(observations: Iterable[Observation]) -> pd.DataFrame:
    """Return the verdict on each observation, in the columns of the matrix."""
    cases = {case.id: case for case in CASES}
    rows = []
    for observed in observations:
        case = cases[observed.case]
        expected = expectation(observed.method, case)
        texts = in_words(expected, case.like), _observed_in_words(observed)
        kind = verdict(expected, observed)
        rows.append((case.id, case.group, observed.method, *texts, kind))
    return pd.DataFrame(rows, columns=COLUMNS)


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


NAME, TITLE = "stability_methods", "Methods at the extremes"
# The columns of the matrix's frame, which has a row for each case and method: the case and its
# group, such as "outlier"; the method; the expected and the observed outcome in words; the kind of
# the outcome, see `KINDS`. The cases of a group follow each other.
COLUMNS = ["case", "group", "subject", "expected", "observed", "kind"]


def matrix(remark: str, outcomes: pd.DataFrame) -> Table:
    """Return the table of outcomes.

    Its CSV has a row for each outcome; its Markdown begins with `remark` and counts by kind.
    """
    return Table(NAME, TITLE, outcomes, partial(_layout, remark))


def _layout(remark: str, outcomes: pd.DataFrame) -> Iterator[Block]:
    counts = outcomes["kind"].value_counts()
    cases = outcomes.groupby(["group", "case"]).ngroups
    yield remark
    yield f"{cases} cases, {len(outcomes)} outcomes:"
    yield "\n".join(f"* **{kind}** {counts.get(kind, 0)}: {KINDS[kind]}" for kind in KINDS)
    for group, chosen in outcomes.groupby("group", sort=False):
        lines = [
            [*texts, Cell(kind, special=BOLD if kind == "unexpected" else None)]
            for *texts, kind in chosen.drop(columns="group").itertuples(index=False)
        ]
        yield f"## {cell(str(group))}"
        yield grid(["case", "subject", "expected", "observed", ""], lines)


def unexpected(outcomes: pd.DataFrame) -> list[str]:
    """Return a line for each outcome that is none of the expected ones."""
    lines = []
    for row in outcomes[outcomes["kind"] == "unexpected"].itertuples():
        lines.append(f"{row.subject}, {row.case}: {row.observed}; stated was: {row.expected}")
    return lines


def read_outcomes(folder: Path) -> pd.DataFrame:
    """Return the outcomes of the matrix that a run has left in its folder of tables.

    Raises BadInput for a folder without the matrix, and for a file that is no such matrix.
    """
    path = folder / f"{NAME}.csv"
    if not path.is_file():
        raise BadInput(f"{folder}: no tables of the suite stability; run it again")
    try:
        outcomes = pd.read_csv(path, dtype=str, keep_default_na=False)
    except ValueError:  # not UTF-8, or no table
        outcomes = pd.DataFrame()
    if [*outcomes.columns] != COLUMNS or not outcomes["kind"].isin([*KINDS]).all():
        raise BadInput(f"{path}: not a table of this suite; run it again with --fresh")
    return outcomes
