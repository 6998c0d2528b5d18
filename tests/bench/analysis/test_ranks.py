from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_rel

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


def test_the_best_comes_first_and_references_have_no_rank():
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
        ("true-mesh", ""),
        ("blank", ""),
    ]


def test_equal_methods_share_a_letter_and_few_objects_have_none():
    values = {"splat": np.linspace(0.4, 0.6, 24), "pc2pix": np.linspace(0.6, 0.4, 24)}
    assert {rank.letters for rank in ranking(comparison(values), "ssim").ranks} == {"a"}
    few = ranking(comparison({method: of[:4] for method, of in values.items()}), "ssim")
    assert {rank.letters for rank in few.ranks} == {""}
    assert few.objects_needed == 8


def test_of_48_methods_the_pairs_are_resolved_that_paired_t_tests_tell_apart():
    """24 objects, 1,128 pairs: eight levels of six methods each, levels far apart.

    The data is such that no corrected p value is near 0.05, so that skewness decides nothing.
    """
    rng = np.random.default_rng(0)
    objects = rng.normal(0, 0.05, 24)
    values = {
        f"m{i:02d}": 0.3 + 0.05 * (i // 6) + objects + rng.normal(0, 0.01, 24) for i in range(48)
    }
    pairs = list(combinations(values, 2))
    of_t = [1128 * float(ttest_rel(values[a], values[b]).pvalue) for a, b in pairs]
    assert not [p for p in of_t if 0.01 < p < 0.2]
    differ = {pair for pair, p in zip(pairs, of_t, strict=True) if p < 0.05}
    assert len(differ) == 28 * 36  # every pair of two levels
    given = {rank.method: set(rank.letters) for rank in ranking(comparison(values), "ssim").ranks}
    assert {pair for pair in pairs if not given[pair[0]] & given[pair[1]]} == differ
    assert given["m42"] == {"a"}


def test_a_method_without_a_value_is_left_out():
    values = {"splat": np.full(24, np.nan), "pc2pix": np.full(24, 0.5)}
    found = ranking(comparison(values), "ssim")
    assert [rank.method for rank in found.ranks] == ["pc2pix"]
    assert found.ranks[0].letters == ""
