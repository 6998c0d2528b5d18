"""The mean over conditions, and mean places, by hand."""

from __future__ import annotations

import pandas as pd
import pytest

from bench.analysis.comparison import compare
from bench.analysis.leaderboard import OVERALL, mean_places, over_conditions

from ..builders import scored_records


def test_places_are_averaged_over_columns_and_equal_ones_shared():
    columns = [
        ("ssim-object", {"a": 0.9, "b": 0.8, "c": 0.8004, "blank": 1.0}),  # c: .800 as printed
        ("lpips", {"a": 0.3, "b": 0.1, "c": 0.2}),
    ]
    assert mean_places(columns, {m: m for m in "abc"}) == pytest.approx(
        {"a": 2, "b": 1.75, "c": 2.25}
    )


def test_digits_that_are_noise_decide_no_place():
    """Values .234 and .226 print like the .23 of surface-apss, which has two decimals by lpips."""
    columns = [("lpips", {"wraps": 0.226, "paper": 0.231, "splats": 0.234})]
    ids = {"wraps": "splat-net", "paper": "surface-apss", "splats": "splat"}
    places = mean_places(columns, ids)
    assert places == {"wraps": 1.5, "paper": 2, "splats": 2.5}


def test_a_place_among_fewer_methods_is_stretched_to_all():
    columns = [("lpips", {"a": 0.1, "b": 0.2, "c": 0.3}), ("lpips", {"a": 0.2, "d": 0.1})]
    assert mean_places(columns, {m: m for m in "abcd"}) == pytest.approx(
        {"a": 1 + 3 / 2, "b": 1 + 3 / 2, "c": 4, "d": 1}
    )
    assert mean_places([], {"a": "a"}) == {}


def records(scores) -> pd.DataFrame:
    """Records of two views; `scores` by method, condition and object."""
    rows = [
        {"method": m, "condition": c, "class": "chair", "object": o, "view": v, "outcome": "ok",
         "reason": "", "notes": "", "prepare_s": t, "draw_s": t, "lpips": value}
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
    overall = over_conditions(compare(scored_records(frame), ["lpips"]))
    assert overall.condition == OVERALL
    assert overall.objects == ("a", "b")
    quality = overall.qualities["lpips"]["m"]
    assert quality.per_object == pytest.approx([0.2, 0.4])
    assert quality.estimate.value == pytest.approx(0.3)
    assert overall.images["m"] == (10, 10)
    assert overall.cost_ms("m", 1).value == pytest.approx(20)  # of the first condition
