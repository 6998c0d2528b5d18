"""Jobs of a finished run computed again: honest runs, altered ones, and what is refused."""

from __future__ import annotations

import json
from collections import Counter
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import bench.check.again
from bench.check.again import check_again, draw_jobs
from bench.records.folder import open_folder, open_store, read_manifest
from bench.records.job import JobName
from bench.running.plan import plan
from bench.running.pool import library_threads
from bench.running.protocol import Protocol
from bench.running.work import run_job

from ..builders import as_failed, damage_images, refusal, rewrite, with_scores

SPLAT = JobName("splat", "2048", "chair", "test-0001")
OF = "splat at 2048 of chair/test-0001"


class InProcess:
    """An executor of jobs in this process, one at a time on one thread."""

    capacity = 1

    def __init__(self, count: int) -> None:
        self._ended: list = []

    def submit(self, job) -> None:
        with library_threads(1):
            self._ended.append(run_job(job))

    def wait_any(self, timeout_s=None):
        ended, self._ended = self._ended, []
        yield from ended

    def close(self) -> None:
        pass


@pytest.fixture
def again(finished):
    """Return the result for a folder, by default of all jobs, with the driver of the run."""
    environment = read_manifest(finished[0])["environment"]

    def check(folder, share=1.0, seed=0, **changes):
        return check_again(folder, share, seed, lambda: environment | changes, InProcess)

    return check


def tree(folder: Path) -> dict[str, tuple[int, bytes]]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(p): (p.stat().st_mtime_ns, sha256(p.read_bytes()).digest()) for p in files}


def key_of(folder, name):
    with open_store(folder) as store:
        return next(job.key for job in store.listed() if job.name == name)


def alter_manifest(folder, **entries):
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))


def one_pixel(result, arrays):
    images = arrays["images"].copy()
    images[1, 0, 0, 0] -= 9
    return result, arrays | {"images": images}


def other_scores(by):
    return lambda result, arrays: (with_scores(result, ssim=result.of_views["ssim"] + by), arrays)


def other_judge(result, arrays):
    return result, arrays | {"judge": arrays["judge"] + np.float32(0.5)}


def no_score(result, arrays):
    return with_scores(result, lpips=result.of_views["lpips"] * [1.0, np.nan]), arrays


def test_all_jobs_of_an_honest_run_are_equal_and_nothing_is_written(finished, again):
    before = tree(finished[0])
    result = again(finished[0])
    assert result.differing == ()
    assert (result.computed, result.total, result.same_environment) == (18, 18, True)
    assert tree(finished[0]) == before


@pytest.mark.parametrize(
    ("name", "change", "line"),
    [
        (SPLAT, one_pixel, f"{OF}: images of 1 of 2 views differ by up to 9 levels of 255"),
        (SPLAT, other_scores(0.125), f"{OF}: ssim of 2 of 2 views differ by up to 0.125"),
        (SPLAT, no_score, f"{OF}: lpips of 1 of 2 views differ by up to inf"),
        (
            SPLAT.truth,
            other_judge,
            "ground-truth of chair/test-0001: judge of 2 of 2 views differ by up to 0.5",
        ),
    ],
)
def test_what_was_altered_is_named(copied, again, name, change, line):
    rewrite(copied, key_of(copied, name), change)
    assert again(copied).differing == (line,)


def test_a_job_that_differs_ends_the_command_with_1(copied, same_machine, command, monkeypatch):
    monkeypatch.setattr(
        bench.check.again, "JobPool", lambda count, workers, limits: InProcess(count)
    )
    rewrite(copied, key_of(copied, SPLAT), one_pixel)
    status, out, _ = command("check", copied, "--again", "1")
    assert status == 1
    assert out.splitlines() == [
        f"DIFFERS {OF}: images of 1 of 2 views differ by up to 9 levels of 255",
        "18 of 18 jobs computed again: 1 differ",
    ]


def test_damaged_and_missing_jobs_and_other_failures_are_named(copied, again):
    with open_folder(copied) as store:
        keys = {row.name: row.key for row in store.listed()}
        for name in (SPLAT._replace(object_id="test-0000"), SPLAT._replace(condition="noise-0.10")):
            store.append(as_failed(store.result(keys[name]), "draw: no memory"))
        store.list_jobs((key, name) for name, key in keys.items() if name.method != "blank")
    damage_images(copied, [keys[SPLAT]])
    lines = again(copied).differing
    altered = [line for line in lines if "blank" not in line]
    assert altered[0] == (
        "splat at 2048 of chair/test-0000: failed (draw: no memory) in the run, images here"
    )
    assert altered[1].startswith(f"{OF}: ")
    assert "missing or altered" in altered[1]
    assert altered[2].startswith("splat at noise-0.10 of chair/test-0001: failed (draw: no memory)")
    assert len(altered) == 3
    assert len(lines) == 6
    assert "blank at 2048 of chair/test-0002: not in the store of the run" in lines


