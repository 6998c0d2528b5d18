"""The smallest difference that a comparison could show: closed forms, levels, and cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import nct, t

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.analysis.intervals import StandardError
from bench.analysis.paired import (
    SIGNIFICANCE,
    ComparedPair,
    Side,
    holm,
    paired_differences,
)
from bench.analysis.resolution import (
    POWER,
    cell_levels,
    cell_resolutions,
    detectable,
    difference_error,
)


def quality(values, metric="ssim-object"):
    values = np.asarray(values, float)
    return Quality(metric, Estimate(float(np.nanmean(values)), math.nan, math.nan), values)


def test_student_s_quantiles_times_the_error():
    """Nine objects that differ by 1 to 9: sd sqrt(7.5), t_8 of .975 is 2.306004 and of .8 0.888890.

    The quantiles are those of printed tables.
    """
    differences = np.arange(1.0, 10.0)
    error = difference_error([quality(differences)], [quality(np.zeros(9))])
    assert error == pytest.approx((math.sqrt(7.5) / 3, 8))
    expected = (2.306004 + 0.888890) * math.sqrt(7.5) / 3
    assert detectable(error, 0.05) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("objects", "tolerance"), [(12, 0.001), (24, 0.0005), (100, 0.0005)])
def test_the_paired_t_test_shows_it_with_that_power(objects, tolerance):
    """The formula is the usual approximation of the noncentral t distribution, which is exact."""
    error = StandardError(1.0, objects - 1)
    least = detectable(error, SIGNIFICANCE)
    critical = t.ppf(1 - SIGNIFICANCE / 2, objects - 1)
    power = nct.sf(critical, objects - 1, least) + nct.cdf(-critical, objects - 1, least)
    assert power == pytest.approx(POWER, abs=tolerance)


def test_too_few_objects_and_equal_ones_have_none():
    seven, eight = (quality(np.arange(float(n))) for n in (7, 8))
    assert difference_error([seven], [quality(np.zeros(7))]) is None
    assert math.isnan(detectable(None, 0.05))
    assert difference_error([eight], [quality(np.zeros(8))]) is not None
    same = difference_error([eight], [eight])
    assert same is not None
    assert math.isnan(detectable(same, 0.05))
    assert difference_error([], []) is None
    lacking = quality([1.0, 3.0, *[math.nan] * 6])  # two objects have a value
    assert difference_error([lacking], [quality(np.zeros(8))]) is None


def test_a_distance_of_sets_has_the_error_of_its_jackknife():
    """The squared error of left-out distances 0, ..., 7 is (g - 1) / g times their squares, 42."""
    distance = quality(np.arange(8.0), "fd-views")
    error = difference_error([distance], [quality(np.zeros(8), "fd-views")])
    assert error == pytest.approx((math.sqrt(7 / 8 * 42), 7))


def test_levels_are_those_at_which_holm_decides():
    """A level is the p value of a cell at which its verdict changes, all others as they are."""
    p_values = [0.001, 0.2, math.nan, 0.012, 0.04, 0.9]
    levels = cell_levels(p_values, SIGNIFICANCE)
    assert math.isnan(levels[2])
    for i in (0, 1, 3, 4, 5):
        for factor, is_decided in ((1 - 1e-9, True), (1 + 1e-9, False)):
            moved = [*p_values[:i], levels[i] * factor, *p_values[i + 1 :]]
            assert (holm(moved)[i] < SIGNIFICANCE) == is_decided
    # Of five tests 0.001 and 0.012 are rejected, so that the others are tested at .05 / 3.
    assert levels[1] == levels[4] == levels[5] == SIGNIFICANCE / 3


def pair(a, b, metric="ssim-object"):
    sides = Side("run", "a"), Side("run", "b")
    return ComparedPair("2048", "chair", *sides, quality(a, metric), quality(b, metric), len(a))


def test_a_comparison_says_what_each_cell_could_show():
    rng = np.random.default_rng(0)
    a, noise = rng.random(24), rng.normal(0, 0.05, 24)
    tie, shown = paired_differences([pair(a, a + noise - noise.mean()), pair(a, a + noise + 0.5)])
    assert (tie.ahead, shown.ahead) == ("tie", "b")
    error = noise.std(ddof=1) / math.sqrt(24)
    # The other cell is decided: the tie is tested at .05, and without it the other at .025.
    for cell, level in ((tie, 0.05), (shown, 0.025)):
        least = (t.ppf(1 - level / 2, 23) + t.ppf(0.8, 23)) * error
        assert cell.resolution == pytest.approx(least, rel=1e-9)
    assert tie.turned().resolution == tie.resolution
    few, same = paired_differences([pair(a[:7], a[:7] + noise[:7]), pair(a, a)])
    assert math.isnan(few.resolution)
    assert math.isnan(same.resolution)


def comparison(class_name, values, metric="lpips"):
    qualities = {method: quality(of_method, metric) for method, of_method in values.items()}
    none = dict.fromkeys(values, np.zeros(0))
    objects = tuple(map(str, range(len(next(iter(values.values()))))))
    images = dict.fromkeys(values, (1, 1))
    return Comparison("2048", class_name, objects, none, none, images, {metric: qualities})


def test_methods_are_compared_with_the_best_of_their_cell_and_it_with_the_next():
    """The ceiling and the floor do not compete; less of lpips is better."""
    rng = np.random.default_rng(1)
    values = {
        "splat": 0.3 + 0.1 * rng.random(12),
        "poisson": 0.2 + 0.1 * rng.random(12),
        "alpha-wrap": 0.5 + 0.1 * rng.random(12),
        "true-mesh": 0.01 * rng.random(12),
    }
    (cell,) = cell_resolutions([comparison("chair", values)], ["lpips"], 0.05)
    assert (cell.metric, cell.class_name, cell.condition) == ("lpips", "chair", "2048")
    assert cell.best == "poisson"
    reach = t.ppf(0.975, 11) + t.ppf(0.8, 11)
    for method, other in (
        *(("splat", "poisson"), ("poisson", "splat"), ("alpha-wrap", "poisson")),
        ("true-mesh", "poisson"),
    ):
        error = (values[method] - values[other]).std(ddof=1) / math.sqrt(12)
        assert cell.by_method[method] == pytest.approx(reach * error, rel=1e-9)
    alone = {"splat": values["splat"], "true-mesh": values["true-mesh"]}
    assert cell_resolutions([comparison("chair", alone)], ["lpips"], 0.05) == []


def test_means_over_classes_add_the_errors_of_classes():
    """Two classes of as many objects and the same spread: half of the sum of the variances."""
    a, b = np.arange(8.0), np.zeros(8)
    classes = [comparison(name, {"splat": a, "poisson": b}) for name in ("chair", "table")]
    (cell,) = cell_resolutions(classes, ["lpips"], 0.05, "average")
    assert cell.class_name == "average"
    error = math.sqrt(2 * 6 / 8) / 2  # the variance of 0, ..., 7 is 6
    least = (t.ppf(0.975, 14) + t.ppf(0.8, 14)) * error
    assert cell.by_method["splat"] == pytest.approx(least, rel=1e-9)
    by_class = cell_resolutions(classes, ["lpips"], 0.05)
    assert [c.class_name for c in by_class] == ["chair", "table"]
