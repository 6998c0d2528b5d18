from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_rel

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.analysis.paired import holm
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
    assert len(found.pairs) == 6
    assert [rank.first for rank in found.ranks] == [True, False, False, False]


def test_reference_methods_cost_the_others_nothing():
    """The p value of two methods is corrected for one pair, whatever they are shown beside."""
    scores = {"splat": np.linspace(0.5, 0.6, 8), "pc2pix": np.linspace(0.6, 0.8, 8)}
    references = {"true-mesh": np.ones(8), "blank": np.zeros(8), "constant": np.full(8, 0.1)}
    found = ranking(comparison(scores | references), "ssim")
    assert found.pairs[0].p_holm == 2 / 2**8
    assert [rank.letters for rank in found.ranks] == ["a", "b", "", "", ""]
    # nine pairs with a reference: 2^-7 x 9 is .07
    assert {pair.objects_needed for pair in found.pairs[1:]} == {9}


def test_equal_methods_share_a_letter_and_few_objects_have_none():
    values = {"splat": np.linspace(0.4, 0.6, 24), "pc2pix": np.linspace(0.6, 0.4, 24)}
    assert {rank.letters for rank in ranking(comparison(values), "ssim").ranks} == {"a"}
    few = ranking(comparison({method: of[:4] for method, of in values.items()}), "ssim")
    assert {rank.letters for rank in few.ranks} == {""}
    assert few.objects_needed == 8


def test_too_few_objects_for_so_many_pairs_have_no_letters():
    """Ten pairs of five methods, far apart: 2^-7 x 10 is .078, 2^-8 x 10 is .039."""
    noise = np.random.default_rng(1).normal(0, 0.01, (5, 9))
    values = {f"m{i}": 0.1 * i + of for i, of in enumerate(noise)}
    found = ranking(comparison({m: of[:8] for m, of in values.items()}), "ssim")
    assert {rank.letters for rank in found.ranks} == {""}
    assert found.objects_needed == 9
    assert {pair.ahead for pair in found.pairs} == {"unknown"}
    enough = ranking(comparison(values), "ssim")
    assert [rank.letters for rank in enough.ranks] == ["a", "b", "c", "d", "e"]
    assert enough.objects_needed is None


def test_twins_do_not_give_letters_to_too_few_objects():
    """Equal on every object is a tie with any number of objects, but decides no rank."""
    scores = np.linspace(0.4, 0.6, 8)
    values = {f"m{i}": 0.1 * i + scores**i for i in range(1, 6)} | {"twin": 0.1 + scores}
    found = ranking(comparison(values), "ssim")
    assert [pair.ahead for pair in found.pairs].count("tie") == 1
    assert {rank.letters for rank in found.ranks} == {""}


def test_of_48_methods_as_many_pairs_are_resolved_as_by_paired_t_tests():
    """24 objects, 1,128 pairs: eight levels of six methods each, levels far apart.

    The data is such that no corrected p value of the t tests is near 0.05, where random signs and
    Student's distribution may disagree.
    """
    rng = np.random.default_rng(0)
    objects = rng.normal(0, 0.05, 24)
    values = {
        f"m{i:02d}": 0.3 + 0.05 * (i // 6) + objects + rng.normal(0, 0.01, 24) for i in range(48)
    }
    pairs = list(combinations(values, 2))
    of_t = holm([float(ttest_rel(values[a], values[b]).pvalue) for a, b in pairs])
    assert not [p for p in of_t if 0.01 < p < 0.2]
    expected = {frozenset(pair) for pair, p in zip(pairs, of_t, strict=True) if p < 0.05}
    found = ranking(comparison(values), "ssim")
    resolved = {
        frozenset((p.pair.a.method, p.pair.b.method)) for p in found.pairs if p.ahead in ("a", "b")
    }
    assert resolved == expected
    assert len(expected) == 28 * 36  # every pair of two levels
    assert {rank.letters for rank in found.ranks[:6]} == {"a"}


def test_a_method_without_a_value_is_left_out():
    values = {"splat": np.full(24, np.nan), "pc2pix": np.full(24, 0.5)}
    found = ranking(comparison(values), "ssim")
    assert [rank.method for rank in found.ranks] == ["pc2pix"]
    assert found.ranks[0].letters == ""
