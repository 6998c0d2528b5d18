"""Precision and recall of features: closed forms, and the definition spelled out."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrics.frechet import EXACT_OBJECTS, object_blocks
from bench.metrics.precision_recall import NEIGHBOURS, left_out_shares, share_within


def features(seed, n, d):
    return np.random.default_rng(seed).standard_normal((n, d)).astype(np.float32)


def spelled_out(x, y, k):
    """The definition of Kynkaanniemi et al. 2019, equations 1 and 2, row by row."""
    x, y = x.astype(float), y.astype(float)
    inside = 0
    for row in x:
        for centre in y:
            to_others = sorted(np.sqrt(((centre - y) ** 2).sum(axis=1)))
            if np.sqrt(((row - centre) ** 2).sum()) <= to_others[k]:  # the 0th is itself
                inside += 1
                break
    return inside / len(x)


@pytest.mark.parametrize(("n", "m", "d", "k"), [(9, 5, 1, 3), (40, 30, 5, 3), (25, 25, 8, 10)])
def test_the_definition_spelled_out(n, m, d, k):
    x, y = 1.3 * features(0, n, d) + 0.2, features(1, m, d)
    shares = share_within(x, y, k), share_within(y, x, min(k, n - 1))
    assert shares == (spelled_out(x, y, k), spelled_out(y, x, min(k, n - 1)))
    assert 0 < shares[0] < 1


def test_points_on_a_line():
    """With k = 2 the balls about 0, 1, ..., 9 reach 2 at the ends and 1 between: -2 to 11."""
    true = np.arange(10.0)[:, None]
    drawn = np.array([-2.1, -2.0, 0.5, 11.0, 11.1])[:, None]
    assert share_within(drawn, true, 2) == 3 / 5
    # Balls about the drawn: -2.1, -2 and .5 reach 2.6, 2.5, 2.6; 11 and 11.1 reach 10.5 and 10.6.
    assert share_within(true, drawn, 2) == 1


def test_mode_collapse_has_precision_and_no_recall():
    """All draw one of four kinds well: they look true, and three kinds of four are not there."""
    kinds = np.repeat(np.eye(4) * 100, 30, axis=0)
    true, drawn = kinds + features(2, 120, 4), kinds[:1] + features(3, 120, 4)
    assert share_within(drawn, true) > 0.8
    assert 0.2 < share_within(true, drawn) <= 0.25
    assert share_within(true, np.zeros((120, 4))) == 0


def test_identical_sets_and_equal_rows():
    rows = features(4, 20, 3)
    assert share_within(rows, rows) == 1
    equal = np.full((20, 3), 0.1, np.float32)  # balls of radius 0 have their centre
    assert share_within(equal, equal) == 1
    assert share_within(equal + 1, equal) == 0
    assert share_within(rows[::-1], rows) == 1


@pytest.mark.parametrize("k", [1, 3, 6])
def test_leaving_out_an_object_is_leaving_out_its_rows(k):
    x, y = 2.5 * features(7, 30, 3) + 0.5, features(8, 30, 3)
    objects_x, objects_y = (np.random.default_rng(seed).choice(list("abcd"), 30) for seed in (0, 1))
    objects_y[0] = "e"  # an object that x does not have
    actual = left_out_shares(x, y, objects_x, objects_y, k)
    expected = [share_within(x[objects_x != n], y[objects_y != n], k) for n in "abcde"]
    assert actual.tolist() == expected
    assert len(set(expected)) > 2


def test_more_rows_than_fit_at_once_and_blocks_of_objects():
    x, y = features(9, 2100, 2), features(10, 1100, 2) + 1
    objects_x, objects_y = np.arange(2100) % (EXACT_OBJECTS + 10), np.arange(1100) % 7
    actual = left_out_shares(x, y, objects_x, objects_y)
    _, block = object_blocks(objects_x)
    assert len(actual) == 24  # three of 70 objects together, or two
    kept_x, kept_y = block[objects_x] != 5, block[objects_y] != 5
    assert actual[5] == share_within(x[kept_x], y[kept_y])


def test_an_object_that_leaves_too_little():
    x, y = features(11, 14, 2), features(12, 14, 2)
    objects = np.repeat(["a", "b"], [4, 10])
    assert np.isnan(left_out_shares(x, y, objects, objects)[0])  # of y 10 rows, of which k = 10
    assert np.isnan(left_out_shares(x, y, np.full(14, "a"), objects)[0])  # of x none


@pytest.mark.parametrize(
    ("x", "said"),
    [
        (np.zeros((NEIGHBOURS, 3)), r"features must be \[n, d\] with n > 10, got \[10, 3\]"),
        (np.zeros((20, 0)), r"got \[20, 0\]"),
        (np.zeros(20), r"got \[20\]"),
        (np.full((20, 3), np.nan), "features must be finite"),
        (np.zeros((20, 4)), "sets of 4 and 3 features cannot be compared"),
    ],
)
def test_what_it_refuses(x, said):
    with pytest.raises(ValueError, match=said):
        share_within(x, np.zeros((20, 3)))
