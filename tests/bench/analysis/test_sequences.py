"""Confidence sequences: their definition, monotone ends, and coverage at all times."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from bench.analysis.sequences import SHARES, WEIGHTS, ConfidenceSequence, intervals


def wealth(values, mean, bound):
    """Return the wealth of the bets on more than a mean, by its definition."""
    growth = 1 + SHARES[:, None] * ((values + bound) / (mean + bound) - 1)
    return float(WEIGHTS @ growth.prod(axis=1))


def test_bets_are_a_mixture_that_cannot_be_ruined():
    assert WEIGHTS.sum() == pytest.approx(1, abs=1e-12)
    assert (SHARES > 0).all()
    assert (SHARES < 1).all()
    # at fair odds: values at both ends with mean m leave the expected wealth at 1
    bound, mean = 0.5, 0.1
    share_high = (mean + bound) / (2 * bound)
    expected = share_high * wealth(np.array([bound]), mean, bound) + (1 - share_high) * wealth(
        np.array([-bound]), mean, bound
    )
    assert expected == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("mean", [0.0, 0.07, -0.2])
def test_ends_are_where_wealth_has_ever_reached_its_limit(mean):
    bound, step, alpha = 0.5, 0.01, 0.05
    values = np.clip(np.random.default_rng(3).normal(mean, 0.1, 60), -bound, bound)
    ends = intervals(values, alpha, bound, step)
    grid = step * np.arange(-49, 50)
    low, high = -bound, bound
    for count, (got_low, got_high) in enumerate(ends, 1):
        part = values[:count]
        more = [m for m in grid if wealth(part, m, bound) >= 2 / alpha]
        less = [m for m in grid if wealth(-part, -m, bound) >= 2 / alpha]
        low, high = max([low, *more]), min([high, *less])
        assert (got_low, got_high) == pytest.approx((low, high), abs=1e-12)
    assert low < mean < high
    assert high - low < 0.3


def test_equal_values_are_found_as_fast_as_the_largest_bet_can():
    """Of n values .5 within 1, 0 is left out once .25 (1 + .9 / 2)^n reaches 2 / alpha."""
    counts = [count for count in range(1, 60) if wealth(np.full(count, 0.5), 0.0, 1.0) >= 2 / 0.05]
    ends = intervals(np.full(60, 0.5), 0.05, 1.0, 0.01)
    assert int(np.argmax(ends[:, 0] >= 0)) + 1 == counts[0]
    assert counts[0] <= math.ceil(math.log(2 / 0.05 / WEIGHTS[0]) / math.log(1.45))
    assert (np.diff(ends[:, 0]) >= 0).all()
    assert (np.diff(ends[:, 1]) <= 0).all()
    assert ends[-1, 0] < 0.5 < ends[-1, 1]


def test_mirrored_values_have_mirrored_intervals():
    values = np.random.default_rng(4).uniform(-0.2, 0.4, 50)
    ends, mirrored = (intervals(x, 0.05, 0.5, 0.01) for x in (values, -values))
    assert mirrored == pytest.approx(-ends[:, ::-1], abs=1e-12)


@pytest.mark.parametrize("kind", ["two values", "skewed", "normal"])
def test_looking_after_each_object_errs_in_few_runs(kind):
    """At most 5 % of runs ever leave the mean out; 400 runs of 120 objects, three errors above."""
    rng = np.random.default_rng(5)
    drawn = {
        "two values": np.where(rng.random((400, 120)) < 0.9, 0.05, -0.45),
        "skewed": np.minimum(rng.exponential(0.1, (400, 120)), 0.5),
        "normal": np.clip(rng.normal(0, 0.1, (400, 120)), -0.5, 0.5),
    }[kind]
    mean = {"two values": 0.0, "skewed": 0.1 * (1 - math.exp(-5)), "normal": 0.0}[kind]
    ends = [intervals(values, 0.05, 0.5, 0.01)[-1] for values in drawn]
    errors = np.mean([not low <= mean <= high for low, high in ends])
    assert errors <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / 400)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((0.0, 1.0, 0.1), "alpha 0: must be between 0 and 1"),
        ((0.05, 1.0, 0.3), "bound 1: must be a multiple of the step 0.3"),
    ],
)
def test_what_it_refuses(arguments, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        ConfidenceSequence(*arguments)
    sequence = ConfidenceSequence(0.05, 0.5, 0.01)
    for value in (0.51, math.nan):
        with pytest.raises(ValueError, match=r"must be within -0\.5 and 0\.5"):
            sequence.add(value)
    assert sequence.count == 0
