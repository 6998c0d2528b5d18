"""The exit status of `bench run` where a method fails."""

from __future__ import annotations

import pandas as pd
import pytest

from bench.records.folder import open_folder, read_manifest
from bench.records.frames import read_jobs

from ..builders import as_failed


@pytest.mark.slow
def test_a_method_without_an_image_is_no_success(copied, same_machine, arguments, command):
    """The store has its jobs as failed, and one of another method."""
    jobs = [job for job in read_jobs(copied) if job.name.method == "splat"]
    jobs.append(next(job for job in read_jobs(copied) if job.name.method == "true-mesh"))
    with open_folder(copied) as store:
        for job in jobs:
            store.append(as_failed(store.result(job.key)))
    status, printed, err = command(*arguments, "--out", copied)
    assert (status, err.splitlines()[-1]) == (
        1,
        f"bench: without a single image: splat; the reasons are in {copied / 'report.html'}",
    )
    assert printed.startswith("ssim-object and lpips: 3 of 3 objects")
    frame = pd.read_parquet(copied / "records.parquet")
    assert set(frame[frame["method"] == "splat"]["outcome"]) == {"failed"}
    assert read_manifest(copied)["finished"]
