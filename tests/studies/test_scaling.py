from __future__ import annotations

import pytest

from bench.running.options import Options
from studies.scaling import Measured, measure, report

pytestmark = pytest.mark.timing


def test_overhead_is_what_no_job_took():
    taken = Measured(workers=2, items=30, wall_s=10.0, jobs_s=18.0)
    assert taken.rate == 3.0
    assert taken.overhead == pytest.approx(0.1, rel=1e-12)


def test_medians_over_rounds_of_ratios_within_a_round():
    def a_round(one_s, two_s):
        return Measured(1, 100, one_s, one_s), Measured(2, 100, two_s, 2 * two_s * 0.9)

    rounds = [a_round(10.0, 5.0), a_round(20.0, 12.5), a_round(10.0, 6.25)]
    lines = report([(1, None), (2, "local")], rounds).splitlines()
    assert lines[2] == "| 1 | 100 | 10.0 | 10.00 | 1.00 | 0.0% |"
    assert lines[3] == "| 2 of Ray | 100 | 6.2 | 16.00 | 1.60 | 10.0% |"


@pytest.mark.slow
def test_items_are_really_done():
    taken = measure(
        (1, None),
        Options("chair-robustness", methods=("splat",), conditions=("512",), limit=1, views=1),
    )
    assert (taken.workers, taken.items) == (1, 2)  # blank is always measured
    assert 0 < taken.jobs_s < taken.wall_s
