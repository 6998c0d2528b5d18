from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.intervals import mean_interval, median_interval
from bench.analysis.recommend import Request, advise, at_condition
from bench.commands.results import advice_lines, make_request
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
    "alpha-shape": (NAN, NAN, (0.99, 0.99, 0.99, 0.99)),  # its failures drawn by an optimist
    "true-mesh": (0, 0, (1, 1, 1, 1)),
    "constant": (0, 0, (0.98, 0.98, 0.98, 0.98)),
    "blank": (0, 0, (0.2, 0.2, 0.2, 0.2)),
}


def name_of(choice):
    return choice.method if choice else None


def names(choices):
    return [choice.method for choice in choices]


def in_words(request, *comparisons, in_full=False):
    advice = [advise(one, request) for one in comparisons or [comparison(FIELD)]]
    return advice_lines(advice, request, 20, in_full=in_full)


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
    advice = advise(comparison(FIELD), Request(views, budget_ms))
    assert name_of(advice.best) == best
    assert names(advice.next) == then
    assert advice.affordable == (best is not None) + len(then)
    assert advice.meets(Request(views, budget_ms)) == (best is not None)


def test_choices_carry_their_numbers():
    advice = advise(comparison(FIELD), Request(20, 250))
    best, poisson = advice.best, advice.next[0]
    scores = np.array(FIELD["pc2pix"][2])
    assert best.cost_ms.value == pytest.approx(10 + 20 * 10, rel=1e-12)
    assert best.ssim.value == pytest.approx(0.75, abs=1e-15)
    assert tuple(best.ssim[1:]) == mean_interval(scores)
    difference = scores - np.array(FIELD["poisson"][2])
    assert poisson.behind.value == pytest.approx(0.15, abs=1e-15)
    assert tuple(poisson.behind[1:]) == mean_interval(difference)
    assert (advice.objects, best.n_ok, best.n) == (4, 8, 8)
    just_enough = Request(20, best.cost_ms.value)
    assert name_of(advise(comparison(FIELD), just_enough).best) == "pc2pix"


def test_of_methods_that_print_equal_the_cheapest_is_named():
    same = tuple(score + 1e-6 for score in FIELD["pc2pix"][2])
    twins = {"pc2pix@unfolded": (20, 10, same), "pc2pix@bf16": (5, 5, same)}
    advice = advise(comparison(FIELD | twins), Request(20))
    assert names(advice.next) == ["pc2pix@bf16", "poisson", "splat"]
    advice = advise(comparison(FIELD | twins), Request(20, 250))
    assert name_of(advice.best) == "pc2pix@bf16"
    assert names(advice.next) == ["poisson", "splat"]
    assert advice.affordable == 5


def test_the_interval_of_costs_is_over_objects():
    spread = comparison(FIELD | {"splat": ((1, 2, 3, 100), 1, FIELD["splat"][2])})
    best = advise(spread, Request(20, 30)).best
    costs = np.array([21.0, 22.0, 23.0, 120.0])
    assert best.cost_ms.value == pytest.approx(22.5, rel=1e-12)
    expected = median_interval(costs, np.arange(4))
    assert tuple(best.cost_ms[1:]) == pytest.approx(expected, rel=1e-12)
    (line,) = in_words(Request(20, 30), spread)
    assert line.endswith("; the interval of its cost reaches beyond the budget")


def test_regret_against_an_oracle():
    """Affordable: splat, poisson, pc2pix; the best of each object: 0.9, 0.7, 0.7, 0.8."""
    advice = advise(comparison(FIELD), Request(20, 250))
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
    advice = advise(comparison(field | {"blank": (0, 0, (0, 0, 0))}), Request(1, 10))
    assert name_of(advice.best) == "splat"  # means 0.7 and 0.7: of equals the cheaper
    assert advice.regret.value == pytest.approx((0 + 0 + 0.3) / 3, abs=1e-15)
    assert advice.regret_blind.value == pytest.approx((0.3 + 0 + 0.3) / 3, abs=1e-15)