def test_in_another_environment_means_may_differ_within_tolerances(copied, again, capsys):
    rewrite(copied, key_of(copied, SPLAT), other_scores(0.002))
    rewrite(copied, key_of(copied, SPLAT.truth), one_pixel)
    result = again(copied, gl="another")
    assert (result.differing, result.same_environment) == ((), False)
    assert "another environment than that of the run, wider tolerances: gl another (" in (
        capsys.readouterr().err
    )
    rewrite(copied, key_of(copied, SPLAT), other_scores(0.001))
    line = f"{OF}: ssim differs by 0.003, allowed 0.0022"
    assert again(copied, gl="another").differing == (line,)


def test_a_run_of_several_environments_is_compared_by_the_wider_tolerance(copied, again, capsys):
    rewrite(copied, key_of(copied, SPLAT), other_scores(0.002))
    (here,) = read_manifest(copied)["environments"]
    assert here["jobs"] == 3 * (1 + 2 * 2 + 2)
    assert again(copied).same_environment
    alter_manifest(copied, environments=[here, here | {"jobs": 1, "scipy": "0.1"}])
    result = again(copied)
    assert (result.differing, result.same_environment) == ((), False)
    told = f"its jobs were made in 2 environments: 21 with scipy {here['scipy']}; 1 with scipy 0.1"
    assert told in capsys.readouterr().err


def test_other_weights_are_named(copied, again, capsys):
    manifest = read_manifest(copied)
    identity = manifest["feature_identity"] | {"judge": "another"}
    alter_manifest(copied, feature_identity=identity)
    assert again(copied, 0.01).differing == ()
    assert "judge: of another version or with other weights than in the run" in (
        capsys.readouterr().err
    )


def test_every_job_is_as_probable(finished):
    """3 of 9 jobs in 900 draws: each 300 times, with a standard deviation of 14.1."""
    manifest = read_manifest(finished[0])
    planned = plan(Protocol.from_manifest(manifest, ["splat", "blank"]))
    assert planned.jobs_per_object == 4
    drawn = Counter(
        job.key for seed in range(900) for _, jobs in draw_jobs(planned, 0.3, seed) for job in jobs
    )
    assert len(drawn) == 9
    assert all(abs(times - 300) < 5 * 14.1 for times in drawn.values())
    assert [len(jobs) for _, jobs in draw_jobs(planned, 1.0, 0)] == [3, 3, 3]
    assert sum(len(jobs) for _, jobs in draw_jobs(planned, 1e-9, 0)) == 1


def test_what_cannot_be_computed_again_is_refused(finished, copied, again, command):
    for share in ("0", "2", "nan"):
        status, out, err = command("check", finished[0], "--again", share)
        assert (status, out) == (2, "")
        assert err == f"bench: --again {share}: must be over 0 and at most 1\n"
    assert command("check", copied.parent / "none", "--again", "1")[0] == 2
    assert command("check", copied, "--seed", "1")[2] == (
        "bench: --seed: chooses the jobs that are computed again; give --again with it\n"
    )
    assert command("check", copied, copied, "--again", "1")[2] == (
        "bench: 2 folders: golden values are compared with one run; give one folder, or --claims, "
        "which takes several\n"
    )
    assert "leave out --bless" in command("check", copied, "--again", "1", "--bless", "a.json")[2]
    manifest = read_manifest(copied)
    alter_manifest(copied, methods=["splta"])
    assert refusal(again, copied).startswith("unknown method 'splta'")
    alter_manifest(copied, methods=manifest["methods"], dataset="cow")
    assert "cow" in refusal(again, copied)
    alter_manifest(copied, dataset="procedural", objects=[*manifest["objects"], "chair/cow"])
    assert refusal(again, copied) == (
        f"{copied}: chair/cow is not in procedural any more (1 of 4 objects are not); bring the "
        "dataset back as it was"
    )
    alter_manifest(copied, objects=manifest["objects"], suite="stability")
    assert "has no jobs that could be computed again" in refusal(again, copied)
