"""The answer of a report: who is ahead, what is not decided, below blank and cheapest."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from bench.report.answer import in_short

from ..analysis.comparisons import comparison as compared_methods

METRICS = ("ssim-object", "lpips")


def comparison(values, condition="2048", objects=24, costs=None, spread=0.02):
    """Objects about the means of `values`, which are by ssim-object; lpips is 1 less them."""
    rng = np.random.default_rng(0)
    spreads = {m: spread * rng.normal(size=objects) for m in values}
    scores = {m: values[m] + of - of.mean() for m, of in spreads.items()}
    draw_ms = {m: 1000 * (costs or {}).get(m, 0.01) for m in values}
    by_metric = {"ssim-object": scores, "lpips": {m: 1 - of for m, of in scores.items()}}
    return pd.concat(
        compared_methods({m: (0, draw_ms[m], v) for m, v in of.items()}, metric, condition)
        for metric, of in by_metric.items()
    )


def answer_of(compared, metrics=METRICS, views=2):
    """The lines as {term: [text of an entry]}, and the standings."""
    answer = in_short(pd.concat(compared), metrics, views)
    lines = {
        line.term: [f"{', '.join(methods)}: {text}" for methods, text in line.entries]
        for line in answer.lines
    }
    return lines, answer.standings


VALUES = {"splat-net": 0.8, "pc2pix": 0.6, "splat": 0.2, "blank": 0.3, "true-mesh": 1.0}
CHEAPEST = "Cheapest not shown to be behind any"
CLOSE = VALUES | {"pc2pix": 0.7995}
COSTS = {"splat-net": 0.02, "pc2pix": 0.005, "splat": 0.001}


def test_who_is_ahead_everywhere_and_what_it_costs():
    at = ("2048", "512", "noise-0.10")
    lines, standings = answer_of([comparison(VALUES, c, costs=COSTS) for c in at])
    everywhere = "every condition (ssim-object, lpips)"
    assert lines == {
        "Best mean": [f"splat-net: {everywhere}"],
        CHEAPEST: [f"splat-net: 40.0 ms for a cloud with its 2 views; {everywhere}"],
    }
    expected = {"splat-net": "ahead", "pc2pix": "behind", "splat": "behind"}
    assert standings == {
        (m, by, c): who for m, who in expected.items() for by in METRICS for c in at
    }


@pytest.mark.parametrize(
    ("values", "metric", "ahead", "level"),
    [
        (CLOSE, "ssim-object", [], ["splat-net", "pc2pix"]),
        (VALUES | {"splat-net@grey": 0.7999}, "lpips", [], ["splat-net", "splat-net@grey"]),
        # who takes no part
        (VALUES | {"constant": 0.95, "splat@spread=2": 0.95}, "ssim-object", ["splat-net"], []),
    ],
)
def test_who_is_level_with_the_best(values, metric, ahead, level):
    _, standings = answer_of([comparison(values)], [metric])
    found = {who: [m for m in values if standings.get((m, metric, "2048")) == who]
             for who in ("ahead", "level")}  # fmt: skip
    assert found == {"ahead": ahead, "level": level}


def test_the_cheaper_of_two_that_are_level_is_named():
    lines, _ = answer_of([comparison(CLOSE, costs=COSTS)], ["ssim-object"])
    assert lines[CHEAPEST] == [
        "pc2pix: 10.0 ms for a cloud with its 2 views; 2,048 points (ssim-object)"
    ]


@pytest.mark.parametrize(("objects", "name"), [(2, "2 chairs"), (4, "4 chairs")])
def test_too_few_objects_say_how_many_it_takes(objects, name):
    lines, standings = answer_of([comparison(VALUES, objects=objects)], ["ssim-object"])
    (text,) = lines.pop("Not decided")
    assert lines.pop("Best mean") == ["splat-net: 2,048 points (ssim-object)"]
    assert text.startswith(f": nothing can be shown with {name} here: at least ")
    assert int(text.split()[-3]) > objects
    assert lines == standings == {}
