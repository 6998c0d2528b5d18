"""The table of costs, and the method that a budget chooses by it."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from bench.catalogue.chosen import (
    MeasuredMethod,
    best_within,
    budget_ms_of,
    cost_of,
    measured_methods,
    times_by_points,
    times_dearer,
)
from bench.catalogue.methods import COST_VARIANTS, METHODS, find_method

DOCS = Path(__file__).parents[3] / "results" / "docs"
TABLE = measured_methods()
SAME_SIZE = {"pc2pix@acgan", "pc2pix@all", "true-mesh@grey"}  # as another of their family


def lines(name, **wanted):
    with (DOCS / name).open(encoding="utf-8", newline="") as file:
        return [r for r in csv.DictReader(file) if all(r[k] == v for k, v in wanted.items())]


def test_what_has_a_score_draws_objects_of_any_kind_in_grey():
    methods = [find_method(name) for name in TABLE]
    for method in methods:
        if TABLE[method.id].score is not None:
            assert method.color == "none"
            assert method.trained_on != "chairs"
            assert method.kind != "reference"


def test_every_method_has_a_measured_cost():
    """Open3D is an extra, which the machine that measures need not have."""
    listed = {method.id for method in (*METHODS, *COST_VARIANTS)}
    assert {*TABLE} | SAME_SIZE | {"open3d-poisson"} == listed
    for measured in TABLE.values():
        assert measured.further_view_ms > 0
        # An image of `blank` is nothing but memory, and that of twenty is paged in for each call.
        assert measured.further_view_ms < measured.one_view_ms or measured.method == "blank"
        assert measured.cloud_ms(1) == measured.one_view_ms
        assert measured.cloud_ms(3) == measured.one_view_ms + 2 * measured.further_view_ms


def test_scores_are_those_of_the_published_run():
    of_run = {}
    for metric in ("ssim", "lpips"):
        wanted = {"condition": "2048", "class": "average", "metric": metric}
        values = lines("real-meshes-grey.csv", **wanted)
        of_run[metric] = {line["method"]: float(line["value"]) for line in values}
    for name, measured in TABLE.items():
        if measured.score is not None:
            expected = (of_run["ssim"][name] + 1 - of_run["lpips"][name]) / 2
            assert measured.score == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize(
    ("budget_ms", "method"),
    [
        (5, "splat"),
        (TABLE["splat-fill"].one_view_ms, "splat-fill"),
        (50, "splat-net@grey"),
        # alpha-wrap and occupancy-net cost more and score less
        (TABLE["upsampled-wrap"].one_view_ms - 0.01, "splat-net@grey"),
        (TABLE["fused-net@grey"].one_view_ms - 0.01, "upsampled-wrap"),
        (TABLE["fused-net@grey"].one_view_ms, "fused-net@grey"),
        (1e9, "fused-net@grey"),
    ],
)
def test_a_budget_buys_the_best_score(budget_ms, method):
    assert best_within(budget_ms).method == method


@pytest.mark.parametrize(
    ("points", "times"),
    [
        (1, 1),  # fewer points than any that were measured cost as much
        (100, 1),
        (1000, 10**0.5),  # in the middle of 100 and 10,000, of which the second costs 10 times
        (10_000, 10),
        (20_000, 20),  # from here on in proportion, and beyond the last one likewise
        (40_000, 40),
        (10**6, 1000),
    ],
)
def test_costs_are_interpolated_in_logarithms_and_go_on_beyond(points, times):
    measured = {40_000: 80.0, 100: 2.0, 10_000: 20.0}
    assert times_dearer(measured, points) == pytest.approx(times, rel=1e-12)


@pytest.mark.parametrize("points", [2048, 2049, 100_000, 10**6])
def test_at_any_number_of_points_the_best_method_within_the_budget_is_chosen(points):
    """The choice is that of brute force over the tables."""
    by_points = times_by_points()
    costs = {}
    for name, measured in TABLE.items():
        if measured.score is not None and (points <= 2048 or len(by_points.get(name, ())) > 1):
            dearer = times_dearer(by_points[name], points) if points > 2048 else 1
            costs[name] = measured.one_view_ms * dearer
    for budget_ms in (min(costs.values()), 300, 1000, 1e9):
        within = [name for name, cost_ms in costs.items() if cost_ms <= budget_ms]
        if within:
            best = max(within, key=lambda name: TABLE[name].score)
            chosen = best_within(budget_ms, points)
            assert (chosen.method, chosen.one_view_ms) == (best, pytest.approx(costs[best]))


@pytest.mark.parametrize(
    ("text", "budget_ms"), [("50ms", 50.0), ("0.2s", 200.0), (" 2s ", 2000.0), ("7.5ms", 7.5)]
)
def test_a_budget_is_a_time(text, budget_ms):
    assert budget_ms_of(text) == budget_ms


def test_a_method_without_a_line_costs_as_its_family():
    costs = {"pc2pix": MeasuredMethod("pc2pix", 20.0, 5.0, None)}
    assert cost_of("pc2pix@all", costs) == cost_of("pc2pix", costs) == costs["pc2pix"]
    assert cost_of("surface-fit", costs) is None
