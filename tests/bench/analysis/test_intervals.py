from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bench.analysis.intervals import (
    FEWEST,
    MOST_RESAMPLED,
    RESAMPLES,
    clipped,
    debiased,
    distance_interval,
    interval_of_means,
    jackknife_error,
    jackknife_interval,
    mean_interval,
    median_interval,
)
from bench.metrics.frechet import JackknifeMoments, centred_to_frechet, left_out_distances

VALUES = np.array([0.3, 0.7, 0.2, 0.9, 0.45, 0.5, 0.61, 0.12])
SKEWED = np.array([0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.4, 2.0])


def student(values):
    """Student's interval, from SciPy."""
    return stats.t.interval(0.95, len(values) - 1, values.mean(), stats.sem(values))


def studentised(classes):
    """The studentised bootstrap in its own words: one resample after the other."""
    draws = [np.random.default_rng((0, i)) for i in range(len(classes))]
    rows = [
        rng.integers(len(of), size=(RESAMPLES, len(of)))
        for rng, of in zip(draws, classes, strict=True)
    ]
    value = np.mean([of.mean() for of in classes])
    error = np.sqrt(sum(stats.sem(of) ** 2 for of in classes)) / len(classes)
    quotients = []
    for i in range(RESAMPLES):
        drawn = [of[chosen[i]] for of, chosen in zip(classes, rows, strict=True)]
        own = np.sqrt(sum(stats.sem(of) ** 2 for of in drawn)) / len(classes)
        if own > 1e-9 * error:
            quotients.append((np.mean([of.mean() for of in drawn]) - value) / own)
    low, high = np.percentile(quotients, [2.5, 97.5])
    return value - high * error, value - low * error


def test_the_farther_of_the_studentised_bootstrap_and_student():
    for values in (VALUES, SKEWED, -SKEWED):
        by_resampling, by_table = studentised([values]), student(values)
        expected = (
            min(by_resampling[0], by_table[0]),
            max(by_resampling[1], by_table[1]),
        )
        # sums of eight numbers in two orders, over errors as small as 1e-2: 1e-16 / 1e-2
        assert mean_interval(values) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("count", [401, 2000])
def test_of_many_objects_it_is_students_and_the_bootstrap_says_the_same(count):
    """On a skewed distribution, the exponential one, whose skewness is 2.

    By the Edgeworth expansion of the studentised mean (Hall 1992, section 3.3) an end of its
    interval lies skewness (2 z^2 + 1) / (6 sqrt(n)) standard errors from z, and terms of order 1/n
    follow: z times (kurtosis (z^2 - 3) / 12 + skewness^2 (z^4 + 2 z^2 - 3) / 18 + (z^2 + 3) / 4).
    A quantile of RESAMPLES values is uncertain by sqrt(p (1 - p) / RESAMPLES) / density(z).
    """
    values = np.random.default_rng(7).exponential(size=count)
    error = stats.sem(values)
    z = stats.norm.ppf(0.975)
    skewness, kurtosis = stats.skew(values), stats.kurtosis(values)
    first = skewness * (2 * z**2 + 1) / (6 * np.sqrt(count))
    further = abs(kurtosis) * (z**2 - 3) / 12 + skewness**2 * (z**4 + 2 * z**2 - 3) / 18
    second = z * (further + (z**2 + 3) / 4) / count
    noise = np.sqrt(0.025 * 0.975 / RESAMPLES) / stats.norm.pdf(z)
    interval = mean_interval(values)
    assert interval == pytest.approx(student(values), abs=1e-12)
    for end, by_resampling in zip(interval, studentised([values]), strict=True):
        assert abs(end - by_resampling) < (first + second + 4 * noise) * error


def test_up_to_the_limit_it_is_the_bootstrap():
    """Also where one of several classes has no more than that."""
    values = np.random.default_rng(8).exponential(size=MOST_RESAMPLED + 1)
    for classes in ([values[1:]], [values, values[1:]]):
        low, high = studentised(classes)
        actual = interval_of_means(classes)
        assert actual[1] == pytest.approx(high, abs=1e-12)  # the longer side, by the bootstrap
        assert actual[0] <= low + 1e-12
    low, high = studentised([values])
    assert mean_interval(values)[1] < high - 1e-3 * (high - low)


def test_a_long_tail_lengthens_the_interval_on_its_side():
    low, high = mean_interval(SKEWED)
    assert high - SKEWED.mean() > 2 * (SKEWED.mean() - low)


