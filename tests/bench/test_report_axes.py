from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.report.robustness import Axis, axis_of, spread

# A pixel is computed by one division and one product of numbers below 1000: far below 1e-9.
CLOSE = 1e-9


def test_a_linear_axis_is_proportional():
    axis = Axis(0.0, 1.0, 300.0, 100.0, logarithmic=False)  # upwards, as pixels of y are
    assert [axis.at(v) for v in (0.0, 0.25, 1.0)] == [300.0, 250.0, 100.0]
    assert (axis.at(-1.0), axis.at(2.0)) == (300.0, 100.0)  # what lies beyond ends at the end


def test_a_logarithmic_axis_gives_each_factor_the_same_room():
    axis = Axis(1.0, 10_000.0, 0.0, 400.0, logarithmic=True)
    assert [axis.at(v) for v in (1.0, 10.0, 100.0)] == pytest.approx([0, 100, 200], abs=CLOSE)
    assert axis.at(0.0) == 0.0


def test_ticks_are_round_and_inside():
    assert Axis(0.42, 0.83, 0.0, 41.0, logarithmic=False).ticks(6) == [
        (pytest.approx(8.0), "0.5"),
        (pytest.approx(18.0), "0.6"),
        (pytest.approx(28.0), "0.7"),
        (pytest.approx(38.0), "0.8"),
    ]
    labels = [label for _, label in Axis(0.8, 130.0, 0.0, 1.0, logarithmic=True).ticks(6)]
    assert labels == ["1", "3", "10", "30", "100"]
    labels = [label for _, label in Axis(-40.0, 40.0, 0.0, 1.0, logarithmic=False).ticks(5)]
    assert labels == ["-40", "-20", "0", "20", "40"]


def test_values_far_apart_get_a_logarithm_and_others_none():
    assert axis_of([1.0, 21.0], 0, 1).logarithmic
    assert not axis_of([1.0, 20.0], 0, 1).logarithmic
    assert not axis_of([0.0, 21.0], 0, 1).logarithmic
    forced = axis_of([0.0, 10.0, 1000.0, math.nan], 0, 1, logarithmic=True)
    assert (forced.low, forced.high) == pytest.approx((10 ** (1 - 0.12), 10 ** (3 + 0.12)))


def test_axes_of_nothing_and_of_one_value():
    assert axis_of([math.nan], 0.0, 1.0) == Axis(-0.06, 1.06, 0.0, 1.0, False)
    lonely = axis_of([0.5, 0.5], 0.0, 1.0)
    assert lonely.at(0.5) == pytest.approx(0.5)


def test_labels_are_moved_no_more_than_needed():
    assert spread([10.0, 50.0], 12.0, 0.0, 100.0) == [10.0, 50.0]
    assert spread([50.0, 52.0, 10.0], 12.0, 0.0, 100.0) == [50.0, 62.0, 10.0]
    assert spread([99.0, 100.0], 12.0, 0.0, 100.0) == [88.0, 100.0]
    assert spread([], 12.0, 0.0, 100.0) == []


@given(st.lists(st.floats(0, 300), max_size=20))
def test_labels_keep_their_order_and_their_distance(wanted):
    places = spread(wanted, 15.0, 0.0, 300.0)
    order = sorted(range(len(wanted)), key=lambda i: wanted[i])
    gaps = [places[b] - places[a] for a, b in pairwise(order)]
    assert all(gap >= 15.0 - CLOSE for gap in gaps)
    assert all(place <= 300.0 for place in places)
    if 15.0 * (len(wanted) - 1) <= 300.0:
        assert all(place >= -CLOSE for place in places)
