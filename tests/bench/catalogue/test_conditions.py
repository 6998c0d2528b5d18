"""Names of conditions in words, and families of conditions."""

from __future__ import annotations

import numpy as np
import pytest

from bench.catalogue.conditions import (
    CONDITIONS,
    FAMILIES,
    axis_positions,
    condition_name,
    conditions_in_words,
    families_of,
)
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from data_prep.clouds.conditions import (
    GaussianNoise,
    Missing,
    MorePoints,
    Outliers,
    Stride,
    UnevenDensity,
)
from data_prep.scene import CLOUD_SIZE
from learning.clouds import MAX_NOISE, POINTS_SEEN


def test_conditions_in_words():
    for condition, words, brief in (
        ("2048", "2,048 points", "2,048"),
        ("512", "512 of 2,048 points", "512"),
        ("noise-0.10", "noise 10 % of the radius", "noise 10 %"),
        ("outliers-0.01", "1 % outliers", "outliers 1 %"),
        ("missing-0.50", "50 % missing on one side", "missing 50 %"),
        ("8192", "8,192 points", "8,192"),
        ("one-side", "seen from one side", "scan from one side"),
        ("three-views", "seen from 3 sides", "scan from 3 sides"),
        ("density-10", "1,024 points, 10 times as dense at one end", "density 10 : 1"),
        ("of-a-plug-in", "of-a-plug-in", "of-a-plug-in"),
    ):
        name = condition_name(condition)
        assert (name.words, name.brief) == (words, brief)


def test_conditions_of_a_kind_stand_together():
    every = ("2048", "512", "noise-0.05", "noise-0.10", "outliers-0.01")
    assert np.diff(axis_positions(every)).tolist() == pytest.approx([1, 1.6, 1, 1.6])
    assert conditions_in_words(every, every) == "every condition"
    assert conditions_in_words(every[2:4], every) == "any noise"
    assert conditions_in_words(every[1:], every) == "every condition but 2,048 points"
    assert conditions_in_words(every[1:4], every) == "512 of 2,048 points, any noise"
    assert conditions_in_words(every[:1], every[:1]) == "2,048 points"


BY_ID = {family.id: family for family in FAMILIES}


def on_the_axis(family, perturbation):
    """The value that a perturbation itself says it stands for."""
    match perturbation:
        case Stride(step):
            return {"points": CLOUD_SIZE / step, "density": 1.0}[family.id]
        case MorePoints(value):
            return value
        case GaussianNoise(value) | Outliers(value) | Missing(value) | UnevenDensity(value):
            return value
    return CLOUD_SIZE if "points" in family.id else 0.0  # unchanged


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.id)
def test_a_family_goes_from_what_networks_know_to_what_they_do_not(family):
    known = {condition.id: condition.perturbation for condition in CONDITIONS}
    assert family.values == tuple(on_the_axis(family, known[c]) for c in family.conditions)
    rising = sorted(set(family.values))
    assert list(family.values) in (rising, rising[::-1])
    assert not family.logarithmic or rising[0] > 0
    assert family.unseen_by(family.values[0]) == ()
    assert family.unseen_by(family.values[-1]) == ("splat-net@chair", "pc2pix")


def test_the_suite_has_all_families():
    suite = find("beyond-training", SUITES, "suite")
    assert families_of(suite.conditions) == FAMILIES
    of_families = {condition for family in FAMILIES for condition in family.conditions}
    assert sorted(suite.conditions) == sorted({*of_families, "three-views", "one-side"})
    metrics = {*suite.image_metrics, *suite.detail_metrics, *suite.set_metrics}
    assert set(suite.condition_sweep) <= metrics


def test_what_networks_were_not_shown():
    points, noise = BY_ID["points"], BY_ID["noise"]
    shown = {family.id: (low, high) for family in FAMILIES for _, low, high in family.trained[:1]}
    assert shown["points"] == (min(POINTS_SEEN), max(POINTS_SEEN))
    assert shown["noise"] == (0, MAX_NOISE)
    assert points.unseen_by(256) == ("splat-net@chair",)
    assert points.unseen_by(255) == points.unseen_by(4096) == ("splat-net@chair", "pc2pix")
    assert noise.unseen_by(0.11) == ("pc2pix",)
    assert noise.unseen_by(0.10) == ()


def test_families_of_some_conditions():
    points, noise = families_of(["noise-0.20", "512", "2048", "outliers-0.05"])[:2]
    assert points.steps == ((2048, "2048"), (512, "512"))
    assert noise.steps == ((0.0, "2048"), (0.20, "noise-0.20"))
    (outliers,) = families_of(["outliers-0.10", "outliers-0.05"])
    assert outliers.steps == ((0.05, "outliers-0.05"), (0.10, "outliers-0.10"))
    assert families_of(["2048", "of-a-plug-in"]) == families_of([]) == ()
