from __future__ import annotations

import numpy as np
import pytest
from harness_objects import Tetrahedron

from bench.records.job import Result, failed
from bench.suites.stability.cases import VIEWS
from bench.suites.stability.outcomes import observe

from ...builders import make_job, make_record, write_artifact


def job_of(directory, case, views=VIEWS, method="splat"):
    return make_job(Tetrahedron(case), method, case, views=views)


def done(job, images):
    sha = write_artifact(job, images=images)
    record = make_record(method=job.method, condition=job.condition, notes="repaired")
    return Result(job.key, (record,), sha)


@pytest.fixture
def plain(tmp_path):
    job = job_of(tmp_path, "plain")
    images = np.full((4, 128, 128, 3), 255, np.uint8)
    images[:, :64] = np.array([10, 20, 30, 40], np.uint8)[:, None, None, None]
    return job, done(job, images), images


def test_images(plain):
    job, result, _ = plain
    (seen,) = observe([job], {job.key: result}.__getitem__)
    assert (seen.case, seen.method, seen.reason, seen.notes) == ("plain", "splat", "", "repaired")
    assert seen.shown == 0.5
    assert (seen.mean_change, seen.most_change) == (None, None)  # it is like no other
    assert (seen.prepare_s, seen.draw_s) == (0.25, 0.125)


def beside_plain(plain, other, images):
    """Return the observation of a job with these images, with the plain case beside it."""
    job, result, _ = plain
    results = {job.key: result, other.key: done(other, images)}
    return observe([job, other], results.__getitem__)[1]


def test_a_change_is_seen_in_both_directions_and_beside_the_same_method_only(tmp_path, plain):
    changed = plain[2].copy()
    changed[0, 0, 0] = 0, 12, 10  # 10 darker, 2 lighter, equal
    seen = beside_plain(plain, job_of(tmp_path, "shuffled"), changed)
    assert seen.mean_change == pytest.approx(12 / changed.size, rel=1e-12)
    assert seen.most_change == 10
    other = job_of(tmp_path, "shuffled", method="pc2pix")
    assert beside_plain(plain, other, plain[2]).mean_change is None


def test_more_views_than_the_other_case_go_through_it_again(tmp_path, plain):
    other = job_of(tmp_path, "batch-doubled", views=2 * VIEWS)
    twice = np.concatenate([plain[2], plain[2]])
    seen = beside_plain(plain, other, twice)
    assert (seen.mean_change, seen.most_change) == (0.0, 0)
    twice[7, 0, 0, 0] += 1
    assert beside_plain(plain, other, twice).most_change == 1


def test_no_images(tmp_path, plain):
    job, result, images = plain
    broken, like = job_of(tmp_path, "normalised"), job_of(tmp_path, "millimetres")
    results = {
        broken.key: failed(broken, "apss: no faces"),
        like.key: done(like, images),
        job.key: result,
    }
    seen = observe([broken, like, job], results.__getitem__)
    assert seen[0].reason == "apss: no faces"
    assert (seen[0].shown, seen[0].prepare_s) == (None, None)
    assert seen[1].shown == 0.5
    assert seen[1].mean_change is None  # there is nothing to compare it with
