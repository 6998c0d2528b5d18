from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.suites.speed.summary import BreakEven, Cost, break_even

NETWORK = Cost(prepare=10.0, draw_one=110.0, draw_batch=1200.0, batch=20)


def test_calls_are_as_measured_and_grow_evenly_between():
    assert NETWORK.total(1) == 10 + 110
    assert NETWORK.total(20) == 10 + 1200
    assert NETWORK.total(60) == 10 + 3 * 1200
    assert NETWORK.per_image(40) == (10 + 2 * 1200) / 40
    cost = Cost(prepare=5.0, draw_one=10.0, draw_batch=48.0, batch=20)  # 10, 12, 14, ... 48
    assert [cost.total(v) for v in (2, 3, 19)] == pytest.approx([17, 19, 51])
    assert cost.per_image(2) == pytest.approx(8.5)
    single = Cost(prepare=5.0, draw_one=2.0, draw_batch=2.0, batch=1)
    assert [single.total(v) for v in (1, 2, 10)] == [7, 9, 25]


def test_two_break_evens():
    """11 + (V - 1) against 6 + 17/9 (V - 1) up to 10 views: equal at 6 5/8. Beyond them 2 V
    against 5 + 1.8 V: equal at 25."""
    good_at_batches = Cost(prepare=0.0, draw_one=11.0, draw_batch=20.0, batch=10)
    other = Cost(prepare=5.0, draw_one=1.0, draw_batch=18.0, batch=10)
    equal = (pytest.approx(6.625), pytest.approx(25))
    assert break_even(good_at_batches, other) == BreakEven("between", equal)
    assert break_even(other, good_at_batches) == BreakEven("outside", equal)


@pytest.mark.parametrize("batch", [1, 20])
def test_always_and_never(batch):
    cheap = Cost(1.0, 2.0, 2.0 * batch, batch)
    costly = Cost(2.0, 3.0, 3.0 * batch, batch)
    assert break_even(cheap, costly) == BreakEven("always", ())
    assert break_even(costly, cheap) == BreakEven("never", ())
    assert break_even(cheap, cheap) == BreakEven("never", ())
    # the same draw leaves the preparation to decide
    same_draw = Cost(1.0, 3.0, 60.0, 20), Cost(2.0, 3.0, 60.0, 20)
    assert break_even(*same_draw) == BreakEven("always", ())


def test_a_tie_is_decided_by_what_follows():
    """3 + 2 V against 1 + 4 V: both 5 at one view; against the third also both 23 at ten."""
    first, second = Cost(3.0, 2.0, 20.0, 10), Cost(1.0, 4.0, 40.0, 10)
    third = Cost(1.0, 4.0, 22.0, 10)
    assert first.total(1) == second.total(1) == third.total(1) == 5
    assert first.total(10) == third.total(10) == 23
    for other in (second, third):
        assert break_even(first, other) == BreakEven("always", ())
        assert break_even(other, first) == BreakEven("never", ())


def test_different_batches_are_not_compared():
    with pytest.raises(ValueError, match="batches of 20 and of 10"):
        break_even(NETWORK, Cost(1.0, 1.0, 1.0, 10))


times = st.floats(0.01, 100.0)


@st.composite
def costs(draw):
    return Cost(draw(times), draw(times), draw(times), 20)


@given(costs(), costs())
def test_the_verdict_is_what_the_totals_say(cost, rival):
    """Against the totals themselves, between and beyond the break-evens."""
    result = break_even(cost, rival)
    swapped = break_even(rival, cost)
    assert result.views == pytest.approx(swapped.views)
    edges = [1.0, *result.views, 2 * max((20.0, *result.views))]
    assert edges == sorted(edges)
    signs = []
    for low, high in pairwise(edges):
        middle = math.sqrt(low * high)
        signs.append(cost.total(middle) < rival.total(middle))
    expected = {
        "always": [True],
        "never": [False],
        "up to": [True, False],
        "from": [False, True],
        "between": [False, True, False],
        "outside": [True, False, True],
    }
    narrow = any(high - low < 1e-6 * high for low, high in pairwise(edges))
    nearly = abs(cost.total(20) - rival.total(20)) < 1e-9 * cost.total(20)
    assert narrow or nearly or signs == expected[result.cheaper]
