"""What the study computes from its measurements."""

from __future__ import annotations

import numpy as np
import pytest

from studies.ray_speed import Compared, crossings, differing, first, jobs_of, summary


def test_the_crossing_is_log_linear():
    # ratio = (faces / 1000) ** 0.5 passes 1 at 1000
    curve = [(n, (n / 1000) ** 0.5) for n in (100, 500, 4000, 9000)]
    assert crossings(curve) == pytest.approx([1000])
    assert crossings([(n, 2.0) for n in (1, 2)]) == []


def test_pixels_differ_by_their_largest_channel():
    a = np.full((2, 4, 4, 3), 100, np.uint8)
    b = a.copy()
    b[0, 0, 0] = (98, 102, 100)  # two levels do not count
    b[1, 0, :2, 1] = (97, 255)
    assert differing(a, b).tolist() == [0, 2 / 16]


def test_summary_has_a_line_for_each_condition_and_one_for_all():
    change, share = np.array([1e-5, -3e-5]), np.array([0.001, 0.003])
    compared = [
        Compared("2048", 100, 6.0, 1.0, change, share),
        Compared("512", 300, 4.0, 2.0, change, share),
    ]
    _, one, other, both = summary(compared).splitlines()
    assert one.split() == ["2048", "100", "6.00s", "1.00s", "6.00", "6.00-6.00", *CHANGE]
    assert other.split()[:5] == ["512", "300", "4.00s", "2.00s", "2.00"]
    assert both.split() == ["all", "200", "5.00s", "1.50s", "4.00", "2.00-6.00", *CHANGE]


CHANGE = ["-1.0e-05", "2.0e-05", "3.0e-05", "0.200%"]


def test_jobs_are_those_of_a_run():
    jobs = jobs_of(2, views=3)
    assert len(jobs) == 2 * 5
    assert {len(job.views) for job in jobs} == {3}
    assert {job.object.object_id for job in first(jobs, 1)} == {"test-0000"}
