"""Mean ranks over runs, by hand, and the mean over conditions."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import rankdata

from bench.analysis.comparison import compare
from bench.analysis.leaderboard import (
    OVERALL,
    ObjectScores,
    mean_ranks,
    object_scores,
    over_conditions,
)
from bench.analysis.paired import fewest_objects, holm, sign_flip_p

from ..builders import sums_of

OBJECTS = tuple(f"o{i:02d}" for i in range(12))


def cell(objects=OBJECTS, **scores) -> ObjectScores:
    return ObjectScores(objects, {m: np.asarray(v, float) for m, v in scores.items()})


def test_of_the_same_methods_it_is_the_mean_of_ranks():
    rng = np.random.default_rng(0)
    values = rng.integers(0, 4, (2, 5, 12))  # cells, methods, objects: with ties
    names = "vwxyz"
    found = mean_ranks([cell(**dict(zip(names, of_cell, strict=True))) for of_cell in values])
    ranks = np.mean([rankdata(-of_cell, axis=0).mean(axis=1) for of_cell in values], axis=0)
    assert {r.method: r.rank for r in found.ranks} == pytest.approx(
        dict(zip(names, ranks, strict=True))
    )
    assert [r.rank for r in found.ranks] == pytest.approx(sorted(ranks))


def test_a_method_is_taken_to_lose_as_often_to_those_it_has_not_met():
    up = np.arange(12.0)
    found = mean_ranks([cell(a=up + 2, b=up + 1, c=up), cell(("p",) * 1, a=[0.0], d=[1.0])])
    ranks = {r.method: r.rank for r in found.ranks}
    assert ranks == pytest.approx({"d": 1, "a": 1 + 3 * (1 / 3), "b": 1 + 3 * 0.5, "c": 4})


def test_letters_and_p_values_are_of_objects_in_common():
    rng = np.random.default_rng(1)
    base = rng.random(12)
    tie = np.where(np.arange(12) < 6, 1, -1)
    cells = [cell(a=base, b=base + 0.1 * tie, c=base - 1), cell(("x",), e=[1.0], a=[0.0])]
    found = mean_ranks(cells)
    letters = {r.method: r.letters for r in found.ranks}
    assert letters == {"e": "", "a": "a", "b": "a", "c": "b"}  # e has one object
    assert found.objects_needed is None
    assert found.first == next(r.method for r in found.ranks if r.letters)
    p = {r.method: r.p_first for r in found.ranks}
    other = {"a": "b", "b": "a"}[found.first]
    every = np.array([np.ones(12), np.ones(12), tie])
    tested = holm([float(value) for value in sign_flip_p(every)])
    assert p[other] == pytest.approx(tested[2])
    assert p["c"] == pytest.approx(tested[0])
    assert np.isnan(p[found.first])
    assert np.isnan(p["e"])


def test_an_object_of_several_runs_counts_once():
    up = np.arange(7.0)
    names = OBJECTS[:7]
    twice = mean_ranks([cell(names, a=up + 1, b=up), cell(names, a=up + 1, b=up)])
    assert [r.letters for r in twice.ranks] == ["", ""]
    assert twice.objects_needed == fewest_objects(1)
    others = mean_ranks([cell(names, a=up + 1, b=up), cell(OBJECTS[5:], a=up + 1, b=up)])
    assert [r.letters for r in others.ranks] == ["a", "b"]


def test_nothing_is_ranked_without_two_methods():
    assert mean_ranks([]).ranks == ()
    assert mean_ranks([]).objects_needed is None


def records(scores) -> pd.DataFrame:
    """Records of two views; `scores` by method, condition and object."""
    rows = [
        {"method": m, "condition": c, "class": "chair", "object": o, "view": v, "outcome": "ok",
         "prepare_s": t, "draw_s": t, "lpips": value}
        for (m, c, t), by_object in scores.items()
        for o, value in by_object.items()
        for v in (0, 1)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_the_mean_over_conditions_is_of_objects_that_all_have():
    frame = records(
        {
            ("blank", "2048", 0.0): {"a": 0.9, "b": 0.9, "c": 0.9},
            ("m", "2048", 0.01): {"a": 0.1, "b": 0.2, "c": 0.3},
            ("blank", "512", 0.0): {"a": 0.9, "b": 0.9},
            ("m", "512", 0.02): {"a": 0.3, "b": 0.6},
        }
    )
    overall = over_conditions(compare(sums_of(frame), {}, ["lpips"]))
    assert overall.condition == OVERALL
    assert overall.objects == ("a", "b")
    quality = overall.qualities["lpips"]["m"]
    assert quality.per_object == pytest.approx([0.2, 0.4])
    assert quality.estimate.value == pytest.approx(0.3)
    assert overall.images["m"] == (10, 10)
    assert overall.cost_ms("m", 1).value == pytest.approx(20)  # of the first condition


def test_scores_rise_with_quality_and_leave_reference_methods_out():
    frame = records(
        {
            ("blank", "2048", 0.0): {"a": 0.9},
            ("splat", "2048", 0.0): {"a": 0.4},
            ("pc2pix", "2048", 0.0): {"a": 0.1},
        }
    )
    (comparison,) = compare(sums_of(frame), {}, ["lpips"])
    found = object_scores(comparison, "lpips", "procedural")
    assert found is not None
    assert found.objects == ("procedural: chair/a",)
    assert {m: list(v) for m, v in found.scores.items()} == {"splat": [-0.4], "pc2pix": [-0.1]}
    (alone,) = compare(sums_of(frame[frame["method"] != "splat"]), {}, ["lpips"])
    assert object_scores(alone, "lpips", "procedural") is None
