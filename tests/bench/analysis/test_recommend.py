from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.intervals import mean_interval
from bench.analysis.paired import Verdicts
from bench.analysis.recommend import Requirements, at_condition, make_request
from bench.analysis.recommend import advise as advise_by
from bench.analysis.recommend import recommend as recommend_by
from bench.commands.results import advice_lines
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


def name_of(choice):
    return choice.method if choice else None


def names(choices):
    return [choice.method for choice in choices]


def advise(of, request):
    return advise_by(of, request, "ssim", Verdicts([of]))


def recommend(of, request, metrics):
    return recommend_by(of, request, metrics, Verdicts([of]))


def meets(request, of=None):
    return recommend(of or comparison(FIELD), request, ["ssim"]).meets(request)


def in_words(request, *comparisons, in_full=False, metrics=("ssim",)):
    given = [recommend(one, request, metrics) for one in comparisons or [comparison(FIELD)]]
    return advice_lines(given, request, 20, in_full=in_full)


@pytest.mark.parametrize(
    ("views", "budget_ms", "best", "then"),
    [
        # ms at 20 views: splat 21, poisson 120, pc2pix 210, surface-apss 3000
        (20, 20, None, []),
        (20, 21.001, "splat", []),
        (20, 130, "poisson", ["splat"]),
        (20, 250, "pc2pix", ["poisson", "splat"]),
        (20, None, "surface-apss", ["pc2pix", "poisson", "splat"]),
        # ms at 1 view: splat 2, pc2pix 20, poisson 101, surface-apss 2050
        (1, 25, "pc2pix", ["splat"]),
        # ms at 100 views: splat 101, poisson 200, pc2pix 1010
        (100, 900, "poisson", ["splat"]),
    ],
)
def test_the_best_within_a_budget(views, budget_ms, best, then):
    advice = advise(comparison(FIELD), Requirements(views, budget_ms))
    assert name_of(advice.best) == best
    assert names(advice.next) == then
    assert advice.affordable == (best is not None) + len(then)
    assert meets(Requirements(views, budget_ms)) == (best is not None)


def test_choices_carry_their_numbers():
    advice = advise(comparison(FIELD), Requirements(20, 250))
    best, poisson = advice.best, advice.next[0]
    scores = np.array(FIELD["pc2pix"][2])
    assert best.cost_ms.value == pytest.approx(10 + 20 * 10, rel=1e-12)
    assert best.quality.value == pytest.approx(0.75, abs=1e-15)
    assert tuple(best.quality[1:]) == mean_interval(scores)
    difference = scores - np.array(FIELD["poisson"][2])
    assert poisson.gap.value == pytest.approx(0.15, abs=1e-15)
    assert tuple(poisson.gap[1:]) == mean_interval(difference)
    assert (advice.objects, best.n_ok, best.n) == (4, 8, 8)
    just_enough = Requirements(20, best.cost_ms.value)
    assert name_of(advise(comparison(FIELD), just_enough).best) == "pc2pix"


def test_of_methods_that_print_equal_the_cheapest_is_named():
    same = tuple(score + 1e-6 for score in FIELD["pc2pix"][2])
    twins = {"pc2pix@all": (20, 10, same), "pc2pix@acgan": (5, 5, same)}
    advice = advise(comparison(FIELD | twins), Requirements(20))
    assert names(advice.next) == ["pc2pix@acgan", "poisson", "splat"]
    advice = advise(comparison(FIELD | twins), Requirements(20, 250))
    assert name_of(advice.best) == "pc2pix@acgan"
    assert names(advice.next) == ["poisson", "splat"]
    assert advice.affordable == 5


def test_the_interval_of_costs_is_over_objects():
    spread = comparison(FIELD | {"splat": ((1, 2, 3, 100), 1, FIELD["splat"][2])})
    best = advise(spread, Requirements(20, 30)).best
    assert best.cost_ms.value == pytest.approx(22.5, rel=1e-12)
    (line,) = in_words(Requirements(20, 30), spread)
    assert line.endswith("; the interval of its cost reaches beyond the budget")


