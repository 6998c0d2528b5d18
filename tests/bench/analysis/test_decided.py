"""Headline pairs: which there are, what they count, and when they are decided."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.decided import (
    BOUNDS,
    STEP,
    DecidedPairs,
    HeadlinePair,
    headline_pairs,
)
from bench.analysis.object_sums import ObjectSums
from bench.analysis.sequences import ConfidenceSequence
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES

from ..builders import make_failed, make_record

SUITE = find("chair-robustness", SUITES, "suite")
HEADLINE = ("ssim-object", "lpips")
PAIR = HeadlinePair("splat-net", "alpha-wrap", "2048", "ssim-object")


def test_networks_meet_the_best_reconstruction_of_each_condition():
    methods = ["pc2pix", "splat-net", "denoised-wrap", "alpha-wrap", "splat", "true-mesh", "blank"]
    pairs = headline_pairs(SUITE, methods, ["2048", "noise-0.10", "unknown"], HEADLINE)
    assert pairs == [
        HeadlinePair(network, opponent, condition, metric)
        for condition, opponent in (("2048", "alpha-wrap"), ("noise-0.10", "denoised-wrap"))
        for network in ("pc2pix", "splat-net")
        for metric in HEADLINE
    ]
    assert headline_pairs(SUITE, methods, ["2048"], ["lpips", "ssim"]) == [
        HeadlinePair(network, "alpha-wrap", "2048", "lpips") for network in ("pc2pix", "splat-net")
    ]
    assert headline_pairs(SUITE, ["splat-net", "blank"], ["2048"], HEADLINE) == []
    assert headline_pairs(SUITE, ["alpha-wrap", "splat", "blank"], ["2048"], HEADLINE) == []


def test_means_of_an_object_score_failed_images_as_blank_ones():
    records = [
        make_record("blank", view=0, ssim_object=0.1, lpips=0.6),
        make_record("blank", view=1, ssim_object=0.3, lpips=0.8),
        make_record("splat", view=0, ssim_object=0.9, lpips=0.2),
        make_failed("splat", view=1),
        make_record("poisson", view=0, ssim_object=None, lpips=0.4),
        make_record("poisson", view=1, ssim_object=0.5, lpips=0.6),
        make_failed("poisson", view=2),  # no blank image stands in: it does not count
    ]
    methods = ("blank", "splat", "poisson")
    sums = ObjectSums(methods, ("2048",), ("chair/a",), HEADLINE)
    sums.add_object(records)
    expected = {
        ("blank", "2048", "ssim-object"): 0.2,
        ("blank", "2048", "lpips"): 0.7,
        ("splat", "2048", "ssim-object"): 0.6,
        ("splat", "2048", "lpips"): 0.5,
        ("poisson", "2048", "ssim-object"): 0.5,
        ("poisson", "2048", "lpips"): 0.5,
    }
    assert sums.means_of("chair/a", HEADLINE) == pytest.approx(expected, abs=1e-12)


def means_of(difference, metric="ssim-object"):
    return {("splat-net", "2048", metric): 0.4 + difference, ("alpha-wrap", "2048", metric): 0.4}


def decide(differences, metric="ssim-object", alpha=0.05):
    decided = DecidedPairs([PAIR._replace(metric=metric)], ["chair"], alpha)
    for difference in differences:
        decided.add("chair", means_of(difference, metric))
    return decided


@pytest.mark.parametrize(
    ("metric", "difference", "verdict"),
    [
        ("ssim-object", 0.2, "ahead"),
        ("ssim-object", -0.2, "behind"),
        ("lpips", -0.1, "ahead"),  # less of a distance is better
        ("lpips", 0.1, "behind"),
        ("ssim-object", 0.0, "open"),
    ],
)
def test_verdicts_are_in_favour_of_what_is_better(metric, difference, verdict):
    decided = decide([difference] * 30, metric)
    (state,) = decided.states
    assert state.verdict == verdict
    assert decided.all_decided == (verdict != "open")
    sign = -1 if metric == "lpips" else 1
    assert state.mean == pytest.approx(sign * difference, abs=1e-12)
    if verdict != "open":
        assert decide([difference] * state.decided_after, metric).all_decided
        assert not decide([difference] * (state.decided_after - 1), metric).all_decided


def test_small_differences_become_equal():
    rng = np.random.default_rng(0)
    (state,) = decide(rng.normal(0.002, 0.01, 1500)).states
    assert state.verdict == "equal"
    assert -0.01 <= state.sequence.low <= 0.002 <= state.sequence.high <= 0.01


def test_a_verdict_stays():
    """Objects that come afterwards do not take it back, though they are counted."""
    decided = decide([0.2] * 40 + [-0.2] * 40)
    (state,) = decided.states
    assert (state.verdict, state.sequence.count) == ("ahead", 80)
    assert state.mean == pytest.approx(0.0, abs=1e-12)


def test_differences_beyond_the_bound_count_as_the_bound():
    (state,) = decide([0.9, -0.7, 0.5, 0.2]).states
    assert (state.beyond, state.mean) == (2, pytest.approx(0.225))
    expected = ConfidenceSequence(0.05, BOUNDS["ssim-object"], STEP)
    for value in (0.5, -0.5, 0.5, 0.2):
        expected.add(value)
    assert (state.sequence.low, state.sequence.high) == (expected.low, expected.high)


def test_all_pairs_share_the_rate_of_error():
    pairs = [PAIR, *(PAIR._replace(condition=c) for c in ("1024", "512", "noise-0.05"))]
    shared = DecidedPairs(pairs, ["chair"])
    single = DecidedPairs([PAIR], ["chair"], alpha=0.05 / 4)
    for _ in range(25):
        shared.add("chair", means_of(0.1))
        single.add("chair", means_of(0.1))
    (alone,) = single.states
    assert shared.states[0].sequence.low == alone.sequence.low > -BOUNDS["ssim-object"]
    assert [state.sequence.count for state in shared.states] == [25, 0, 0, 0]
    assert math.isnan(shared.states[1].mean)
    assert not shared.all_decided


def test_classes_count_alike_by_turns():
    decided = DecidedPairs([PAIR], ["chair", "car"])
    for class_name, difference in (("chair", 0.1), ("chair", 0.3), ("car", 0.2), ("chair", 0.5)):
        decided.add(class_name, means_of(difference))
    (state,) = decided.states
    assert (state.sequence.count, state.mean) == (1, pytest.approx(0.15))
    decided.add("car", means_of(-0.1))
    assert (state.sequence.count, state.mean) == (2, pytest.approx(0.125))


def test_an_object_without_a_value_is_not_counted():
    decided = DecidedPairs([PAIR], ["chair"])
    decided.add("chair", {("splat-net", "2048", "ssim-object"): 0.5})
    assert decided.states[0].sequence.count == 0
