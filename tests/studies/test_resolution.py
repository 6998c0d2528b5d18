"""The study decides as the paired t test does of normal differences, and moves what is recorded."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.resolution import POWER
from studies.resolution import recorded, simulate

RUNS = 2000


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.05, 0.0025])
def test_of_normal_differences_eighty_percent_are_decided(level):
    """Within three standard errors of the share, and .02 for the test by signs and for nct's skew.

    The formula is 0.0003 (at .05) and 0.012 (at .0025) from the power by the noncentral t at 24.
    """
    population = norm.ppf((np.arange(4000) + 0.5) / 4000)
    (share,) = simulate([population], 24, RUNS, level).shares
    assert share == pytest.approx(POWER, abs=3 * (POWER * (1 - POWER) / RUNS) ** 0.5 + 0.02)


def test_runs_print_the_resolution_of_their_own_objects():
    """Relative to that of the population: the ratio of the standard deviations."""
    population = np.array([-1.0, 1.0])
    decided = simulate([population], 9, 50, 0.05)
    # Of nine values of -1 and 1 the variance is (9 - 9 m^2) / 8, with the mean m = (9 - 2 k) / 9.
    possible = [((9 - 9 * ((9 - 2 * k) / 9) ** 2) / 8) ** 0.5 for k in range(1, 9)]
    for ratio in decided.printed.ravel():
        assert min(abs(ratio - value) for value in possible) < 1e-12
    assert np.ptp(decided.printed) > 0


def test_the_recorded_populations_are_those_of_the_default_run():
    populations = recorded()
    assert {len(values) for values in populations} == {24}
    assert max(values.mean() for values in populations) < 0  # no method is ahead of the best
    assert len(populations) == 70
