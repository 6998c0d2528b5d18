from __future__ import annotations

import pandas as pd
import pytest

from bench.analysis import recommend as analysis
from bench.analysis.paired import Verdicts
from bench.analysis.recommend import BEST, ENOUGH, NEXT, NO_BEST, NOT_ENOUGH, SURE, Requirements
from data_prep.failures import BadInput

from .comparisons import comparison

pytestmark = pytest.mark.usefixtures("few_objects")

NAN = float("nan")

# Milliseconds to prepare and to draw a view, and the score of each object.
FIELD = {
    "poisson": (100, 1, (0.9, 0.5, 0.6, 0.4)),
    "splat": (1, 1, (0.5, 0.6, 0.5, 0.6)),
    "pc2pix": (10, 10, (0.8, 0.7, 0.7, 0.8)),
    "surface-apss": (2000, 50, (0.7, 0.95, 0.7, 0.9)),
    "alpha-wrap": (NAN, NAN, (0.99, 0.99, 0.99, 0.99)),  # its failures drawn by an optimist
    "true-mesh": (0, 0, (1, 1, 1, 1)),
    "constant": (0, 0, (0.98, 0.98, 0.98, 0.98)),
    "blank": (0, 0, (0.2, 0.2, 0.2, 0.2)),
}


def recommend(request, of=None, metrics=("ssim",)):
    """The choices, and whether they meet the request; of FIELD where nothing else is given."""
    compared = comparison(FIELD) if of is None else of
    return analysis.recommend(compared, request, metrics, Verdicts(compared))


def chosen(request, of=None, metrics=("ssim",)):
    """The choices and their methods, and whether they meet the request."""
    choices, met = recommend(request, of, metrics)
    return [*zip(choices["choice"], choices["method"], strict=True)], met


@pytest.mark.parametrize(
    ("views", "budget_ms", "best", "then"),
    [
        # ms at 20 views: splat 21, poisson 120, pc2pix 210, surface-apss 3000
        (20, 21.001, "splat", []),
        (20, 130, "poisson", ["splat"]),
        (20, 250, "pc2pix", ["poisson", "splat"]),
        (20, 5000, "surface-apss", ["pc2pix", "poisson", "splat"]),
        # ms at 1 view: splat 2, pc2pix 20, poisson 101, surface-apss 2050
        (1, 25, "pc2pix", ["splat"]),
        # ms at 100 views: splat 101, poisson 200, pc2pix 1010
        (100, 900, "poisson", ["splat"]),
    ],
)
def test_the_best_within_a_budget(views, budget_ms, best, then):
    expected = [(BEST, best), *((NEXT, method) for method in then)]
    assert chosen(Requirements(views, budget_ms)) == (expected, True)


def test_where_nothing_is_affordable_the_cheapest_is_named():
    assert chosen(Requirements(20, 20)) == ([(NO_BEST, "splat")], False)
    floors = comparison({name: FIELD[name] for name in ("true-mesh", "constant", "blank")})
    nothing = [(NO_BEST, "-"), (NOT_ENOUGH, "-")]
    assert chosen(Requirements(20, 5, 0.9), floors) == (nothing, False)


def test_of_methods_that_print_equal_the_cheapest_is_named():
    same = tuple(score + 1e-6 for score in FIELD["pc2pix"][2])
    twins = {"pc2pix@all": (20, 10, same), "pc2pix@acgan": (5, 5, same)}
    choices, _ = chosen(Requirements(20, 250), comparison(FIELD | twins))
    assert [method for _, method in choices] == ["pc2pix@acgan", "poisson", "splat"]


@pytest.mark.parametrize(
    ("min_ssim", "expected"),
    [
        # means: splat .55, poisson .6, pc2pix .75, apss .8125; lower ends: ~.46, .26, .66, .29
        (0.4, [(SURE, "splat")]),
        (0.52, [(ENOUGH, "splat"), (SURE, "pc2pix")]),
        (0.58, [(ENOUGH, "poisson"), (SURE, "pc2pix")]),
        (0.76, [(ENOUGH, "surface-apss"), (SURE, "-")]),
        (0.9, [(NOT_ENOUGH, "surface-apss")]),
    ],
)
def test_the_cheapest_that_is_good_enough(min_ssim, expected):
    choices, met = chosen(Requirements(20, min_ssim=min_ssim))
    assert [choice for choice in choices if choice[0] not in (BEST, NEXT)] == expected
    assert met == (expected[0][0] != NOT_ENOUGH)


LPIPS = {
    **{"poisson": 0.3, "splat": 0.5, "pc2pix": 0.2, "surface-apss": 0.4, "alpha-wrap": 0.1},
    **{"true-mesh": 0.0, "constant": 0.1, "blank": 0.6},
}


def test_what_is_below_a_white_image_is_no_choice():
    """A white image of ssim .58: of the four methods splat (.55) is worse."""
    white = comparison(FIELD | {"blank": (0, 0, (0.58,) * 4)})
    choices, met = recommend(Requirements(20, 25), white)
    (row,) = choices.to_dict("records")
    assert (row["choice"], row["method"], row["below"]) == (NO_BEST, "poisson", ["splat"])
    assert not met
    expected = [(BEST, "poisson"), (ENOUGH, "poisson"), (SURE, "pc2pix")]
    assert chosen(Requirements(20, 130, 0.5), white) == (expected, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((20, None, None), "nothing to go by; give --budget-ms, --min-ssim, or both"),
        ((0, 5.0, None), "--views 0: must be at least 1"),
        ((1, 0.0, None), "--budget-ms 0: must be a number over 0"),
        ((1, float("inf"), None), "--budget-ms inf: must be a number over 0"),
        ((1, NAN, None), "--budget-ms nan: must be a number over 0"),
        ((1, None, 1.01), "--min-ssim 1.01: must be from -1 to 1"),
        ((1, None, NAN), "--min-ssim nan: must be from -1 to 1"),
    ],
)
def test_options_without_sense(arguments, message):
    with pytest.raises(BadInput) as refused:
        Requirements(*arguments)
    assert str(refused.value) == message


def test_conditions():
    both = pd.concat([comparison(FIELD), comparison(FIELD, condition="512")])
    assert len(analysis.at_condition(both, None)) == len(both)
    assert set(analysis.at_condition(both, "512")["condition"]) == {"512"}
    with pytest.raises(BadInput, match="--condition 511: not in this run; there are 2048, 512"):
        analysis.at_condition(both, "511")


def test_a_method_whose_cost_is_claimed_is_no_choice():
    field = comparison(FIELD | {"entered": (0.1, 0.1, (0.99, 0.99, 0.99, 0.99))})
    claimed = field.assign(claimed=field["method"] == "entered")
    request = Requirements(budget_ms=150, views=1)
    assert chosen(request, claimed) == chosen(request)
