"""The exit status of `bench run` where a method fails."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from bench.records.job import Result
from bench.records.run_folder import open_folder, read_manifest
from bench.records.stored_artifacts import read_jobs


def test_a_method_without_an_image_is_no_success(copied, same_machine, arguments, command):
    """The store has its jobs as failed, and one of another method."""
    jobs = [job for job in read_jobs(copied) if job.name.method == "splat"]
    jobs.append(next(job for job in read_jobs(copied) if job.name.method == "true-mesh"))
    lost = {"outcome": "failed", "reason": "draw: no images", "ssim": None}
    with open_folder(copied) as store:
        for job in jobs:
            records = tuple(replace(record, **lost) for record in store.records(job.key))
            store.append(Result(job.key, records, None, lost["reason"]))
    status, printed, err = command(*arguments, "--out", copied)
    assert (status, err.splitlines()[-1]) == (
        1,
        f"bench: without a single image: splat; the reasons are in {copied / 'report.html'}",
    )
    assert printed.startswith("ssim-object and lpips: 3 of 3 objects")
    frame = pd.read_parquet(copied / "records.parquet")
    assert set(frame[frame["method"] == "splat"]["outcome"]) == {"failed"}
    assert read_manifest(copied)["finished"]