def test_where_most_values_are_equal_student_decides():
    """Of the resamples that hold the odd one out, none is far from the mean in its own errors."""
    values = np.array([1.0] * 7 + [0.0])
    low, high = mean_interval(values)
    assert low <= student(values)[0]
    assert high >= student(values)[1]


def test_classes_of_few_objects():
    classes = [VALUES[:3], VALUES[3:5], VALUES[5:]]
    value, sems = np.mean([of.mean() for of in classes]), [stats.sem(of) for of in classes]
    # Welch and Satterthwaite
    freedom = sum(s**2 for s in sems) ** 2 / sum(
        s**4 / (len(of) - 1) for s, of in zip(sems, classes, strict=True)
    )
    reach = stats.t.ppf(0.975, freedom) * np.sqrt(sum(s**2 for s in sems)) / 3
    low, high = studentised(classes)
    expected = min(low, value - reach), max(high, value + reach)
    assert interval_of_means(classes) == pytest.approx(expected, abs=1e-12)


def test_equal_values_give_them_exactly():
    assert mean_interval(np.full(10, 0.3)) == (0.3, 0.3)
    assert np.full(10, 0.3).mean() != 0.7  # where summing would round
    # of classes, however many objects they have, each counts alike
    assert interval_of_means([np.full(2, 1.0), np.full(200, 3.0)]) == (2.0, 2.0)


@pytest.mark.parametrize(
    "values", [[], [0.5], range(FEWEST - 1), [0.5] * 7 + [np.nan], [0.0] * 7 + [np.inf]]
)
def test_where_there_is_no_interval(values):
    values = np.array(values, float)
    assert np.isnan(mean_interval(values)).all()
    assert np.isnan(median_interval(values, np.arange(len(values)))).all()
    assert np.isnan(jackknife_interval(1.0, [values])).all()


def test_where_classes_have_no_interval():
    for interval in (interval_of_means, lambda of: jackknife_interval(1.0, of)):
        assert np.isnan(interval([])).all()
        assert np.isnan(interval([VALUES, VALUES[:1]])).all()  # a class of one has no spread
        assert np.isnan(interval([VALUES[:3], VALUES[3:7]])).all()  # seven objects together
        assert np.isfinite(interval([VALUES[:2], VALUES[2:]])).all()


