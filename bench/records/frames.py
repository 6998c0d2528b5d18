"""The images and the jobs of a run as frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from bench.records.parquet import read_batches
from bench.records.record import COLUMNS, TIMES, TYPES

JOB = ["method", "condition", "class", "object"]  # columns that name a job
SUMMED = (*(n for n in TYPES if n not in ("view", "azimuth_deg", "elevation_deg", *TIMES)), *TIMES)


def read_job_sums(directory: Path) -> pd.DataFrame:
    """Return the jobs of a finished run, a row each, with the sums of their scores.

    Ground truths are no rows, and memory does not grow with the number of views.

    Returns
    -------
    DataFrame
        As `sum_views`, sorted by method, condition, class and object.

    Raises
    ------
    BadInput
        As `read_records`.
    """
    none = sum_views(pd.DataFrame(columns=COLUMNS))
    parts = [sum_views(part) for part in read_batches(directory)]
    return pd.concat(parts, ignore_index=True) if parts else none


def sum_views(records: pd.DataFrame) -> pd.DataFrame:
    """Return the jobs of some records, in whose order the images of a job follow each other.

    Returns
    -------
    DataFrame
        The text columns `method`, `condition`, `class`, `object`, `reason` and `notes`; `planned`
        and `drawn`, the views of the job and those with images, which are all or none; `prepare_s`
        and `draw_s` as in the records; and for each column of scores, as `ssim`, and of times, as
        `draw_s`, `ssim_sum` and `ssim_count`: the sum and the number of the values that are no NaN,
        added one view after the other.
    """
    names = records[JOB].astype(object)
    begins = (names != names.shift()).any(axis=1).to_numpy()
    job, first = begins.cumsum() - 1, records[begins]
    text = [*JOB, "reason", "notes"]
    jobs = first[text].astype(object).reset_index(drop=True)
    jobs["planned"] = np.bincount(job, minlength=len(jobs))
    jobs["drawn"] = np.bincount(job[records["outcome"] == "ok"], minlength=len(jobs))
    jobs[list(TIMES)] = first[list(TIMES)].to_numpy(np.float64)
    for name in (name for name in SUMMED if name in records):
        values = records[name].to_numpy(np.float64)
        known = ~np.isnan(values)
        sums, counts = np.zeros(len(jobs)), np.bincount(job[known], minlength=len(jobs))
        # One after the other: equal images have equal sums to the last bit.
        np.add.at(sums, job[known], values[known])
        jobs[f"{name}_sum"], jobs[f"{name}_count"] = sums, counts
    return jobs
