from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.intervals import RESAMPLES, mean_interval, median_interval

VALUES = np.array([0.3, 0.7, 0.2, 0.9, 0.45])


def percentile_interval(values):
    """The textbook's percentile bootstrap of the mean."""
    rows = np.random.default_rng(0).integers(0, len(values), (RESAMPLES, len(values)))
    return np.percentile(values[rows].mean(axis=1), [2.5, 97.5])


def test_is_the_percentile_bootstrap():
    # two orders of summing five numbers: some 1e-16
    np.testing.assert_allclose(mean_interval(VALUES), percentile_interval(VALUES), atol=1e-14)


def test_two_objects_worked_by_hand():
    # Means of two draws from {0, 1}: 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4.
    assert mean_interval(np.array([0.0, 1.0])) == (0.0, 1.0)


def test_equal_values_give_them_exactly():
    assert mean_interval(np.full(3, 0.1)) == (0.1, 0.1)
    assert np.full(3, 0.1).mean() != 0.1  # where summing would round


@pytest.mark.parametrize("values", [[], [0.5], [0.5, np.nan], [np.nan, np.nan], [0.0, np.inf]])
def test_where_there_is_no_interval(values):
    assert np.isnan(mean_interval(np.array(values))).all()


def test_resamples_are_shared_between_methods():
    low, high = mean_interval(VALUES)
    shifted = mean_interval(VALUES + 0.25)
    np.testing.assert_allclose(shifted, (low + 0.25, high + 0.25), atol=1e-14)


def test_covers_the_true_mean():
    # 95 % nominal; with 20 objects a percentile bootstrap covers some 93 %. Of 200 intervals
    # 186 +- 3.6 should hold the mean; five standard deviations below is 168.
    rng = np.random.default_rng(1)
    intervals = [mean_interval(rng.normal(size=20)) for _ in range(200)]
    held = sum(low <= 0 <= high for low, high in intervals)
    assert 168 <= held <= 199


# --- medians --------------------------------------------------------------------------------------

ERRORS = np.array([5.0, 1.0, 9.0, 2.0, 30.0, 7.0, 4.0, 8.0])
OBJECTS = np.array(list("aabbbccd"))  # as many values of an object as there are


def test_the_median_interval_is_the_percentile_bootstrap_over_objects():
    rng = np.random.default_rng(0)
    medians = [
        np.median(np.concatenate([ERRORS["abcd"[i] == OBJECTS] for i in row]))
        for row in rng.integers(4, size=(RESAMPLES, 4))
    ]
    expected = np.percentile(medians, [2.5, 97.5])
    assert median_interval(ERRORS, OBJECTS) == pytest.approx(tuple(expected), abs=1e-12)
    shuffled = np.random.default_rng(1).permutation(len(ERRORS))
    assert median_interval(ERRORS[shuffled], OBJECTS[shuffled]) == median_interval(ERRORS, OBJECTS)


@pytest.mark.parametrize("at_once", [1, 5, 7 * 8, 2**30])
def test_how_many_resamples_are_in_memory_moves_nothing(at_once, monkeypatch):
    expected = mean_interval(VALUES), median_interval(ERRORS, OBJECTS)
    monkeypatch.setattr("bench.analysis.intervals.AT_ONCE", at_once)
    assert (mean_interval(VALUES), median_interval(ERRORS, OBJECTS)) == expected


def test_medians_of_two_objects_worked_by_hand():
    # aa: median 1, ab and ba: of 1 1 5 7, 3; bb: 6
    assert median_interval(np.array([1.0, 1.0, 5.0, 7.0]), np.array(list("aabb"))) == (1.0, 6.0)
    assert median_interval(np.full(4, 0.1), np.array(list("aabb"))) == (0.1, 0.1)


def test_where_there_is_no_median_interval():
    assert np.isnan(median_interval(np.array([1.0, 2.0]), np.array(["a", "a"]))).all()
    assert np.isnan(median_interval(np.array([1.0, np.nan]), np.array(["a", "b"]))).all()
    assert np.isnan(median_interval(np.empty(0), np.empty(0, str))).all()
