"""The plan of a run: what a dry run and a pilot print, and that both change nothing."""

from __future__ import annotations

import re
import sqlite3
from collections import Counter
from contextlib import closing
from itertools import islice

import numpy as np
import pytest
from harness_objects import Tetrahedron

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.commands.plan import plan_of
from bench.records.job import failed
from bench.records.record import GROUND_TRUTH
from bench.records.run_folder import open_folder, read_store, write_manifest
from bench.records.store import STORE
from bench.running.manifest import describe
from bench.running.options import Options
from bench.running.pilot import Cost, Sample
from bench.running.plan import plan
from bench.running.protocol import protocol_of
from bench.running.status import RunStatus, run_status
from bench.tables.markdown import document

from ..builders import SUITE, damage_images, make_protocol

FEW = ("--methods", "splat,blank", "--conditions", "2048,512", "--limit", "3", "--views", "2")


def tree(directory):
    """Return all files below, with times and bytes."""
    files = (path for path in directory.rglob("*") if path.is_file())
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


@pytest.fixture
def no_cache(monkeypatch, tmp_path_factory):
    """Return the cache folder, without weights of Inception."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


def test_dry_run_of_a_new_run_prints_all_and_writes_nothing(
    command, tmp_path, no_cache, no_machine
):
    status, out, err = command("run", "--suite", SUITE, *FEW, "--dry-run", "--out", tmp_path / "a")
    assert (status, err) == (0, "")
    assert list(tmp_path.iterdir()) == []
    for line in (
        r"objects +3 chair",
        rf"folder +{tmp_path}/a \(new\)",
        r"  splat +version 1, scipy .*",
        r"  fd-views +/.*views_network.safetensors",
        r"  fid +skipped: weights.*",
        r"jobs: 12 to do, 0 done",
        r"\| ground-truth \| 3 \| 0 \| - \| - \| - \|",
        r"\| splat \| 6 \| 0 \| - \| - \| - \|",
        r"about .* s with .* \(3 methods have no job in the folder: 0.6 s a job .*",
    ):
        assert re.search(f"^{line}$", out, re.M), line


@pytest.mark.usefixtures("same_machine")
def test_dry_run_of_a_finished_run_leaves_it_as_it_is(copied, command, arguments):
    before = tree(copied)
    dry = (*arguments, "--dry-run", "--out", copied)
    status, out, _ = command(*dry)
    assert status == 0
    assert "jobs: 0 to do, 21 done" in out
    _, out, _ = command(*dry, "--fresh")
    assert "jobs: 21 to do, 0 done" in out
    assert "the run there would be renamed" in out
    assert tree(copied) == before


@pytest.mark.usefixtures("same_machine")
def test_dry_run_counts_what_is_left_and_takes_the_times_in_the_folder(copied, command, arguments):
    with read_store(copied) as store:
        jobs = [job for job in store.listed() if job.name.method == "splat"]  # 3 objects x 2
        records = [store.records(job.key) for job in jobs]
    with closing(sqlite3.connect(copied / STORE)) as connection, connection:
        connection.executemany("DELETE FROM jobs WHERE key = ?", [(job.key,) for job in jobs[:3]])
    damage_images(copied, [jobs[3].key])  # counts as done until a run reads it, but has no size
    before = tree(copied)
    _, out, _ = command(*arguments, "--dry-run", "--out", copied)
    assert "jobs: 3 to do, 18 done" in out
    seconds, hours = re.search(r"^\| splat \| 3 \| 3 \| (\S+) \| (\S+) \|", out, re.M).groups()
    drawing = {}
    for job, views in zip(jobs[4:], records[4:], strict=True):  # both conditions of an object
        drawing[job.name.condition] = views[0].prepare_s + sum(view.draw_s for view in views)
    assert len(drawing) == 2
    left = [job.name.condition for job in jobs[:3]]
    expected = np.mean([drawing[condition] for condition in left]) + 2 * 0.02
    assert float(seconds) == pytest.approx(expected, rel=0.05)  # printed with two digits
    assert float(hours) == pytest.approx(3 * float(seconds) / 3600, rel=0.1)
    assert re.search(r"^about \d+ s with .*, \d+ MB \(by the jobs in the folder\)$", out, re.M)
    assert tree(copied) == before  # the store is not repaired


def test_dry_run_of_a_download_fetches_nothing(command, no_cache, no_machine):
    arguments = ("--methods", "blank", "--limit", "1", "--inception-weights", "download")
    status, out, _ = command("run", "--suite", SUITE, *arguments, "--dry-run")
    assert status == 0
    assert re.search(r"^  fid +to be downloaded first$", out, re.M)
    assert "skipped:" not in out
    assert "fid, fd-views" in out
    assert list(no_cache.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("run --dry-run --suite speed", "--dry-run: the suite speed takes minutes and has no plan"),
        ("run --dry-run --suite latent", "--dry-run: the suite latent takes minutes and has no "),
        ("run --dry-run --suite speed-accuracy --workers 2", "--workers: has no meaning"),
        ("plan --suite stability", "bench plan: the suite stability takes minutes and has no plan"),
        (f"plan --suite {SUITE} --methods splta", "unknown method 'splta': did you mean 'splat'?"),
        (f"plan --suite {SUITE} --pilot 0", "--pilot 0: must be at least 1"),
    ],
)
def test_both_refuse_as_the_run_does(command, arguments, message, tmp_path, no_machine):
    status, out, err = command(*arguments.split(), "--limit", "1", "--out", tmp_path / "a")
    assert (status, out) == (2, "")
    assert err.startswith(f"bench: {message}")


@pytest.mark.usefixtures("same_machine")
def test_dry_run_refuses_a_folder_of_another_run(copied, command, arguments):
    other = copied.parent / "other"
    other.mkdir()
    (other / "mine").write_text("")
    for message, more in (
        ("holds a run of seed 0, not 1", ("--out", copied, "--seed", "1")),
        ("not empty and not a run", ("--out", other)),
        ("not empty and not a run", ("--out", other, "--fresh")),
    ):
        status, _, err = command(*arguments, "--dry-run", *more)
        assert (status, err.count(message)) == (2, 1)


def test_jobs_of_an_object_that_cannot_be_drawn_are_done(tmp_path, no_machine):
    suite = find(SUITE, SUITES, "suite")
    options = Options(SUITE, methods=("blank",), conditions=("2048",), limit=3, out=tmp_path)
    protocol, _ = protocol_of(suite, options)
    with open_folder(tmp_path) as store:
        store.append(failed(plan(protocol)[1].truth, "input: no such shape"))
    write_manifest(tmp_path, describe(protocol, 1, {}))
    left = run_status(options, protocol).left
    assert left == {(GROUND_TRUTH, ""): 2, ("blank", "2048"): 2}


@pytest.mark.slow
def test_plan_of_a_new_run(command, tmp_path, no_cache, no_machine):
    pilot = ("--pilot", "2", "--workers", "1", "--also", "x", "--samples", "y.csv")
    status, out, err = command("plan", "--suite", SUITE, *FEW, *pilot, "--out", tmp_path / "a")
    assert status == 0
    assert list(tmp_path.iterdir()) == []
    assert err.startswith(
        "bench: --also does nothing any more\nbench: --samples does nothing any more\n"
        "pilot: 2 of 3 objects x 2 conditions x 2 methods\n"
    )
    assert "12 jobs to do. Measured just now on 2 objects with one worker." in out
    for name, jobs in (("ground-truth", 3), ("splat", 6), ("blank", 3), ("**all**", 12)):
        assert re.search(rf"^\| {re.escape(name)} \| {jobs} \| 0 \| 0\.\d+ \|", out, re.M), name


@pytest.mark.usefixtures("same_machine")
def test_plan_of_a_finished_run_measures_nothing(copied, command, arguments):
    status, out, err = command("plan", *arguments[1:], "--out", copied)
    assert (status, err) == (0, "")
    assert out == f"{copied}: nothing is left to do; the run would make its tables.\n"


def make_run(tmp_path, objects=8, done=0) -> RunStatus:
    """Return a run of two workers; its first `done` jobs are done."""
    protocol = make_protocol(
        dataset="folder:a|b",
        methods=("pc2pix", "blank"),
        conditions=("2048", "512"),
        objects=tuple(Tetrahedron(str(number)) for number in range(objects)),
        views=20,
    )
    planned = plan(protocol)
    left = Counter((job.method, job.condition) for job in planned.jobs)
    left.subtract((job.method, job.condition) for job in islice(planned.jobs, done))
    return RunStatus(protocol, tmp_path, planned, left, 2)


def plan_text(run, seconds, reason="") -> str:
    """Return the plan from a pilot of two objects whose jobs take these seconds by method."""
    samples = [
        Sample(job, Cost(seconds[job.method], 125_000.0), 512.0, reason)
        for obj in run.plan[:2]
        for job in obj.jobs
    ]
    return document(plan_of(run, samples))


SECONDS = {GROUND_TRUTH: 45.0, "pc2pix": 180.0, "blank": 0.0}


def test_plan_has_jobs_hours_disk_time_and_memory(tmp_path):
    lines = plan_text(make_run(tmp_path), SECONDS).splitlines()
    title = r"# Plan of chair-robustness on folder:a\|b, against the true mesh in its colours"
    assert lines[0] == title
    assert "| ground-truth | 8 | 0 | 45 | 0.1 | 1 |" in lines
    assert "| pc2pix | 16 | 0 | 180 | 0.8 | 2 |" in lines
    assert "| **all** | 32 | 0 | 101 | 0.9 | 4 |" in lines
    # 3,240 s of two cores, 8 s to start, 12 s and 1.2 s an object for tables and figures
    assert (
        "With 2 workers: **27 min**, tables and figures included; memory 2 x 512 MiB at most."
        in lines
    )
    assert not any("jobs of the pilot failed" in line for line in lines)


def test_plan_of_the_rest_and_of_failures(tmp_path):
    text = plan_text(make_run(tmp_path, done=4), SECONDS, reason="draw: no")
    assert f"28 jobs to do, 4 done in `{tmp_path}`." in text
    assert "| pc2pix | 14 | 2 | 180 | 0.7 | 1.8 |" in text
    assert "8 jobs of the pilot failed; they count as they were." in text
    unknown = plan_text(make_run(tmp_path), SECONDS | {"blank": float("nan")})
    assert "| blank | 8 | 0 | - | - | - |" in unknown
    assert "| **all** | 32 | 0 | - | - | - |" in unknown
