"""What a run costs, from what a pilot took: closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bench.records.record import GROUND_TRUTH
from bench.running.isolation import TASKS_PER_WORKER
from bench.running.pilot import Pilot, Sample, estimate, half_width, mean_at, spread, widest

SIZES = (100.0, 200.0, 300.0, 400.0)


def sample(method="splat", condition="2048", number=0, seconds=1.0, **changes) -> Sample:
    made = Sample(
        method, condition, "chair", str(number), SIZES[number], seconds, 0.5, 1000.0, 300.0, 0.5, ""
    )
    return replace(made, **changes)


def pilot(*samples, loading=None, start_s=0.0, sizes=SIZES) -> Pilot:
    return Pilot(samples, loading or {}, start_s, sizes)


# --- the mean of all from a few -------------------------------------------------------------------


def test_costs_on_a_line_give_the_mean_at_the_mean_size_exactly():
    sizes = np.array(SIZES)
    found = mean_at(2.0 + 0.01 * sizes, sizes, [300.0] * 5)
    assert (found.value, found.low, found.high) == pytest.approx((5.0, 5.0, 5.0), abs=1e-12)


def test_interval_of_the_line_is_that_of_least_squares():
    sizes = np.array([1.0, 2.0, 4.0, 7.0, 9.0])
    costs = np.array([2.0, 2.5, 5.5, 6.0, 9.5])
    found = mean_at(costs, sizes, [5.0, 5.0])
    fit = stats.linregress(sizes, costs)
    residuals = costs - fit.intercept - fit.slope * sizes
    error = math.sqrt(residuals @ residuals / 3)
    leverage = 1 / 5 + (5.0 - sizes.mean()) ** 2 / ((sizes - sizes.mean()) ** 2).sum()
    half = stats.t.ppf(0.975, 3) * error * math.sqrt(leverage)
    assert found.value == pytest.approx(fit.intercept + 5 * fit.slope)
    assert found.high - found.value == pytest.approx(half)
    assert found.value - found.low == pytest.approx(min(half, found.value))


def test_sizes_that_are_a_sample_themselves_widen_the_interval():
    sizes = np.array(SIZES)
    costs = 2.0 + 0.01 * sizes
    among = [200.0, 400.0]
    half = stats.t.ppf(0.975, 2) * 0.01 * np.std(among) / math.sqrt(2)
    found = mean_at(costs, sizes, among)
    assert found.value == pytest.approx(5.0)
    assert found.high - found.value == pytest.approx(half)


@pytest.mark.parametrize("sizes", [np.full(4, 7.0), None])
def test_without_a_line_the_mean_with_its_t_interval(sizes):
    costs = np.array([1.0, 2.0, 6.0, 7.0]) if sizes is not None else np.array([1.0, 2.0, 6.0])
    found = mean_at(costs, np.arange(3.0) if sizes is None else sizes, [1000.0])
    half = stats.t.ppf(0.975, len(costs) - 1) * costs.std(ddof=1) / math.sqrt(len(costs))
    assert found.value == pytest.approx(costs.mean())
    assert found.high == pytest.approx(costs.mean() + half)
    assert found.low == max(0.0, costs.mean() - half)


def test_no_estimate_leaves_the_range_of_what_was_measured():
    sizes = np.array(SIZES)
    assert mean_at(sizes, sizes, [1e6]).value == 400.0
    assert mean_at(sizes, sizes, [-1e6]).value == 100.0


def test_one_object_has_no_interval_and_none_no_mean():
    one = mean_at(np.array([3.0]), np.array([1.0]), [1.0])
    assert one.value == 3.0
    assert math.isnan(one.low)
    assert math.isnan(mean_at(np.zeros(0), np.zeros(0), []).value)


def test_the_line_is_nearer_than_the_mean_where_costs_go_by_size():
    rng = np.random.default_rng(0)
    sizes = rng.uniform(1, 10, 2000)
    costs = sizes * rng.lognormal(0, 0.1, 2000)
    true, by_line, by_mean, held = costs.mean(), [], [], []
    for _ in range(300):
        some = rng.choice(2000, 6, replace=False)
        found = mean_at(costs[some], sizes[some], sizes)
        by_line.append(found.value - true)
        by_mean.append(costs[some].mean() - true)
        held.append(found.low <= true <= found.high)
    assert np.std(by_line) < 0.4 * np.std(by_mean)
    assert np.mean(held) == pytest.approx(0.95, abs=0.05)


# --- the cost of a run ----------------------------------------------------------------------------


def test_cost_is_items_times_seconds_summed_over_conditions():
    samples = [sample(number=n, seconds=2.0) for n in range(4)]
    samples += [sample(condition="512", number=n, seconds=3.0) for n in range(4)]
    found = estimate(pilot(*samples), {("splat", "2048"): 10, ("splat", "512"): 4}, 2)
    assert found.methods["splat"].core_s.value == pytest.approx(10 * 2 + 4 * 3)
    assert found.methods["splat"].core_s.low == pytest.approx(32)
    assert found.methods["splat"].items == found.total.items == 14
    assert found.methods["splat"].method_s == pytest.approx(14 * 0.5)
    assert found.total.size_b == pytest.approx(14_000)
    assert found.total.peak_mib == 300.0
    assert found.wall_s.value == pytest.approx(16)


def test_sum_of_the_methods_is_the_whole():
    rng = np.random.default_rng(1)
    samples = [
        sample(m, c, n, float(rng.uniform(1, 9)))
        for m in ("splat", "blank")
        for c in ("2048", "512")
        for n in range(4)
    ]
    samples += [sample(GROUND_TRUTH, "", n, float(rng.uniform(1, 2))) for n in range(4)]
    left = {(GROUND_TRUTH, ""): 7} | {
        (m, c): 7 for m in ("splat", "blank") for c in ("2048", "512")
    }
    loading = {"splat": 3.0, "blank": 1.0, GROUND_TRUTH: 2.0}
    found = estimate(pilot(*samples, loading=loading, start_s=0.25), left, 2)
    parts = sum(cost.core_s.value for cost in found.methods.values())
    assert found.total.core_s.value == pytest.approx(parts + 4 * 0.25)
    assert found.total.items == 28  # ground truths are no items


def test_loading_is_paid_once_a_process():
    samples = [sample(number=n, seconds=0.0) for n in range(4)]
    few = pilot(*samples, loading={"splat": 5.0})
    many = 10 * TASKS_PER_WORKER + 1
    for items, workers, births in ((1, 4, 1), (3, 4, 3), (100, 4, 4), (many, 4, 11), (0, 4, 0)):
        cost = estimate(few, {("splat", "2048"): items}, workers).total
        assert cost.core_s.value == pytest.approx(5.0 * births)


def test_nothing_left_costs_nothing():
    found = estimate(pilot(sample()), {("splat", "2048"): 0}, 2)
    assert found.total.core_s.value == found.wall_s.value == found.total.size_b == 0.0


def test_a_worker_that_died_leaves_the_mean_of_the_others():
    samples = [sample(number=n, seconds=2.0) for n in range(3)]
    samples.append(sample(number=3, seconds=math.nan, reason="crash: the worker died (SIGSEGV)"))
    found = estimate(pilot(*samples), {("splat", "2048"): 10}, 1)
    assert found.total.core_s.value == pytest.approx(20.0)
    assert found.total.failed == 1
    alone = estimate(pilot(sample(seconds=math.nan, reason="crash")), {("splat", "2048"): 10}, 1)
    assert math.isnan(alone.total.core_s.value)


def test_no_more_workers_than_jobs_share_the_time():
    found = estimate(pilot(sample(seconds=6.0)), {("splat", "2048"): 2}, 8)
    assert found.wall_s.value == pytest.approx(6.0)


# --- how wide the mean SSIM's interval is ---------------------------------------------------------


def test_half_width_falls_with_the_square_root():
    known = pilot(*(sample(number=n, ssim=s) for n, s in enumerate((0.2, 0.4, 0.6, 0.8))))
    deviation = np.std([0.2, 0.4, 0.6, 0.8], ddof=1)
    assert half_width(known, ("splat", "2048"), 100) == pytest.approx(0.196 * deviation)
    assert half_width(known, ("splat", "2048"), 25) == pytest.approx(0.392 * deviation)


def test_widest_is_the_cell_with_the_largest_spread():
    samples = [sample(number=n, ssim=0.5 + n / 100) for n in range(4)]
    samples += [sample("blank", number=n, ssim=0.5 + n / 10) for n in range(4)]
    cells = [("splat", "2048"), ("blank", "2048"), ("constant", "2048")]
    assert widest(pilot(*samples), cells) == ("blank", "2048")
    assert widest(pilot(sample(ssim=None)), cells) is None


# --- which objects are measured -------------------------------------------------------------------


def test_spread_takes_the_middle_of_each_part():
    sizes = {("chair", str(n)): float(n) for n in reversed(range(9))}
    assert spread(sizes, 3) == [("chair", "1"), ("chair", "4"), ("chair", "7")]
    assert sorted(spread(sizes, 100)) == sorted(sizes)
    assert spread({}, 3) == []


def test_spread_reaches_every_class():
    sizes = {(name, str(n)): float(n) for name in "abc" for n in range(5)}
    assert [name for name, _ in spread(sizes, 3)] == ["a", "b", "c"]
    assert {number for _, number in spread(sizes, 3)} == {"2"}
