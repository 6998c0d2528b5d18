from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.intervals import interval_of_means
from bench.metrics.frechet import interval_of_left_out, jackknife_interval


def test_two_objects_each_have_few_resamples():
    """Of 0 and 1 the resampled means are 0, 1/2, 1; over two such classes 0 to 1 by quarters.

    Mean over classes 0 comes with probability 1/16, and so does 1: both lie within the 95 %.
    """
    class_of_two = np.array([0.0, 1.0])
    assert interval_of_means([class_of_two, class_of_two]) == (0.0, 1.0)
    # with eight classes 0 has 4 ** -8: the interval is narrower
    low, high = interval_of_means([class_of_two] * 8)
    assert 0.125 < low < 0.5 < high < 0.875


def test_classes_count_alike_however_many_objects():
    """Constant classes: the mean over classes, not over objects."""
    assert interval_of_means([np.full(2, 1.0), np.full(200, 3.0)]) == (2.0, 2.0)


def test_normal_values():
    """Standard error of a mean over classes: sqrt(sum of var / G) / C, here with C = 4."""
    rng = np.random.default_rng(0)
    classes = [scale * rng.standard_normal(50) + 10 for scale in (1.0, 2.0, 3.0, 4.0)]
    low, high = interval_of_means(classes)
    error = math.sqrt(sum(of.var() / len(of) for of in classes)) / 4
    # the 2.5 % points of 2,000 resamples are known to about 0.07 standard errors
    assert (high - low) / (2 * 1.96 * error) == pytest.approx(1, abs=0.1)
    assert low < np.mean([of.mean() for of in classes]) < high


def test_classes_are_drawn_independently():
    """Drawn alike, two equal classes would be as uncertain as one; they are not."""
    values = np.random.default_rng(1).standard_normal(40)
    (low_1, high_1), (low_2, high_2) = (interval_of_means([values] * n) for n in (1, 2))
    assert (high_2 - low_2) / (high_1 - low_1) == pytest.approx(math.sqrt(0.5), abs=0.08)


def test_methods_are_paired():
    """The same objects are drawn for every method: a constant lead is a constant."""
    a = [np.array([1.0, 5.0, 2.0]), np.array([7.0, 3.0])]
    low, high = interval_of_means(a)
    shifted = interval_of_means([of + 2 for of in a])
    assert shifted == pytest.approx((low + 2, high + 2), abs=1e-12)


def test_one_class_is_the_jackknife():
    left_out = np.array([3.0, 3.5, 2.5, 4.0])
    assert jackknife_interval(3.2, [left_out]) == pytest.approx(
        interval_of_left_out(3.2, left_out), abs=1e-12
    )


def test_variances_of_classes_add_up():
    """(g - 1) / g sum of squares: 1/2 (1 + 1) = 1 and 2/3 (4 + 4) = 16/3; over 2 classes."""
    left_out = [np.array([4.0, 6.0]), np.array([1.0, 3.0, 5.0])]
    low, high = jackknife_interval(7.0, left_out, fewest=2)
    reach = 1.96 * math.sqrt(1 + 16 / 3) / 2
    assert (low, high) == pytest.approx((7 - reach, 7 + reach), abs=1e-12)


@pytest.mark.parametrize(
    "of_classes",
    [[], [np.arange(3.0), np.array([1.0])], [np.array([1.0, np.nan])], [np.empty(0)]],
)
def test_no_interval(of_classes):
    assert np.isnan(interval_of_means(of_classes)).all()
    assert np.isnan(jackknife_interval(1.0, of_classes, fewest=2)).all()