def test_values_of_few_objects_have_no_interval_of_their_median():
    assert np.isnan(median_interval(np.arange(20.0), np.arange(20) // 3)).all()  # seven objects


def test_resamples_are_shared_between_methods():
    """The same objects are drawn for every method: a constant lead is a constant."""
    for interval in (mean_interval, lambda of: interval_of_means([of[:3], of[3:]])):
        low, high = interval(VALUES)
        np.testing.assert_allclose(interval(VALUES + 0.25), (low + 0.25, high + 0.25), atol=1e-12)


ERRORS = np.array([5.0, 1.0, 9.0, 2.0, 30.0, 7.0, 4.0, 8.0, 3.0, 12.0, 6.0, 0.5])
OBJECTS = np.array(list("aabbbccdefgh"))  # as many values of an object as there are


def test_the_median_interval_is_the_percentile_bootstrap_over_objects():
    rng = np.random.default_rng(0)
    medians = [
        np.median(np.concatenate([ERRORS["abcdefgh"[i] == OBJECTS] for i in row]))
        for row in rng.integers(8, size=(RESAMPLES, 8))
    ]
    expected = np.percentile(medians, [2.5, 97.5])
    assert median_interval(ERRORS, OBJECTS) == pytest.approx(tuple(expected), abs=1e-12)
    shuffled = np.random.default_rng(1).permutation(len(ERRORS))
    assert median_interval(ERRORS[shuffled], OBJECTS[shuffled]) == median_interval(ERRORS, OBJECTS)


@pytest.mark.parametrize("at_once", [1, 7 * 8, 2**30])
def test_how_many_resamples_are_in_memory_moves_nothing(at_once):
    assert interval_of_means([VALUES], at_once) == mean_interval(VALUES)
    assert median_interval(ERRORS, OBJECTS, at_once) == median_interval(ERRORS, OBJECTS)


def test_the_jackknife_of_a_mean_is_students_interval():
    """Means without each object: (sum - x) / (n - 1). Their jackknife error is that of the mean."""
    without = (VALUES.sum() - VALUES) / (len(VALUES) - 1)
    found = jackknife_interval(VALUES.mean(), [without])
    assert found == pytest.approx(student(VALUES), abs=1e-12)
    error = jackknife_error([without])
    assert error is not None
    assert error.p_value(VALUES.mean()) == pytest.approx(stats.ttest_1samp(VALUES, 0).pvalue)


def test_variances_of_classes_add_up():
    """(g - 1) / g sum of squares: 3/4 4 = 3 and 4/5 20 = 16, over 2 classes.

    Degrees of freedom 19^2 / (3^2 / 3 + 16^2 / 4) = 361 / 67.
    """
    four, five = np.array([4.0, 6.0, 4.0, 6.0]), np.array([1.0, 3.0, 5.0, 7.0, 4.0])
    five[-1] = 4.0
    low, high = jackknife_interval(7.0, [four, five])
    reach = stats.t.ppf(0.975, 361 / 67) * np.sqrt(3 + 16) / 2
    assert (low, high) == pytest.approx((7 - reach, 7 + reach), abs=1e-12)


def test_a_distance_is_never_below_0():
    leave_one_out = np.array([1.0, 3.0, 5.0, 7.0] * 2)
    low, high = jackknife_interval(3.2, [leave_one_out])
    assert low < 0
    assert distance_interval(3.2, leave_one_out) == (0.0, high)


def test_what_no_value_can_be_is_clipped():
    """Where most values are at the end of the range, Student's interval reaches beyond it."""
    low, high = mean_interval(np.array([1.0] * 7 + [0.97]))
    assert high > 1
    assert clipped((low, high), (0.0, 1.0)) == (low, 1.0)
    assert clipped((-0.2, 0.4), (0.0, 1.0)) == (0.0, 0.4)
    assert clipped((-0.2, 1.4), (-np.inf, np.inf)) == (-0.2, 1.4)
    assert clipped((-0.2, 1.4), (0.0, np.inf)) == (0.0, 1.4)
    assert np.isnan(clipped((np.nan, np.nan), (0.0, 1.0))).all()


def test_a_bias_in_one_over_the_number_of_objects_goes():
    """3 + 5 / g of all g = 8, and 3 + 5 / 7 without each."""
    assert debiased(3 + 5 / 8, np.full(8, 3 + 5 / 7)) == pytest.approx(3.0, abs=1e-12)
    assert np.isnan(debiased(3.0, np.full(FEWEST - 1, 3.0)))
    assert np.isnan(debiased(3.0, np.array([np.nan] * 8)))


def test_without_spread_a_difference_is_certain():
    error = jackknife_error([np.full(8, 2.0)])
    assert error is not None
    assert (error.p_value(0.0), error.p_value(0.1)) == (1.0, 0.0)
    assert jackknife_interval(2.0, [np.full(8, 2.0)]) == (2.0, 2.0)


POPULATIONS = {  # true means of 0
    "normal": lambda rng, n: rng.normal(size=n),
    "exponential": lambda rng, n: rng.exponential(size=n) - 1,
    "lognormal": lambda rng, n: rng.lognormal(0, 0.5, size=n) - np.exp(0.125),
    "Student, 3": lambda rng, n: rng.standard_t(3, size=n),
}
SAMPLES = 1000


def misses(interval):
    low, high = interval
    return low > 0 or high < 0


@pytest.mark.parametrize("population", POPULATIONS)
def test_how_often_the_interval_of_eight_objects_misses_the_true_mean(population):
    rng = np.random.default_rng(1)
    draws = [POPULATIONS[population](rng, FEWEST) for _ in range(SAMPLES)]
    rate = np.mean([misses(mean_interval(values)) for values in draws])
    # 5 % is meant, three standard errors of which are 2 % here; measured: 3.2 to 6.3 %, and 12 to
    # 15 % with the percentile bootstrap
    assert 0.02 < rate < 0.08


def test_how_often_two_equal_distances_of_eight_objects_are_told_apart():
    """Two methods err alike in opposite directions, so that their distances are equal."""
    rng = np.random.default_rng(1)
    views, features = 10, 32
    objects = np.repeat(np.arange(FEWEST), views)
    away = 0.5 * np.eye(features)[0]
    wrong = 0
    for _ in range(200):
        shown = np.repeat(rng.normal(size=(FEWEST, features)), views, axis=0)
        truth, first, second = (
            JackknifeMoments(shown + offset + 0.5 * rng.normal(size=shown.shape), objects)
            for offset in (0.0, away, -away)
        )
        value = centred_to_frechet(first.whole, truth.whole) - centred_to_frechet(
            second.whole, truth.whole
        )
        without = left_out_distances(first, truth) - left_out_distances(second, truth)
        wrong += misses(jackknife_interval(value, [without]))
    assert 1 <= wrong <= 19  # 5 % of them are meant, three standard errors of which are 9
