from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.ranks import letters, mean_places, ranking

from .comparisons import comparison


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


def ranked(values):
    """The letters of methods with these scores [G], the best first, and the objects needed."""
    made, needed = ranking(comparison({m: (0, 0, v) for m, v in values.items()}))
    return dict(zip(made["method"], made["letters"], strict=True)), needed


def test_the_best_comes_first_and_references_have_no_rank():
    noise = np.random.default_rng(0).normal(0, 0.01, (2, 24))
    values = {
        "splat": 0.5 + noise[0],
        "true-mesh": np.ones(24),
        "pc2pix": 0.8 + noise[1],
        "blank": np.full(24, 0.1),
    }
    assert list(ranked(values)[0].items()) == [
        ("pc2pix", "a"),
        ("splat", "b"),
        ("true-mesh", ""),
        ("blank", ""),
    ]


def test_equal_methods_share_a_letter_and_few_objects_have_none():
    values = {"splat": np.linspace(0.4, 0.6, 24), "pc2pix": np.linspace(0.6, 0.4, 24)}
    assert ranked(values) == ({"splat": "a", "pc2pix": "a"}, None)
    few = {method: of[:4] for method, of in values.items()}
    assert ranked(few) == ({"splat": "", "pc2pix": ""}, 8)


def test_a_method_without_a_value_is_left_out():
    values = {"splat": np.full(24, np.nan), "pc2pix": np.full(24, 0.5)}
    assert ranked(values) == ({"pc2pix": ""}, None)


def test_places_are_averaged_over_columns_and_equal_ones_shared():
    columns = [
        ("ssim-object", {"a": 0.9, "b": 0.8, "c": 0.8004, "blank": 1.0}),  # c: .800 as printed
        ("lpips", {"a": 0.3, "b": 0.1, "c": 0.2}),
    ]
    assert mean_places(columns, "abc") == pytest.approx({"a": 2, "b": 1.75, "c": 2.25})


def test_a_place_among_fewer_methods_is_stretched_to_all():
    columns = [("lpips", {"a": 0.1, "b": 0.2, "c": 0.3}), ("lpips", {"a": 0.2, "d": 0.1})]
    assert mean_places(columns, "abcd") == pytest.approx(
        {"a": 1 + 3 / 2, "b": 1 + 3 / 2, "c": 4, "d": 1}
    )
    assert mean_places([], ["a"]) == {}
