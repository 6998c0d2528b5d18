from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.analysis.ranks import letters, ranking


def pairs(*names):
    return {frozenset(pair) for pair in names}


@pytest.mark.parametrize(
    ("differ", "expected"),
    [
        ((), {"A": "a", "B": "a", "C": "a"}),
        (("AB", "AC", "BC"), {"A": "a", "B": "b", "C": "c"}),
        (("AC",), {"A": "a", "B": "ab", "C": "b"}),  # a tie is not transitive
        (("AB", "AC"), {"A": "a", "B": "b", "C": "b"}),
        (("AB",), {"A": "a", "B": "b", "C": "ab"}),  # worst, and yet not shown to be
    ],
)
def test_letters_by_hand(differ, expected):
    assert letters("ABC", pairs(*differ)) == expected


@given(st.integers(1, 8), st.data())
def test_two_share_a_letter_exactly_where_they_do_not_differ(count, data):
    names = "ABCDEFGH"[:count]
    every = list(combinations(names, 2))
    differ = pairs(*data.draw(st.lists(st.sampled_from(every), unique=True)) if every else ())
    found = letters(names, differ)
    for a, b in every:
        assert bool(set(found[a]) & set(found[b])) == (frozenset((a, b)) not in differ)
    of_group = {c: {m for m in names if c in found[m]} for c in set("".join(found.values()))}
    for one, other in combinations(of_group.values(), 2):  # no letter says nothing new
        assert not one <= other
        assert not other <= one


def comparison(values):
    """A comparison of methods whose scores [G] are these."""
    count = len(next(iter(values.values())))
    qualities = {
        method: Quality("ssim", Estimate(float(np.mean(v)), 0.0, 1.0), np.array(v, np.float64))
        for method, v in values.items()
    }
    return Comparison(
        "2048", "chair", tuple(map(str, range(count))), {}, {}, {}, {"ssim": qualities}
    )


def test_the_best_comes_first_and_ceilings_are_left_out():
    noise = np.random.default_rng(0).normal(0, 0.01, (2, 24))
    values = {
        "splat": 0.5 + noise[0],
        "true-mesh": np.ones(24),
        "pc2pix": 0.8 + noise[1],
        "blank": np.full(24, 0.1),
    }
    found = ranking(comparison(values), "ssim")
    assert [(rank.method, rank.letters) for rank in found.ranks] == [
        ("pc2pix", "a"),
        ("splat", "b"),
        ("blank", "c"),
    ]
    assert len(found.pairs) == 3
    assert [rank.first for rank in found.ranks] == [True, False, False]
    assert found.of("splat") == found.ranks[1]
    assert found.of("true-mesh") is None


def test_equal_methods_share_a_letter_and_few_objects_have_none():
    values = {"splat": np.linspace(0.4, 0.6, 24), "pc2pix": np.linspace(0.6, 0.4, 24)}
    assert {rank.letters for rank in ranking(comparison(values), "ssim").ranks} == {"a"}
    few = {method: of[:4] for method, of in values.items()}
    assert {rank.letters for rank in ranking(comparison(few), "ssim").ranks} == {""}


def test_a_method_without_a_value_is_left_out():
    values = {"splat": np.full(24, np.nan), "pc2pix": np.full(24, 0.5)}
    found = ranking(comparison(values), "ssim")
    assert [rank.method for rank in found.ranks] == ["pc2pix"]
    assert found.ranks[0].letters == ""
