from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.intervals import RESAMPLES, interval_of_means, mean_interval, median_interval

VALUES = np.array([0.3, 0.7, 0.2, 0.9, 0.45])
CLASS_OF_TWO = np.array([0.0, 1.0])


def test_is_the_percentile_bootstrap():
    rows = np.random.default_rng(0).integers(0, len(VALUES), (RESAMPLES, len(VALUES)))
    expected = np.percentile(VALUES[rows].mean(axis=1), [2.5, 97.5])
    # two orders of summing five numbers: some 1e-16
    np.testing.assert_allclose(mean_interval(VALUES), expected, atol=1e-14)


def test_equal_values_give_them_exactly():
    assert mean_interval(np.full(3, 0.1)) == (0.1, 0.1)
    assert np.full(3, 0.1).mean() != 0.1  # where summing would round


@pytest.mark.parametrize("values", [[], [0.5], [0.5, np.nan], [np.nan, np.nan], [0.0, np.inf]])
def test_where_there_is_no_interval(values):
    values = np.array(values)
    assert np.isnan(mean_interval(values)).all()
    assert np.isnan(median_interval(values, np.arange(len(values)))).all()
    assert np.isnan(median_interval(np.array([1.0, 2.0]), np.array(["a", "a"]))).all()
    assert np.isnan(interval_of_means([np.arange(3.0), values])).all()
    assert np.isnan(interval_of_means([])).all()


def test_resamples_are_shared_between_methods():
    """The same objects are drawn for every method: a constant lead is a constant."""
    for interval in (mean_interval, lambda of: interval_of_means([of[:3], of[3:]])):
        low, high = interval(VALUES)
        np.testing.assert_allclose(interval(VALUES + 0.25), (low + 0.25, high + 0.25), atol=1e-14)


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


@pytest.mark.parametrize("at_once", [1, 7 * 8, 2**30])
def test_how_many_resamples_are_in_memory_moves_nothing(at_once, monkeypatch):
    expected = mean_interval(VALUES), median_interval(ERRORS, OBJECTS)
    monkeypatch.setattr("bench.analysis.intervals.AT_ONCE", at_once)
    assert (mean_interval(VALUES), median_interval(ERRORS, OBJECTS)) == expected


def test_two_objects_each_have_few_resamples():
    """Of 0 and 1 the resampled means are 0, 1/2, 1; over two such classes 0 to 1 by quarters.

    Mean over classes 0 comes with probability 1/16, and so does 1: both lie within the 95 %.
    """
    assert interval_of_means([CLASS_OF_TWO, CLASS_OF_TWO]) == (0.0, 1.0)
    # of classes, however many objects they have, each counts alike
    assert interval_of_means([np.full(2, 1.0), np.full(200, 3.0)]) == (2.0, 2.0)


def test_classes_are_drawn_independently():
    """Standard error of a mean over classes: sqrt(sum of var / G) / C. Drawn alike, equal classes
    would be as uncertain as one."""
    values = np.random.default_rng(0).standard_normal(50) + 10
    classes = [scale * values for scale in (1.0, 2.0, 3.0, 4.0)]
    low, high = interval_of_means(classes)
    error = math.sqrt(sum(of.var() / len(of) for of in classes)) / 4
    # the 2.5 % points of 2,000 resamples are known to about 0.07 standard errors
    assert (high - low) / (2 * 1.96 * error) == pytest.approx(1, abs=0.1)
    assert low < np.mean([of.mean() for of in classes]) < high
