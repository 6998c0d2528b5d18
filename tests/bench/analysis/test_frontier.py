from __future__ import annotations

import pandas as pd
import pytest

from bench.analysis import frontier
from bench.analysis.differences import Verdicts
from bench.analysis.frontier import thinned_clouds

from .comparisons import comparison, row_of

pytestmark = pytest.mark.usefixtures("few_objects")

NAN = float("nan")


FIELD = {
    "splat": (1, 1, (0.5, 0.6, 0.7, 0.6)),
    "poisson": (100, 1, (0.8, 0.82, 0.78, 0.8)),
    # clearly worse than poisson, object by object, and as expensive
    "surface-bpa": (100, 1, (0.7, 0.72, 0.68, 0.7)),
    # worse on the mean, better on one object
    "surface-fit": (300, 1, (0.5, 0.95, 0.8, 0.75)),
    # better, and 20 views are cheaper than 20 of surface-apss
    "pc2pix": (10, 25, (0.9, 0.9, 0.9, 0.9)),
    "surface-apss": (1000, 1, (0.9, 0.9, 0.9, 0.9)),
    "alpha-wrap": (NAN, NAN, (0.4, 0.4, 0.4, 0.4)),
    "true-mesh": (0, 0, (1, 1, 1, 1)),
    "constant": (0, 0, (0.4, 0.4, 0.4, 0.4)),
    "blank": (0, 0, (0.4, 0.4, 0.4, 0.4)),
}


def places(made, views):
    return frontier.frontier_verdicts(made, views, Verdicts(made[:0], made))


def verdicts(made):
    pairs = zip(made["verdict"], made["rival"], strict=True)
    return dict(zip(made["method"], pairs, strict=True))


def test_verdicts_with_twenty_views():
    # ms: splat 21, poisson and bpa 120, fit 320, pc2pix 510, apss 1020
    made = places(comparison(FIELD), 20)
    assert verdicts(made) == {
        "splat": ("frontier", ""),
        "poisson": ("frontier", ""),
        "surface-bpa": ("dominated", "poisson"),
        "surface-fit": ("tied", "poisson"),
        "pc2pix": ("frontier", ""),
        "surface-apss": ("tied", "pc2pix"),
        "alpha-wrap": ("no value", ""),
        "true-mesh": ("reference", ""),
        "constant": ("reference", ""),
        "blank": ("reference", ""),
    }
    assert row_of(made, method="pc2pix")["cost_ms"] == pytest.approx(10 + 20 * 25, rel=1e-12)
    assert made["method"].tolist() == list(FIELD)


@pytest.mark.parametrize(
    ("metric", "methods", "expected"),
    [
        (  # of distances less is better
            "fd-views",
            {
                "splat": (1, 0, (9.0, 9.2, 9.1, 9.1)),
                "poisson": (100, 0, (5.0, 5.1, 5.2, 5.1)),
                "pc2pix": (200, 0, (7.0, 7.1, 7.2, 7.1)),
            },
            [("frontier", ""), ("frontier", ""), ("dominated", "poisson")],
        ),
        (  # what no table shows decides nothing
            "ssim",
            {
                "pc2pix": (100, 0, (0.9, 0.8, 0.7)),
                "pc2pix@all": (200, 0, (0.9 + 1e-6, 0.8 + 1e-6, 0.7 + 1e-6)),
                "pc2pix@paper": (300, 0, (0.9 - 1e-6, 0.8 - 1e-6, 0.7 - 1e-6)),
            },
            [("frontier", ""), ("tied", "pc2pix"), ("tied", "pc2pix")],
        ),
    ],
)
def test_verdicts_of_one_view(metric, methods, expected):
    found = verdicts(places(comparison(methods, metric), 1))
    assert list(found.values()) == expected


def test_what_is_worse_than_a_white_image_is_off_the_frontier():
    """By the metric that is judged alone: splat is cheap, but below a white image of ssim .62."""
    field = comparison(FIELD | {"blank": (0, 0, (0.62,) * 4)})
    found = verdicts(places(field, 20))
    assert found["splat"] == ("below a white image", "blank")
    assert found["alpha-wrap"] == ("no value", "")
    assert found["constant"] == ("reference", "")
    assert {m for m, (verdict, _) in found.items() if verdict == "frontier"} == {
        "poisson",
        "pc2pix",
    }
    distances = {m: (p, d, tuple(1 - s for s in scores)) for m, (p, d, scores) in FIELD.items()}
    made = places(pd.concat([field, comparison(distances, "lpips")], ignore_index=True), 20)
    by_metric = made[made["method"] == "splat"].set_index("metric")["verdict"].to_dict()
    assert by_metric == {"ssim": "below a white image", "lpips": "frontier"}


def test_a_value_that_prints_like_that_of_a_white_image_is_not_below_it():
    field = FIELD | {"blank": (0, 0, (0.6001,) * 4)}  # splat has 0.6
    assert verdicts(places(comparison(field), 20))["splat"] == ("frontier", "")


def test_the_same_cost_and_quality_beat_each_other_not():
    field = {"splat": FIELD["poisson"], "poisson": FIELD["poisson"], "blank": FIELD["blank"]}
    found = verdicts(places(comparison(field), 20))
    assert (found["splat"], found["poisson"]) == (("frontier", ""), ("frontier", ""))


def test_one_object_shows_nothing_clearly():
    alone = {name: (p, d, scores[:1]) for name, (p, d, scores) in FIELD.items()}
    found = {verdict for verdict, _ in verdicts(places(comparison(alone), 20)).values()}
    assert "dominated" not in found
    assert "tied" in found


def test_a_claimed_cost_has_no_part_in_the_frontier():
    """It is neither on it, though it would be the cheapest, nor does it push another off."""
    field = comparison(FIELD | {"entered": (0.1, 0.1, (0.99, 0.99, 0.99, 0.99))})
    claimed = field.assign(claimed=field["method"] == "entered")
    made = verdicts(places(claimed, 20))
    assert made.pop("entered") == ("claimed", "")
    assert made == verdicts(places(comparison(FIELD), 20))
    fewer = thinned_clouds(claimed, 20)
    assert fewer.loc[fewer["claimed"], "method"].tolist() == ["entered"]


def test_a_method_whose_cost_is_claimed_is_neither_on_the_frontier_nor_a_rival():
    field = comparison(FIELD | {"entered": (0.1, 0.1, (0.99,) * 4)})
    claimed = field.assign(claimed=field["method"] == "entered")
    expected = verdicts(places(comparison(FIELD), 20)) | {"entered": ("claimed", "")}
    assert verdicts(places(claimed, 20)) == expected
