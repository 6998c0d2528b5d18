from __future__ import annotations

import json
import multiprocessing
import os
import time
from contextlib import closing

import numpy as np
import pytest
from harness_objects import (
    Calling,
    Dying,
    Hanging,
    HangingOnce,
    Killed,
    Refusing,
    TellingItsProcess,
    Tetrahedron,
)

from bench.catalogue.metrics import find_extractor
from bench.catalogue.suites import Limits
from bench.running.pool import WORKER_ENVIRONMENT, submit_all
from bench.running.work import JobPool, run_job

from .. import plugin_methods
from ..builders import make_job, make_truth, true_images, views_of
from .test_pool import is_alive, wait_until

pytestmark = pytest.mark.timing

AMPLE = Limits(time_s=60.0, memory_gib=8.0)


@pytest.fixture
def jobs_for():
    """One job per object, of a method that needs neither OpenGL nor a network."""

    def make(*objects):
        truths = map(true_images, objects)
        pairs = zip(objects, truths, strict=True)
        return [make_job(obj, "blank", reference=truth) for obj, truth in pairs]

    return make


def run_jobs(jobs, workers, limits, **options):
    with closing(JobPool(len(jobs), workers, limits, **options)) as pool:
        yield from submit_all(jobs, pool)


def reasons(results):
    """Reasons by object, whose name ends the key of its job."""
    return {r.key.split()[-1]: r.reason for r in results}


def test_bad_jobs_cost_their_own_records_only(jobs_for):
    kinds = (Tetrahedron, Refusing, Dying, Tetrahedron, Killed, Calling, Tetrahedron)
    jobs = jobs_for(*(kind(str(number)) for number, kind in enumerate(kinds, 1)))
    results = list(run_jobs(jobs, 2, AMPLE))
    assert sorted(result.key for result in results) == sorted(job.key for job in jobs)
    assert reasons(results) == {
        "1": "",
        "2": "input: no such shape; draw one",
        "3": "crash: the worker died (exit code 7)",
        "4": "",
        "5": "crash: the worker died (SIGKILL)",
        "6": "SystemExit: enough",
        "7": "",
    }
    for result in results:
        assert len(views_of(result)) == 2
        # What a lost worker took counts; an unreadable object costs a method nothing.
        counts = not result.reason.startswith(("input", "SystemExit"))
        assert (result.prepare_s is not None and 0 < result.prepare_s < 30) == counts


@pytest.mark.slow
def test_a_job_that_takes_too_long_is_tried_once_more(jobs_for, tmp_path):
    jobs = jobs_for(
        HangingOnce("1", pid_file=tmp_path / "pid1"), Hanging("2", pid_file=tmp_path / "pid2")
    )
    results = run_jobs(jobs, 2, Limits(time_s=8.0, memory_gib=8.0))
    assert reasons(results) == {"1": "", "2": "timeout: no result within 8 s"}


def scored_beside(*methods):
    """Images and scores of each method, in turn in one pool of one worker."""
    obj = Tetrahedron()
    features = (("fd-alexnet", str(find_extractor("fd-alexnet").weights(None))),)
    common = {"reference": run_job(make_truth(obj)).arrays["images"], "features": features}
    jobs = [make_job(obj, method, **common) for method in methods]
    return {r.key.split()[0]: (r.arrays, r.reason, r.views) for r in run_jobs(jobs, 1, AMPLE)}


@pytest.mark.slow
def test_code_of_others_changes_no_score_and_no_job_of_ours(tmp_path, monkeypatch):
    """Nor that of a third party, which draws the same images as the two that change a library."""
    ours = ("splat", "alpha-wrap")
    alone = scored_beside(*ours)
    with plugin_methods.installed(tmp_path, monkeypatch):
        others = ("fake-strict-numbers", "fake-patched-torch", "fake-healthy")
        beside = scored_beside(*others, *ours)
    assert {name: beside[name] for name in ours} == alone
    assert all(reason == "" for _, reason, _ in beside.values())
    assert len({str(beside[name]) for name in others}) == 1


def test_closing_early_stops_all_workers(jobs_for, tmp_path):
    files = [tmp_path / "pid1", tmp_path / "pid2"]
    hanging = [Hanging(file.name, pid_file=file) for file in files]
    jobs = jobs_for(Refusing("0"), *hanging, Tetrahedron("3"))
    ended = []

    def both_are_busy():
        ended.extend(pool.wait_any(0.1))  # a worker that gets ready is given its job
        return all(file.is_file() and file.read_text() for file in files)

    with closing(JobPool(len(jobs), 2, AMPLE)) as pool:
        for job in jobs:
            pool.submit(job)
        wait_until(both_are_busy)
        assert reasons(ended) == {"0": "input: no such shape; draw one"}
        pids = [int(file.read_text()) for file in files]
        assert all(map(is_alive, pids))
        start = time.monotonic()
    assert time.monotonic() - start < AMPLE.time_s / 2  # nobody waited for the time limit
    assert not any(map(is_alive, pids))
    assert multiprocessing.active_children() == []


def test_workers_have_an_environment_of_their_own_and_are_replaced_now_and_then(
    jobs_for, monkeypatch
):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    for name in WORKER_ENVIRONMENT.keys() - {"OMP_NUM_THREADS"}:
        monkeypatch.delenv(name, raising=False)
    before = dict(os.environ)
    jobs = jobs_for(*(TellingItsProcess(str(i)) for i in range(4)))
    results = run_jobs(jobs, 1, AMPLE, tasks_per_worker=2)
    told = [json.loads(result.reason.removeprefix("input: ")) for result in results]
    for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "LP"):
        assert told[0][f"{name}_NUM_THREADS"] == "1"
    assert WORKER_ENVIRONMENT.items() <= told[0].items()
    assert dict(os.environ) == before
    _, counts = np.unique([process["pid"] for process in told], return_counts=True)
    assert counts.tolist() == [2, 2]
