from __future__ import annotations

import numpy as np
import pytest
from harness_objects import Tetrahedron

from bench.metrics import ssim
from bench.records.folder import open_folder
from bench.records.job import failed
from bench.suites.stability.cases import VIEWS
from bench.suites.stability.figures import ACROSS, MISSING, sheet
from bench.suites.stability.outcomes import observe
from data_prep.scene import IMAGE_SIZE

from ...builders import make_job, make_record, make_result


def job_of(case, views=VIEWS, method="splat"):
    return make_job(Tetrahedron(case), method, case, views=views)


@pytest.fixture
def store(tmp_path):
    with open_folder(tmp_path) as opened:
        yield opened


def append(store, job, images):
    record = make_record(method=job.method, condition=job.condition, notes="repaired")
    store.append(make_result(job, [record], images=images))


@pytest.fixture
def plain(store):
    """The job of the plain case, which the store has, and its images."""
    job = job_of("plain")
    images = np.full((4, 128, 128, 3), 255, np.uint8)
    images[:, :64] = np.array([10, 20, 30, 40], np.uint8)[:, None, None, None]
    append(store, job, images)
    return job, images


def beside_plain(store, plain, other, images):
    """Return the observation of a job with these images, with the plain case beside it."""
    append(store, other, images)
    return observe([plain[0], other], store)[1]


def test_a_change_is_seen_in_both_directions_and_beside_the_same_method_only(store, plain):
    changed = plain[1].copy()
    changed[0, 0, 0] = 0, 12, 10  # 10 darker, 2 lighter, equal
    seen = beside_plain(store, plain, job_of("shuffled"), changed)
    assert seen.mean_change == pytest.approx(12 / changed.size, rel=1e-12)
    assert seen.most_change == 10
    other = job_of("shuffled", method="pc2pix")
    assert beside_plain(store, plain, other, plain[1]).mean_change is None


def test_more_views_than_the_other_case_go_through_it_again(store, plain):
    other = job_of("batch-doubled", views=2 * VIEWS)
    twice = np.concatenate([plain[1], plain[1]])
    seen = beside_plain(store, plain, other, twice)
    assert (seen.mean_change, seen.most_change) == (0.0, 0)
    twice[7, 0, 0, 0] += 1
    assert beside_plain(store, plain, other, twice).most_change == 1


def test_alone_and_without_images(store, plain):
    job, images = plain
    (seen,) = observe([job], store)
    assert (seen.case, seen.method, seen.reason, seen.notes) == ("plain", "splat", "", "repaired")
    assert (seen.shown, seen.prepare_s, seen.draw_s) == (0.5, 0.25, 0.125)
    assert (seen.mean_change, seen.most_change) == (None, None)  # it is like no other
    broken, like = job_of("normalised"), job_of("millimetres")
    store.append(failed(broken, "apss: no faces"))
    append(store, like, images)
    seen = observe([broken, like, job], store)
    assert seen[0].reason == "apss: no faces"
    assert (seen[0].shown, seen[0].prepare_s) == (None, None)
    assert seen[1].shown == 0.5
    assert seen[1].mean_change is None  # there is nothing to compare it with


def test_repetitions_are_one_observation_with_the_largest_change_of_scores(store, plain):
    job, images = plain
    moved = images.copy()
    moved[0, 40:60, 40:60] = 255
    jobs = [job_of(condition) for condition in ("last-bit", "last-bit-2", "last-bit-3")]
    for other, drawn in zip(jobs, (images, moved, images), strict=True):
        append(store, other, drawn)
    _, seen = observe([job, *jobs], store)
    difference = np.abs(moved.astype(int) - images)
    assert (seen.case, seen.most_change) == ("last-bit", difference.max())
    assert seen.mean_change == pytest.approx(difference.mean() / 3, rel=1e-12)
    truth = job.object.truth(VIEWS)
    assert seen.ssim_change == pytest.approx(
        abs(ssim(truth, moved).ssim - ssim(truth, images).ssim)
    )
    assert seen.lpips_change > 1e-4
    still = observe([job, jobs[0], jobs[2]], store)[1]
    assert (still.mean_change, still.ssim_change, still.lpips_change) == (0.0, 0.0, 0.0)
    store.append(failed(jobs[1], "apss: no faces"))
    assert observe([job, *jobs], store)[1].reason == "apss: no faces"


def test_a_missing_image_is_grey_and_the_rest_of_a_row_white():
    shown = sheet([[None, np.zeros((IMAGE_SIZE, IMAGE_SIZE, 3), np.uint8)]])
    assert shown.shape == (IMAGE_SIZE, ACROSS * IMAGE_SIZE, 3)
    missing, black, rest = np.split(shown, [IMAGE_SIZE, 2 * IMAGE_SIZE], axis=1)
    assert (np.unique(missing), np.unique(black), np.unique(rest)) == (MISSING, 0, 255)
