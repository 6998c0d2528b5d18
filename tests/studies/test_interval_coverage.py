"""False positives are counted, and populations are what they are said to be."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from studies.interval_coverage import CLOSED, missed, percentile_interval, rates, smooth


def test_what_is_counted():
    assert rates(0, lambda rng, n: np.ones(n), 8, 3) == (1.0, 1.0)
    assert rates(0, lambda rng, n: np.zeros(n), 8, 3) == (0.0, 0.0)
    assert [
        missed(interval) for interval in ((0.1, 0.2), (-0.2, -0.1), (-0.1, 0.1), (0.0, 0.1))
    ] == [*(True, True, False, False)]


@pytest.mark.parametrize("name", CLOSED)
def test_true_means_are_0(name):
    """The mean of 200,000 draws is 0 within five standard errors."""
    values = CLOSED[name](np.random.default_rng(1), 200_000)
    assert abs(values.mean()) < 5 * values.std() / np.sqrt(len(values))


def test_smooth_populations_have_mean_0_and_the_kernel_beside_the_spread():
    values = np.array([1.0, 2.0, 6.0])
    drawn = smooth(values, np.random.default_rng(1), 200_000)
    assert drawn.mean() == pytest.approx(0.0, abs=5 * values.std() / np.sqrt(200_000))
    # variances add up: 1 + 0.3^2; a variance of 200,000 draws is known to 0.5 %
    assert drawn.var() == pytest.approx(1.09 * values.var(), rel=0.02)


def test_the_percentile_interval_of_two_values():
    """Means of two draws of 0 and 1: 0, 1/2 or 1, a quarter, a half and a quarter of the time."""
    assert percentile_interval(np.array([0.0, 1.0]), np.random.default_rng(0)) == (0.0, 1.0)
    make = partial(percentile_interval, rng=np.random.default_rng(0))
    assert make(np.full(5, 2.0)) == (2.0, 2.0)