def test_regret_against_an_oracle():
    """Affordable: splat, poisson, pc2pix; the best of each object: 0.9, 0.7, 0.7, 0.8."""
    advice = advise(comparison(FIELD), Requirements(20, 250))
    assert advice.regret.value == pytest.approx((0.1 + 0 + 0 + 0) / 4, abs=1e-15)
    # what is lost is never below 0
    assert tuple(advice.regret[1:]) == (0.0, mean_interval(np.array([0.9 - 0.8, 0, 0, 0]))[1])
    # Whatever object is left out, pc2pix is the best on the others.
    assert advice.regret_blind == advice.regret


def test_regret_of_a_choice_made_without_the_object():
    """Sums without a, b, c: of splat 1.1, 1.5, 1.6, of poisson 1.4, 1.5, 1.3. So for a poisson is
    chosen, which loses 0.3; for b the first of two equals, which are equal there too; for c splat,
    which loses 0.3."""
    field = {"splat": (1, 0, (1.0, 0.6, 0.5)), "poisson": (2, 0, (0.7, 0.6, 0.8))}
    advice = advise(comparison(field | {"blank": (0, 0, (0, 0, 0))}), Requirements(1, 10))
    assert name_of(advice.best) == "splat"  # means 0.7 and 0.7: of equals the cheaper
    assert advice.regret.value == pytest.approx((0 + 0 + 0.3) / 3, abs=1e-15)
    assert advice.regret_blind.value == pytest.approx((0.3 + 0 + 0.3) / 3, abs=1e-15)


def test_no_regret_with_one_method_and_none_blind_of_one_object():
    alone = advise(comparison(FIELD), Requirements(20, 25))
    assert alone.regret == alone.regret_blind == (0, 0, 0)
    single = {name: (p, d, scores[:1]) for name, (p, d, scores) in FIELD.items()}
    advice = advise(comparison(single), Requirements(20, 250))
    assert name_of(advice.best) == "poisson"
    assert advice.regret.value == 0
    assert np.isnan(advice.regret_blind).all()
    nothing = advise(comparison(FIELD), Requirements(20, 1))
    assert np.isnan([*nothing.regret, *nothing.regret_blind]).all()


@pytest.mark.parametrize(
    ("min_ssim", "by_mean", "significant"),
    [
        # means: splat .55, poisson .6, pc2pix .75, apss .8125; lower ends: ~.46, .26, .66, .29
        (0.0, "splat", "splat"),
        (0.4, "splat", "splat"),
        (0.52, "splat", "pc2pix"),
        (0.58, "poisson", "pc2pix"),
        (0.76, "surface-apss", None),
        (0.9, None, None),
    ],
)
def test_the_cheapest_that_is_good_enough(min_ssim, by_mean, significant):
    advice = advise(comparison(FIELD), Requirements(20, min_ssim=min_ssim))
    assert (name_of(advice.by_mean), name_of(advice.significant)) == (by_mean, significant)
    assert meets(Requirements(20, min_ssim=min_ssim)) == (by_mean is not None)


def test_both_limits_have_to_be_met_by_one_method():
    request = Requirements(20, budget_ms=130, min_ssim=0.65)
    assert not meets(request)
    within, good = in_words(request)
    assert within.startswith("2048: best within 130 ms: poisson, ssim 0.600 [")
    assert good.startswith(
        "2048: cheapest with an ssim of at least 0.65, surely: pc2pix, ssim 0.75"
    )
    assert good.endswith("; over the budget")
    enough = Requirements(20, budget_ms=250, min_ssim=0.65)
    assert meets(enough)


def test_what_cannot_be_met_names_the_nearest():
    request = Requirements(20, 5, 0.9)
    within, good, sure, _ = in_words(request, in_full=True)
    assert within.startswith("2048: no method within 5.0 ms; the cheapest: splat, ssim 0.550 [")
    assert ", 21.0 ms [" in within
    least = "2048: no method with an ssim of at least 0.9"
    assert good.startswith(f"{least}; the nearest: surface-apss")
    assert sure.endswith(": none")
    floors = comparison({name: FIELD[name] for name in ("true-mesh", "constant", "blank")})
    assert not meets(request, floors)
    assert in_words(request, floors) == ["2048: no method within 5.0 ms", least]


