"""A dry run: what it prints, and that it changes nothing."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing

import pytest
from harness_objects import Tetrahedron

from bench.catalogue import chosen
from bench.catalogue.chosen import MeasuredMethod
from bench.records.folder import open_folder, open_store, write_manifest
from bench.records.job import GROUND_TRUTH, failed
from bench.records.store import STORE
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import Protocol
from bench.running.run import RunStatus, run_status

from ..builders import SUITE, make_protocol

DRY = ("--suite", SUITE, "--dry-run")
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
    status, out, err = command("run", *DRY, *FEW, "--workers", "2", "--out", tmp_path / "a")
    assert (status, err) == (0, "")
    assert list(tmp_path.iterdir()) == []
    for line in (
        r"objects +3 chair",
        rf"folder +{tmp_path}/a \(new\)",
        r"  splat +version 1, scipy .*",
        r"  fd-views +/.*views_network.safetensors",
        r"  fid +skipped: no weights.*",
        r"jobs: 12 to do, 0 done",
        r"time: about 24 s with 2 workers, by the costs that 'bench list' shows",
        r"disk: about 0 MB",
    ):
        assert re.search(f"^{line}$", out, re.M), line


@pytest.mark.usefixtures("same_machine")
def test_dry_run_counts_what_is_left_takes_the_disk_of_the_folder_and_leaves_it(
    copied, command, arguments
):
    with open_store(copied) as store:
        jobs = [job for job in store.listed() if job.name.method == "splat"]  # 3 objects x 2
    with closing(sqlite3.connect(copied / STORE)) as connection, connection:
        connection.executemany("DELETE FROM job WHERE key = ?", [(job.key,) for job in jobs[:3]])
    with (copied / STORE).open("ab") as file:
        file.truncate(18_000_000)  # as if the 18 jobs that are there had a megabyte each
    before = tree(copied)
    dry = (*arguments, "--dry-run", "--out", copied)
    _, out, _ = command(*dry)
    assert "jobs: 3 to do, 18 done\n" in out
    assert out.endswith("\ndisk: about 3 MB\n")
    _, out, _ = command(*dry, "--fresh")
    assert "jobs: 21 to do, 0 done" in out
    assert "the run there would be renamed" in out
    assert tree(copied) == before  # the store is not repaired


def test_dry_run_of_a_download_fetches_nothing(command, no_cache, no_machine):
    arguments = ("--methods", "blank", "--limit", "1", "--inception-weights", "download")
    status, out, _ = command("run", "--suite", SUITE, *arguments, "--dry-run")
    assert status == 0
    assert re.search(r"^  fid +to be downloaded first$", out, re.M)
    assert "skipped:" not in out
    assert "fid, fd-views" in out
    assert list(no_cache.iterdir()) == []


def test_jobs_of_an_object_that_cannot_be_drawn_are_done(tmp_path, no_machine):
    options = Options(SUITE, methods=("blank",), conditions=("2048",), limit=3, out=tmp_path)
    protocol = Protocol.from_options(options)
    with open_folder(tmp_path) as store:
        store.append(failed(plan(protocol)[1].truth, "input: no such shape"))
    write_manifest(tmp_path, protocol.to_manifest({}, 3, 1))
    assert run_status(options).left == {GROUND_TRUTH: 2, "blank": 2}


def make_status(tmp_path, left, workers=2, stored_b=0) -> RunStatus:
    """Return a run of 8 objects with 20 views and two conditions."""
    protocol = make_protocol(
        methods=("pc2pix", "blank"),
        objects=tuple(Tetrahedron(str(number)) for number in range(8)),
        views=20,
    )
    return RunStatus(tmp_path, plan(protocol), left, workers, stored_b)


def test_time_and_disk_of_the_jobs_left(tmp_path):
    known = {name: MeasuredMethod(name, 1220.0, 20.0, None) for name in ("pc2pix", "blank")}
    known["blank"] = MeasuredMethod("blank", 0.0, 0.0, None)
    run = make_status(tmp_path, {GROUND_TRUTH: 8, "pc2pix": 16, "blank": 8})
    # 32 jobs x 20 images x 0.015 s to score, 8 x 20 true images x 0.005 s, and 16 clouds x 1.6 s:
    # 1.22 s for one view and 19 x 0.02 s; two cores; 8 s to start, 12 s and 1.2 s an object for
    # tables and figures
    assert run.seconds(known) == pytest.approx((9.6 + 0.8 + 25.6) / 2 + 8 + 12 + 8 * 1.2)
    assert run.size_b == 32 * 20 * 7000
    rest = make_status(tmp_path, {GROUND_TRUTH: 0, "pc2pix": 1, "blank": 0}, stored_b=31_000)
    assert rest.seconds(known) == pytest.approx(1.9 + 8 + 12 + 8 * 1.2)  # one of the workers
    assert rest.size_b == 1000
    assert (run.unmeasured(known), rest.unmeasured({})) == ([], ["pc2pix"])
    without = {"pc2pix": known["pc2pix"]}
    assert run.unmeasured(without) == ["blank"]
    assert run.seconds(without) == pytest.approx((7.2 + 0.8 + 25.6) / 2 + 8 + 12 + 8 * 1.2)


@pytest.mark.usefixtures("no_cache", "no_machine")
def test_a_method_without_a_measured_cost_is_named(command, tmp_path, monkeypatch):
    lines = chosen.COSTS.read_text().splitlines(keepends=True)
    (tmp_path / "costs.csv").write_text("".join(x for x in lines if "points2pix" not in x))
    monkeypatch.setattr(chosen, "COSTS", tmp_path / "costs.csv")
    few = ("--methods", "points2pix,splat", "--limit", "1")
    status, out, _ = command("run", *DRY, *few, "--out", tmp_path / "a")
    assert status == 0
    assert "\nwithout a measured cost, left out of the time: points2pix\n" in out