def test_no_regret_with_one_method_and_none_blind_of_one_object():
    alone = advise(comparison(FIELD), Request(20, 25))
    assert alone.regret == alone.regret_blind == (0, 0, 0)
    single = {name: (p, d, scores[:1]) for name, (p, d, scores) in FIELD.items()}
    advice = advise(comparison(single), Request(20, 250))
    assert name_of(advice.best) == "poisson"
    assert advice.regret.value == 0
    assert np.isnan(advice.regret_blind).all()
    nothing = advise(comparison(FIELD), Request(20, 1))
    assert np.isnan([*nothing.regret, *nothing.regret_blind]).all()


@pytest.mark.parametrize(
    ("min_ssim", "on_average", "surely"),
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
def test_the_cheapest_that_is_good_enough(min_ssim, on_average, surely):
    advice = advise(comparison(FIELD), Request(20, min_ssim=min_ssim))
    assert (name_of(advice.on_average), name_of(advice.surely)) == (on_average, surely)
    assert advice.meets(Request(20, min_ssim=min_ssim)) == (on_average is not None)


def test_both_limits_have_to_be_met_by_one_method():
    request = Request(20, budget_ms=130, min_ssim=0.65)
    assert not advise(comparison(FIELD), request).meets(request)
    within, good = in_words(request)
    assert within.startswith("2048: best within 130 ms: poisson, ssim 0.600 [")
    assert good.startswith(
        "2048: cheapest with an ssim of at least 0.65, surely: pc2pix, ssim 0.75"
    )
    assert good.endswith("; over the budget")
    enough = Request(20, budget_ms=250, min_ssim=0.65)
    assert advise(comparison(FIELD), enough).meets(enough)


def test_in_short_and_in_full():
    assert in_words(Request(20, 250)) == [
        "2048: best within 250 ms: pc2pix, ssim 0.750 [0.658, 0.842], 210 ms [210, 210] a cloud, "
        "10.5 ms a picture"
    ]
    _, _, sure, first, second, regret = in_words(Request(20, 250, 0.65), in_full=True)
    assert sure.startswith("  surely that good, by the lower end of the interval: ")
    assert first.startswith("  next: poisson, ssim 0.600 [")
    assert "; behind by 0.150 [" in first
    assert second.startswith("  next: splat, ")
    interval = "[0.000, 0.105]"  # of four values one of which is 0.1: see the test of regret
    assert regret == (
        f"  regret: 0.025 {interval} ssim against the best of 3 such methods for each of 4 "
        f"objects; 0.025 {interval} where the method is chosen by the other objects"
    )


def test_what_cannot_be_met_names_the_nearest():
    request = Request(20, 5, 0.9)
    within, good, sure = in_words(request, in_full=True)
    assert within.startswith("2048: no method within 5.0 ms; the cheapest: splat, ssim 0.550 [")
    assert ", 21.0 ms [" in within
    least = "2048: no method with an ssim of at least 0.9"
    assert good.startswith(f"{least}; the nearest: surface-apss")
    assert sure.endswith(": none")
    floors = comparison({name: FIELD[name] for name in ("true-mesh", "constant", "blank")})
    assert not advise(floors, request).meets(request)
    assert in_words(request, floors) == ["2048: no method within 5.0 ms", least]


def test_other_numbers_of_views_are_reckoned_and_odd_names_harmless():
    plain = comparison({"splat": FIELD["splat"], "blank": FIELD["blank"]})
    odd = comparison({"splat\x1b": FIELD["splat"], "blank": FIELD["blank"]}, class_name="a\nb")
    reckoned, first, second = in_words(Request(1, 5), odd, plain)
    assert reckoned.startswith("Costs of 1 view are reckoned from the share of one")
    assert first.startswith("2048, a\\nb: best within 5.0 ms: splat\\x1b, ssim")
    assert second.startswith("2048, chair: best")


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