def test_other_numbers_of_views_are_reckoned_and_odd_names_harmless():
    plain = comparison({"splat": FIELD["splat"], "blank": FIELD["blank"]})
    odd = comparison({"splat\x1b": FIELD["splat"], "blank": FIELD["blank"]}, class_name="a\nb")
    reckoned, first, second = in_words(Requirements(1, 5), odd, plain)
    assert reckoned.startswith("Costs of 1 view are reckoned from the share of one")
    assert first.startswith("2048, a\\nb: best within 5.0 ms: splat\\x1b, ssim")
    assert second.startswith("2048, chair: best")


def of_two_metrics(lpips):
    """FIELD with a second metric: lpips by method, the same of all four objects."""
    first = comparison(FIELD)
    scores = {m: (0, 0, (value,) * 4) for m, value in lpips.items()}
    return replace(first, qualities=first.qualities | comparison(scores, "lpips").qualities)


LPIPS = {
    **{"poisson": 0.3, "splat": 0.5, "pc2pix": 0.2, "surface-apss": 0.4, "alpha-wrap": 0.1},
    **{"true-mesh": 0.0, "constant": 0.1, "blank": 0.6},
}


def test_what_is_below_a_white_image_is_no_choice():
    """A white image of ssim .58: of the four methods splat (.55) is worse."""
    white = comparison(FIELD | {"blank": (0, 0, (0.58,) * 4)})
    advice = advise(white, Requirements(20, 25))
    assert (advice.best, advice.affordable, advice.below_blank) == (None, 0, ("splat",))
    assert not meets(Requirements(20, 25), white)
    (line,) = in_words(Requirements(20, 25), white)
    assert line.startswith(
        "2048: no method within 25.0 ms is better than a white image; the cheapest: poisson, ssim "
    )
    advice = advise(white, Requirements(20, min_ssim=0.5))
    assert name_of(advice.by_mean) == "poisson"
    assert names(advice.next) == ["pc2pix", "poisson"]
    lines = in_words(Requirements(20, 250), white, in_full=True)
    assert lines[1] == "  below a white image, no choice: splat"


def test_a_white_image_is_better_by_one_metric_alone():
    both = of_two_metrics(LPIPS | {"splat": 0.7})
    request, metrics = Requirements(20, 25), ("ssim", "lpips")
    by_ssim, by_lpips = in_words(request, both, metrics=metrics)
    assert by_ssim.startswith("2048: best within 25.0 ms by ssim: splat, ")
    assert by_lpips.startswith(
        "2048: no method within 25.0 ms is better than a white image by lpips; the cheapest: "
    )
    assert not recommend(both, request, metrics).meets(request)


def test_objects_without_a_value_do_not_count_for_the_regret():
    scores = {"splat": (1, 0, (0.5, NAN, 0.5)), "poisson": (2, 0, (0.6, 0.9, 0.2))}
    field = comparison(scores | {"blank": (0, 0, (0, 0, 0))}, "ssim-object")
    known = {
        m: replace(q, estimate=q.estimate._replace(value=float(np.nanmean(q.per_object))))
        for m, q in field.qualities["ssim-object"].items()
    }
    scored = replace(field, qualities={"ssim-object": known})
    advice = advise_by(scored, Requirements(1, 10), "ssim-object", Verdicts([scored]))
    assert name_of(advice.best) == "poisson"  # .567 and .5
    assert advice.regret.value == pytest.approx((0 + 0.3) / 2)


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
        make_request(*arguments)
    assert str(refused.value) == message


def test_conditions():
    both = [comparison(FIELD), comparison(FIELD, condition="512")]
    assert at_condition(both, None) == both
    assert at_condition(both, "512") == both[1:]
    with pytest.raises(BadInput, match="--condition 511: not in this run; there are 2048, 512"):
        at_condition(both, "511")


def test_a_method_whose_cost_is_claimed_is_no_choice():
    field = FIELD | {"entered": (0.1, 0.1, (0.99, 0.99, 0.99, 0.99))}
    claimed = replace(comparison(field), claimed=frozenset({"entered"}))
    request = Requirements(budget_ms=150, views=1)
    advice, without = advise(claimed, request), advise(comparison(FIELD), request)
    assert name_of(advice.best) == name_of(without.best) == "pc2pix"
    assert name_of(advice.cheapest) == name_of(without.cheapest)
