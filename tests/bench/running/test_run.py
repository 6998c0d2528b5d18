"""Whole runs: small, with real worker processes, real images and a real network."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import shutil
import signal
import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import bench.catalogue.suites
import bench.running.protocol
import bench.running.run
from bench.analysis.run import read_run
from bench.catalogue.suites import SUITES
from bench.commands.terminal import Terminal
from bench.finish import write_tables_and_figures
from bench.records.folder import open_store, read_manifest, write_manifest
from bench.records.frames import read_jobs
from bench.records.job import GROUND_TRUTH
from bench.records.store import STORE
from bench.running.options import Options
from bench.running.plan import Budget
from bench.running.protocol import Protocol
from bench.running.run import run, run_status
from bench.tables.build import tables
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput, MissingDependency

from .. import plugin_methods
from ..builders import (
    assert_equal_runs,
    file_bytes,
    finished_options,
    make_manifest,
    rows_of,
    run_suite,
    stored_keys,
    watched,
)
from ..conftest import BENCH, start_run


def records(directory):
    return pd.read_parquet(directory / "records.parquet")


def contents(directory):
    """The results of a run with their arrays, by key."""
    with open_store(directory) as store:
        keys = {row.key for row in store.listed()}
        return {key: (store.result(key), store.arrays(key)) for key in keys}


def test_files_of_a_run(finished):
    directory, _ = finished
    names = {str(p.relative_to(directory)) for p in directory.rglob("*") if p.is_file()}
    tables = ("headline", "table3_ssim", "table4_fid", "table_detail", "table_control")
    assert names == {
        *("manifest.json", "records.parquet", "run.sqlite", "cost.md", "report.html", "lock"),
        *(f"tables/{name}.{kind}" for name in tables for kind in ("csv", "md")),
        *(f"figures/{name}.png" for name in ("robustness", "pictures", "thin-parts")),
        "figures/robustness.svg",
    }
    # A job for each ground truth and item; for what depends on no condition one.
    assert len(stored_keys(directory)) == 3 + 3 * (2 * 2 + 2)
    for name in ("robustness", "pictures", "thin-parts"):
        with Image.open(directory / "figures" / f"{name}.png") as image:
            assert np.asarray(image.convert("L")).std() > 10


def test_records_of_a_run(finished, tiny_weights):
    frame = records(finished[0])
    assert len(frame) == 24 * 2
    assert set(frame["outcome"]) == {"ok"}
    assert set(frame["method"]) == {"splat", f"pc2pix@{tiny_weights}", "true-mesh", "blank"}
    assert set(frame["object"]) == {"test-0000", "test-0001", "test-0002"}
    by_item = frame.groupby(["method", "condition", "object"])
    assert set(by_item["view"].agg(tuple)) == {(0, 1)}
    assert set(by_item["prepare_s"].nunique()) == {1}
    views = frame.drop_duplicates(["object", "view", "azimuth_deg", "elevation_deg"])
    assert len(views) == 6  # the same for all methods and conditions
    assert (frame[["prepare_s", "draw_s"]] >= 0).all(axis=None)


@pytest.mark.usefixtures("few_objects")
def test_ceiling_and_floor(finished):
    images, sets, detail, _ = tables(read_run(finished[0]))
    rows = {(r.method, r.condition, r.metric): r for r in rows_of(images, sets, detail)}
    value = {cell: row.value for cell, row in rows.items()}
    parts_of_ssim = ("ssim", "luminance", "contrast", "structure")
    for condition in ("2048", "noise-0.10"):
        for metric in parts_of_ssim:
            row = rows["true-mesh", condition, metric]
            assert (row.value, row.ci_low, row.ci_high) == (1.0, 1.0, 1.0)
        for metric in ("ssim-object", "silhouette-iou", "thin-recall", "thin-precision"):
            assert value["true-mesh", condition, metric] == 1.0
            assert 0 < value["splat", condition, metric] < 1
        # The distance of a set to itself, in float64: a rounding of the trace, some 1e-14 x 100.
        for metric in ("fd-views", "fd-alexnet"):
            assert 0.0 <= value["true-mesh", condition, metric] < 1e-9
        assert value["true-mesh", condition, "lpips"] == 0.0
        assert value["blank", condition, "lpips"] > value["splat", condition, "lpips"] > 0.01
        assert value["blank", condition, "thin-recall"] == 0.0
        assert rows["blank", condition, "thin-precision"].n_ok == 0
        assert value["blank", condition, "ssim-object"] < 0.7
    # Splats of a noisy cloud may be further away than nothing at all; those of a clean one are not.
    near = value["splat", "2048", "fd-views"]
    assert value["blank", "2048", "fd-views"] > near > 0.1
    assert value["splat", "noise-0.10", "fd-views"] > near
    for metric in (*parts_of_ssim, "fd-views"):  # blank images do not depend on the cloud
        assert value["blank", "2048", metric] == value["blank", "noise-0.10", metric]
    assert value["blank", "2048", "ssim"] < value["splat", "2048", "ssim"] < 1.0
    assert value["splat", "noise-0.10", "ssim"] < value["splat", "2048", "ssim"]
    assert all(row.n_ok == row.n == 6 for row in rows_of(images, sets))
    for row in rows_of(sets):
        assert row.note.startswith("skipped: no weights; ") == (row.metric in ("fid", "kid"))
    (counted,) = {r.n_ok for r in rows_of(detail) if r.metric == "thin-recall"}
    assert 0 < counted <= 6  # it is the truth that has thin parts or not


def test_the_manifest_tells_what_was_run(finished, tiny_weights):
    manifest = read_manifest(finished[0])
    assert manifest["suite"] == "chair-robustness"
    assert manifest["conditions"] == ["2048", "noise-0.10"]
    assert manifest["objects"] == [f"chair/test-000{i}" for i in range(3)]
    assert (manifest["views"], manifest["seed"], manifest["workers"]) == (2, 0, 2)
    assert {"gl", "render", "pyrender", "numpy"} <= manifest["environment"].keys()
    assert manifest["finished"] >= manifest["started"]
    assert set(manifest["stage_seconds"]) == {"jobs", "tables", "figures"}
    assert manifest["versions"]["numpy"] == np.__version__
    assert list(manifest["skipped_metrics"]) == ["fid"]


def test_a_finished_run_is_not_done_again(finished, copied, same_machine, tiny_weights):
    before = contents(copied)
    write_manifest(copied, read_manifest(copied) | {"stage_seconds": {"jobs": 1000.0}})
    again = run_suite(finished_options(tiny_weights, copied))
    assert (again.done, again.reused, again.failed) == (0, 21, 0)
    assert contents(copied) == before
    assert file_bytes(copied / "tables") == file_bytes(finished[0] / "tables")
    pd.testing.assert_frame_equal(records(copied), records(finished[0]))  # times and all
    assert read_manifest(copied)["finished"]
    assert read_manifest(copied)["stage_seconds"]["jobs"] >= 1000  # before this start, too


@pytest.mark.slow
def test_damage_is_repaired_and_growth_added(finished, copied, same_machine, tiny_weights, capsys):
    """Images gone, images altered, records altered, an object more: only these are done."""
    keys = {row.name.method: row.key for row in read_jobs(copied)}
    truth, splat, mesh = keys[GROUND_TRUTH], keys["splat"], keys["true-mesh"]
    of_job = "WHERE name = ? AND job = (SELECT id FROM job WHERE key = ?)"
    with closing(sqlite3.connect(copied / STORE)) as database, database:
        database.execute(f"DELETE FROM blob {of_job}", ["judge", truth])
        database.execute(f"UPDATE blob SET data = substr(data, 2) {of_job}", ["images", splat])
        database.execute("UPDATE job SET views = x'00' WHERE key = ?", [mesh])
    again = run_suite(finished_options(tiny_weights, copied, limit=4))
    assert (again.done, again.reused, again.failed, again.objects) == (7 + 3, 21 - 3, 0, 4)
    told = "run.sqlite: the images or records of 3 jobs are missing or altered; they are done again"
    assert told in capsys.readouterr().err
    was, now = contents(finished[0]), contents(copied)
    assert {key: now[key][1] for key in was} == {key: images for key, (_, images) in was.items()}
    assert read_manifest(copied)["request"]["limit"] == 4


def test_fresh_starts_over(copied, same_machine, no_networks, capsys):
    cell: dict[str, Any] = {"methods": ("blank",), "conditions": ("2048",)}
    small = Options("chair-robustness", **cell, limit=1, views=2, workers=1, out=copied, fresh=True)
    with pytest.raises(BadInput, match="must be at least 1"):
        run_suite(replace(small, views=0))
    assert len(records(copied)) == 48  # what is refused leaves all as it was
    again = run_suite(small)
    assert (again.done, again.reused) == (2, 0)
    old = copied.with_name("run.old-1")
    assert f"the old run is now {old}\n" in capsys.readouterr().err
    assert len(records(old)) == 48
    assert len(records(copied)) == 2


def start(arguments, directory, code=BENCH[-1]):
    return start_run((*arguments, "--workers", "1"), directory, code)


def wait_for(process, reached):
    while not reached():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.005)


@pytest.mark.slow
def test_killed_three_times(finished, arguments, tmp_path):
    """While ground truths are drawn, while items are done, and while tables are made: the end is
    that of the run with two workers which was not killed, and no job has been done twice."""
    directory = tmp_path / "run"
    moments = [
        lambda: len(stored_keys(directory)) >= 1,
        lambda: len(stored_keys(directory)) >= 3 + 8,
        lambda: (directory / "records.parquet").exists(),
    ]
    for number, reached in enumerate(moments):
        with start(arguments, directory) as process:
            wait_for(process, reached)
            if number == 1:
                process.kill()  # the main process alone: its workers have to notice
            else:
                os.killpg(process.pid, signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL
        assert read_manifest(directory)["finished"] is None
    assert len(stored_keys(directory)) == 3 + 18
    with start(arguments, directory) as process:
        _, err = process.communicate()
    assert process.returncode == 0, err
    assert "0 jobs done, 21 from before, 0 failed" in err

    assert_equal_runs(directory, finished[0])
    places = finished[0], directory
    images = [{key: images for key, (_, images) in contents(d).items()} for d in places]
    assert len(images[0]) == 3 + 18
    assert images[0] == images[1]


@pytest.fixture
def no_networks(monkeypatch):
    """Without set metrics, workers need no torch and start in a second."""
    suites = [replace(SUITES[0], set_metrics=(), control_metrics=())]
    monkeypatch.setattr(bench.running.protocol, "SUITES", suites)
    monkeypatch.setattr(bench.catalogue.suites, "SUITES", suites)


class OneMore(Budget):
    """Time for one object a start."""

    def __post_init__(self):
        super().__post_init__()
        self._first = None

    def allows(self, complete, under_way):
        self._first = complete if self._first is None else self._first
        return complete + math.ceil(under_way) < self._first + 1


class Interrupted(Terminal):
    """Ctrl-C as soon as an object is complete."""

    def on_object_done(self, snapshot):
        super().on_object_done(snapshot)
        raise KeyboardInterrupt


@pytest.mark.slow
def test_some_objects_now_and_the_others_later(
    finished, same_machine, tiny_weights, tmp_path, monkeypatch, command
):
    """Ctrl-C, a budget, no limit: each start goes on from where the last one came, what it leaves
    is a run of the objects that are complete, and the end is that of a run never stopped."""
    monkeypatch.setenv("COLUMNS", "100")  # pytest-xdist sets 80
    directory = tmp_path / "run"
    options = finished_options(tiny_weights, directory)
    first = run(options, write_tables_and_figures, **watched(Interrupted))
    assert (first.interrupted, first.objects, first.planned, first.done) == (True, 1, 3, 8)
    assert read_manifest(directory)["objects"] == ["chair/test-0000"]
    interim_table = (directory / "tables" / "headline.md").read_text()
    truth = "against the true mesh in its colours"
    assert interim_table.startswith(
        f"# ssim-object and lpips: 1 of 3 objects; {truth}; protocol {PROTOCOL_VERSION}\n"
    )
    assert set(records(directory)["object"]) == {"test-0000"}

    more = replace(options, budget=100.0)
    second = run(more, write_tables_and_figures, make_budget=OneMore, **watched())
    assert (second.interrupted, second.objects, second.reused) == (False, 2, 8)
    assert read_manifest(directory)["finished"]
    status, out, err = command("table", directory)
    assert (status, err) == (0, "")
    assert out.startswith(
        "ssim-object and lpips: 2 of 3 objects; against the true mesh in its colours; "
        f"protocol {PROTOCOL_VERSION}\n"
    )
    assert {row.n for row in rows_of(*tables(read_run(directory)))} == {4}

    last = run_suite(options)
    assert (last.objects, last.planned, last.reused) == (3, 3, 15)
    assert_equal_runs(directory, finished[0])


def test_budgets_that_cannot_be_kept_are_refused_before_any_work(
    same_machine, tiny_weights, tmp_path
):
    options = finished_options(tiny_weights, tmp_path / "run", budget=5.0)
    with pytest.raises(BadInput, match=r"--budget 5s: too short for one object .* at least \d+s"):
        run_suite(options)
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_what_hangs_when_the_budget_ends_is_stopped_and_the_rest_is_kept(
    no_networks, no_machine, tmp_path, monkeypatch
):
    """The time counts from the start: here, planning has taken two seconds of ten."""
    real = bench.running.run.plan
    monkeypatch.setattr(bench.running.run, "plan", lambda p: time.sleep(2.0) or real(p))
    methods = ("splat", "fake-hang", "blank")
    options = Options("chair-robustness", "procedural", methods, ("2048",), 1, views=2, workers=1)
    options = replace(options, out=tmp_path / "run")
    start = time.monotonic()
    with plugin_methods.installed(tmp_path / "site", monkeypatch):
        with pytest.raises(BadInput, match=r"--budget 10s: used up .*; [123] of its jobs are kept"):
            run(
                options,
                write_tables_and_figures,
                make_budget=lambda seconds: Budget(10.0),
                **watched(),
            )
        assert time.monotonic() - start < 10 + 2
    assert len(stored_keys(options.directory)) in (1, 2, 3)
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize("there", [True, False])
def test_a_manifest_that_another_run_writes_meanwhile_stays(
    no_machine, tiny_weights, copied, there, monkeypatch
):
    """It had the lock while this run was planned; the folder was empty before, or not."""
    manifest = copied / "manifest.json"
    if not there:
        shutil.rmtree(copied)
    options = finished_options(tiny_weights, copied)
    real = bench.running.run.plan

    def plan(protocol):
        copied.mkdir(exist_ok=True)
        text = read_manifest(copied) if there else make_manifest(device="auto")
        manifest.write_text(json.dumps(text | {"finished": "later"}))
        return real(protocol)

    monkeypatch.setattr(bench.running.run, "plan", plan)
    with pytest.raises(BadInput, match="another run has changed it just now; run again"):
        run(options, write_tables_and_figures, **watched())
    assert json.loads(manifest.read_bytes())["finished"] == "later"


@pytest.mark.slow
def test_interrupted(tmp_path):
    directory = tmp_path / "run"
    arguments = ("run", "--suite", "chair-robustness", "--methods", "splat", "--views", "20")
    # What a shell starts in the background ignores SIGINT, and so do its children.
    handling = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    with start(arguments, directory, handling + BENCH[-1]) as process:
        wait_for(process, lambda: len(stored_keys(directory)) >= 1)
        for _ in range(3):  # an impatient user
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
            time.sleep(0.1)
        _, err = process.communicate()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "bench: interrupted; the same command goes on from here"
    assert "Traceback" not in err
    assert read_manifest(directory)["finished"] is None


TETRAHEDRON = "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"
BAD_MESHES = {
    "bare.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "the mesh has no faces"),
    "nan.obj": ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "1 non-finite vertices of 3"),
    "text.ply": ("this is no mesh\n", "no PLY header"),
}


class Counting(Terminal):
    """A reporter that keeps how many jobs were to be done, have ended and have failed."""

    def __init__(self, counts, make, title, total):
        super().__init__(make, title, total)
        self.counts = counts
        counts.update(total=total, ended=0, failed=0)

    def on_jobs_done(self, ended, failed):
        super().on_jobs_done(ended, failed)
        self.counts.update(ended=self.counts["ended"] + ended, failed=failed)


def counted_run(options):
    """Run, and assert that dry run, progress and summary count the same jobs."""
    status = run_status(options)
    to_do = status.jobs
    counts = {"total": 0, "ended": 0}
    done = run(options, write_tables_and_figures, **watched(Counting, counts))
    assert (done.done, done.reused) == (to_do, status.done)
    assert (counts["total"], counts["ended"]) == (to_do, to_do)
    assert counts.get("failed", done.failed) == done.failed
    return done


@pytest.mark.slow
def test_bad_meshes_among_good_ones(same_machine, no_networks, tmp_path, capsys):
    folder, out = tmp_path / "meshes", tmp_path / "run"
    folder.mkdir()
    for name, (text, _) in BAD_MESHES.items():
        (folder / name).write_text(text)
    (folder / "good.obj").write_text(TETRAHEDRON)
    (folder / "tall.obj").write_text(TETRAHEDRON.replace("v 1 1 1", "v 1 3 1"))
    cell: dict[str, Any] = {"methods": ("true-mesh",), "conditions": ("2048",)}
    options = Options("chair-robustness", f"folder:{folder}", **cell, views=2, workers=1, out=out)
    done = counted_run(options)
    assert (done.done, done.reused, done.failed) == (15, 0, 9)
    frame = records(out)
    assert len(frame) == 5 * 2 * 2
    for name, (_, problem) in BAD_MESHES.items():
        chosen = frame[frame["object"] == name]
        assert set(chosen["outcome"]) == {"failed"}
        assert chosen["reason"].str.startswith(f"input: {folder / name}: ").all()
        assert chosen["reason"].str.contains(problem, regex=False).all()
    good = frame[frame["object"].isin(["good.obj", "tall.obj"])]
    assert set(good["outcome"]) == {"ok"}
    assert set(good["class"]) == {"meshes"}
    row = rows_of(tables(read_run(out))[0])[0]
    assert (row.method, row.value, row.n_ok, row.n) == ("true-mesh", 1.0, 4, 10)
    assert f"2 x input: {folder / 'text.ply'}: no PLY header" in row.note
    with open_store(out) as store:  # without a ground truth nothing is tried
        results = store.find(stored_keys(out)).values()
    assert [sum(result.has_images for result in results), len(results)] == [2 + 2 * 2, 15]
    again = counted_run(options)
    assert (again.done, again.reused, again.failed) == (0, 15, 9)
    capsys.readouterr()
    more = counted_run(replace(options, methods=("splat",), adds=True))  # as "bench add" does
    assert (more.done, more.reused, more.failed) == (2, 15 + 3, 9 + 3)
    assert len(read_manifest(out)["added"]) == 1
    assert "chair-robustness: 18 jobs are there from before\n" in capsys.readouterr().err


@pytest.mark.slow
def test_nothing_but_bad_meshes(tmp_path):
    """By the real command, so that nobody else writes to stderr either."""
    (tmp_path / "meshes").mkdir()
    mesh = tmp_path / "meshes" / "bare.obj"
    mesh.write_text(BAD_MESHES["bare.obj"][0])
    arguments = ("run", "--suite", "chair-robustness", "--methods", "splat")
    with start((*arguments, "--dataset", f"folder:{mesh.parent}"), tmp_path / "run") as process:
        _, err = process.communicate()
    assert process.returncode == 2
    assert err == (
        f"bench: none of the 1 objects can be drawn; the first: {mesh}: "
        "the mesh has no faces; a bare point cloud cannot be scored\n"
    )


def test_a_machine_without_opengl(tmp_path):
    def environment():
        raise MissingDependency("no OpenGL context: install libegl1")

    options = Options("chair-robustness", methods=("blank",), out=tmp_path / "run")
    with pytest.raises(BadInput, match="no OpenGL context: install libegl1"):
        Protocol.from_options(options, environment)
    assert not (tmp_path / "run").exists()


def test_defaults_are_those_of_the_suite():
    protocol = Protocol.from_options(Options("chair-robustness", fresh=True), dict)
    assert tuple(protocol.methods) == (
        *("surface-apss", "alpha-wrap", "denoised-wrap", "splat-fill", "pc2pix"),
        "pc2pix@acgan",
        *("splat-net", "splat-net@chair", "fused-net"),
        *("true-mesh", "true-mesh@grey", "constant", "blank"),
    )
    assert protocol.conditions == ("2048", "1024", "512", "noise-0.05", "noise-0.10")
    assert (protocol.views, protocol.seed, len(protocol.objects)) == (20, 0, 24)
    assert "fd-views" in dict(protocol.features)
    assert set(protocol.skipped) <= {"fid", "judge"}


def test_default_folder(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    monkeypatch.chdir(tmp_path / "meshes")
    for dataset, name in (
        ("procedural", "s-procedural"),
        ("folder:my meshes/chairs/", "s-folder-chairs"),
        ("folder:/a b/Stühle", "s-folder-Stühle"),
        ("folder:/data/椅子 कुर्सी", "s-folder-椅子-कुर्सी"),
        ("folder:.", "s-folder-meshes"),
    ):
        assert Options("s", dataset).directory == Path("results/runs", name)
