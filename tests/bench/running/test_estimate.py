"""What a run costs, from what a pilot took: closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bench.records.record import GROUND_TRUTH
from bench.running.isolation import TASKS_PER_WORKER
from bench.running.pilot import (
    Pilot,
    Sample,
    core_s,
    estimate,
    loading_s,
    mean_at,
    peak_mib,
    spread,
    ssim_deviations,
)

SIZES = (100.0, 200.0, 300.0, 400.0)


def sample(method="splat", condition="2048", number=0, seconds=1.0, **changes) -> Sample:
    made = Sample(
        method, condition, "chair", str(number), SIZES[number], seconds, 0.5, 1000.0, 300.0, 0.5, ""
    )
    return replace(made, **changes)


def pilot(*samples) -> Pilot:
    return Pilot(samples, SIZES)


def test_costs_on_a_line_give_the_mean_at_the_mean_size_within_the_range_measured():
    sizes = np.array(SIZES)
    found = mean_at(2.0 + 0.01 * sizes, sizes, [300.0] * 5)
    assert (found.value, found.low, found.high) == pytest.approx((5.0, 5.0, 5.0), abs=1e-12)
    assert mean_at(sizes, sizes, [1e6]).value == 400.0
    assert mean_at(sizes, sizes, [-1e6]).value == 100.0


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


@pytest.mark.parametrize(
    ("costs", "sizes"), [([1.0, 2.0, 6.0, 7.0], [7.0] * 4), ([1.0, 2.0, 6.0], [0.0, 1.0, 2.0])]
)
def test_without_a_line_the_mean_with_its_t_interval(costs, sizes):
    found = mean_at(np.array(costs), np.array(sizes), [1000.0])
    half = stats.t.ppf(0.975, len(costs) - 1) * np.std(costs, ddof=1) / math.sqrt(len(costs))
    mean = np.mean(costs)
    assert tuple(found) == pytest.approx((mean, max(0.0, mean - half), mean + half))


def test_one_object_has_no_interval_and_none_no_mean():
    one = mean_at(np.array([3.0]), np.array([1.0]), [1.0])
    assert one.value == 3.0
    assert math.isnan(one.low)
    assert math.isnan(mean_at(np.zeros(0), np.zeros(0), []).value)


def test_cost_is_items_times_seconds_summed_over_conditions():
    samples = [sample(number=n, seconds=2.0) for n in range(4)]
    samples += [sample(condition="512", number=n, seconds=3.0) for n in range(4)]
    left = {("splat", "2048"): 10, ("splat", "512"): 4}
    assert estimate(pilot(*samples), left) == pytest.approx((32, 32, 32))
    assert estimate(pilot(*samples), left, "method_s").value == pytest.approx(14 * 0.5)
    assert estimate(pilot(*samples), left, "size_b").value == pytest.approx(14_000)
    assert peak_mib(pilot(*samples), left) == 300.0


def test_sum_of_the_methods_is_the_whole():
    rng = np.random.default_rng(1)
    cells = [(m, c) for m in ("splat", "blank") for c in ("2048", "512")]
    left = dict.fromkeys([(GROUND_TRUTH, ""), *cells], 7)
    loading = {"splat": 3.0, "blank": 1.0, GROUND_TRUTH: 2.0}
    samples = [
        sample(m, c, n, float(rng.uniform(1, 9)), loading_s=None if n else loading[m])
        for m, c in left
        for n in range(4)
    ]
    measured = pilot(*samples)
    parts = sum(estimate(measured, {cell: 7}).value for cell in left)
    assert estimate(measured, left).value == pytest.approx(parts)
    whole = core_s(measured, left, 2)
    assert whole.value == pytest.approx(parts + 2 * 2.0 + 2 * (3.0 + 1.0))
    assert whole.low < whole.value < whole.high


def test_loading_is_paid_once_a_process_as_the_mean_of_processes():
    few = pilot(*(sample(number=n, loading_s=s) for n, s in enumerate((4.0, 6.0, None))))
    many = 10 * TASKS_PER_WORKER + 1
    for items, workers, births in ((1, 4, 1), (3, 4, 3), (100, 4, 4), (many, 4, 11), (0, 4, 0)):
        assert loading_s(few, {("splat", "2048"): items}, workers) == pytest.approx(5.0 * births)


def test_nothing_left_costs_nothing():
    nothing = {("splat", "2048"): 0}
    assert core_s(pilot(sample(loading_s=1.0)), nothing, 2).value == 0.0
    assert estimate(pilot(sample()), nothing, "size_b").value == 0.0
    assert math.isnan(peak_mib(pilot(sample()), nothing))


def test_a_worker_that_died_leaves_the_mean_of_the_others():
    died = {"seconds": math.nan, "reason": "crash: the worker died (SIGSEGV)"}
    samples = [sample(number=n, seconds=2.0) for n in range(3)]
    samples.append(sample(number=3, **died))
    left = {("splat", "2048"): 10}
    assert estimate(pilot(*samples), left).value == pytest.approx(20.0)
    elsewhere = [sample(condition="512", number=n, **died) for n in range(4)]
    left[("splat", "512")] = 10
    assert estimate(pilot(*samples, *elsewhere), left).value == pytest.approx(40.0)
    assert math.isnan(estimate(pilot(sample(**died)), left).value)


def test_ssim_deviations_are_of_cells_with_two_objects():
    scores = (0.2, 0.4, 0.6, 0.8)
    samples = [sample(number=n, ssim=score) for n, score in enumerate(scores)]
    samples += [sample("blank", ssim=0.5), sample("constant", ssim=None)]
    cells = [("splat", "2048"), ("blank", "2048"), ("constant", "2048")]
    found = ssim_deviations(pilot(*samples), cells)
    assert found == {("splat", "2048"): pytest.approx(np.std(scores, ddof=1))}


def test_spread_takes_the_middle_of_each_part_and_reaches_every_class():
    sizes = {("chair", str(n)): float(n) for n in reversed(range(9))}
    assert spread(sizes, 3) == [("chair", "1"), ("chair", "4"), ("chair", "7")]
    assert sorted(spread(sizes, 100)) == sorted(sizes)
    assert spread({}, 3) == []
    of_classes = {(name, str(n)): float(n) for name in "abc" for n in range(5)}
    assert spread(of_classes, 3) == [("a", "2"), ("b", "2"), ("c", "2")]
