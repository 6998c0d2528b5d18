from __future__ import annotations

from itertools import islice, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rendering.delta_debugging import ever_smaller


class Trials:
    """A predicate, asked `at_once` sets at a time; remembers every set that it was offered."""

    def __init__(self, fails, at_once=1):
        self.fails, self.at_once = fails, at_once
        self.offered = []

    def __call__(self, candidates):
        candidates = iter(candidates)
        while some := list(islice(candidates, self.at_once)):
            self.offered += [tuple(rows) for rows in some]
            failing = [rows for rows in some if self.fails(frozenset(rows.tolist()))]
            if failing:
                return failing[0]
        return None


def sets_of(count, trials):
    """All sets on the way, the whole at their head; what holds of every search is checked."""
    sets = [tuple(range(count)), *(tuple(rows) for rows in ever_smaller(count, trials))]
    for larger, smaller in pairwise(sets):
        assert set(smaller) < set(larger)
        assert list(smaller) == sorted(smaller)
        assert trials.fails(frozenset(smaller))
    assert len(set(trials.offered)) == len(trials.offered)
    assert sets[0] not in trials.offered
    return sets


@st.composite
def culprits_among(draw, most=120):
    count = draw(st.integers(1, most))
    return count, frozenset(draw(st.sets(st.integers(0, count - 1), max_size=count)))


@given(culprits_among(), st.integers(1, 5))
def test_known_culprits_are_found_exactly(case, at_once):
    count, culprits = case
    assert sets_of(count, Trials(culprits.issubset, at_once))[-1] == tuple(sorted(culprits))


@given(st.integers(1, 100), st.integers(0, 100), st.integers(1, 5))
def test_any_so_many_rows(count, enough, at_once):
    enough = min(enough, count)
    assert len(sets_of(count, Trials(lambda rows: len(rows) >= enough, at_once))[-1]) == enough


@given(st.integers(1, 60), st.integers(0, 2**32), st.integers(2, 5))
def test_where_failing_is_not_monotone_the_last_set_is_1_minimal(count, seed, at_once):
    """A coin for every set, the same whenever it is asked."""

    def fails(rows):
        coin = np.random.default_rng([seed, *sorted(rows)]).random() < 0.3
        return len(rows) == count or (len(rows) > 0 and bool(coin))

    sets = sets_of(count, Trials(fails))
    assert not any(fails(frozenset(sets[-1]) - {row}) for row in sets[-1])
    assert sets_of(count, Trials(fails, at_once)) == sets


def test_pairs_that_need_each_other():
    """Rows count as pairs only: no single row can go before its partner is there to go with it."""
    trials = Trials(lambda rows: 6 in rows and all(row ^ 1 in rows for row in rows))
    assert sets_of(8, trials)[-1] == (6, 7)


def test_what_fails_without_any_rows_needs_one_trial():
    trials = Trials(lambda rows: True)
    assert sets_of(2048, trials) == [tuple(range(2048)), ()]
    assert trials.offered == [()]


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_where_every_row_is_needed_nothing_is_yielded(count):
    trials = Trials(lambda rows: len(rows) == count)
    assert sets_of(count, trials) == [tuple(range(count))]


def test_one_culprit_costs_a_logarithm():
    """Nothing, then at most both halves at each of the 11 levels."""
    for culprit in (0, 1, 1023, 1024, 2047):
        trials = Trials({culprit}.issubset)
        assert sets_of(2048, trials)[-1] == (culprit,)
        assert len(trials.offered) <= 1 + 2 * 11


def test_the_worst_case_is_that_of_the_paper():
    """Zeller and Hildebrandt, proposition 12: at most n^2 + 3 n trials."""
    count = 64
    trials = Trials(frozenset(range(0, count, 2)).issubset)
    assert len(sets_of(count, trials)[-1]) == count // 2
    assert len(trials.offered) <= count**2 + 3 * count
