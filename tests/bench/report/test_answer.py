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


def said(compared, metrics=METRICS, views=2):
    """The lines as {term: [text of an entry]}."""
    return {
        line.term: [f"{', '.join(methods)}: {text}" for methods, text in line.entries]
        for line in in_short(pd.concat(compared), metrics, views)
    }


VALUES = {"splat-net": 0.8, "pc2pix": 0.6, "splat": 0.2, "blank": 0.3, "true-mesh": 1.0}


def test_who_is_ahead_everywhere_and_what_it_costs():
    costs = {"splat-net": 0.02, "pc2pix": 0.005, "splat": 0.001}
    lines = said([comparison(VALUES, c, costs=costs) for c in ("2048", "512", "noise-0.10")])
    everywhere = "every condition (ssim-object, lpips)"
    assert lines == {
        "Ahead of all other families": [f"splat-net: {everywhere}"],
        "Below a white image": [f"splat: {everywhere}"],
        "Cheapest that nothing beats": [
            f"splat-net: 40.0 ms for a cloud with its 2 views; {everywhere}"
        ],
    }


AHEAD, CHEAPEST = "Ahead of all other families", "Cheapest that nothing beats"
CLOSE = VALUES | {"pc2pix": 0.7995}
COSTS = {"splat-net": 0.02, "pc2pix": 0.005, "splat": 0.001}


@pytest.mark.parametrize(
    ("compared", "metric", "expected"),
    [
        (
            [comparison(VALUES), comparison(CLOSE, "512"), comparison(VALUES, "noise-0.10")],
            "ssim-object",
            {
                AHEAD: ["splat-net: 2,048 points, noise 10 % of the radius (ssim-object)"],
                "Not decided from second place": [
                    "splat-net, pc2pix: 512 of 2,048 points (ssim-object)"
                ],
            },
        ),
        (
            [comparison(VALUES | {"splat-net@grey": 0.7999})],
            "lpips",
            {
                AHEAD: ["splat-net: 2,048 points (lpips)"],
                "Not decided between variants": ["splat-net, splat-net@grey: 2,048 points (lpips)"],
            },
        ),
        (
            [comparison(CLOSE, costs=COSTS)],
            "ssim-object",
            {
                CHEAPEST: [
                    "pc2pix: 10.0 ms for a cloud with its 2 views; 2,048 points (ssim-object)"
                ]
            },
        ),
        (
            [comparison(VALUES | {"constant": 0.95, "splat@spread=2": 0.95, "pc2pix@paper": 0.95})],
            "ssim-object",
            {AHEAD: ["splat-net: 2,048 points (ssim-object)"]},
        ),
    ],
    ids=["not decided at a condition", "variants", "the cheaper of two", "who wins nothing"],
)
def test_lines_of_the_answer(compared, metric, expected):
    assert expected.items() <= said(compared, [metric]).items()


@pytest.mark.parametrize(("objects", "name"), [(2, "2 chairs"), (4, "4 chairs")])
def test_too_few_objects_say_how_many_it_takes(objects, name):
    lines = said([comparison(VALUES, objects=objects)], ["ssim-object"])
    (text,) = lines["Not decided"]
    assert text.startswith(f": nothing can be shown with {name} here: at least ")
    assert int(text.split()[-3]) > objects
    assert lines["Best by its mean alone"] == ["splat-net: 2,048 points (ssim-object)"]
    assert "Ahead of all other families" not in lines
    assert "Cheapest that nothing beats" not in lines
