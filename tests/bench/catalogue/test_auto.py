"""The choice of `auto` by a table, its refusals, and its renderer."""

from __future__ import annotations

import numpy as np
import pytest

from bench.catalogue.auto import AutoTable, Candidate, CloudEstimate, auto_id, budget_ms_of
from bench.catalogue.auto_renderer import AutoRenderer, estimate_of
from bench.catalogue.auto_table import TABLE
from bench.catalogue.methods import METHODS, find_method
from bench.running.work import draw
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.scene import PointCloud, View

MADE_UP = AutoTable(
    noisy_from=0.5,
    clean={
        2000: (Candidate("slow", 0.9, 100.0), Candidate("quick", 0.8, 10.0)),
        500: (Candidate("quick", 0.7, 4.0), Candidate("slow", 0.6, 50.0)),
    },
    noisy={2000: (Candidate("smooth", 0.5, 200.0), Candidate("quick", 0.3, 20.0))},
)
VIEWS = (View(30.0, 20.0), View(-100.0, 0.0))


def cloud(points: int, noise: float = 0.0) -> CloudEstimate:
    return CloudEstimate(points, noise, spacing=0.1)


def sphere(points: int, noise: float = 0.0) -> PointCloud:
    rng = generator("test", "sphere")
    normal = rng.normal(size=(points, 3))
    radius = 0.7 + noise * rng.normal(size=(points, 1))
    return PointCloud(radius * normal / np.linalg.norm(normal, axis=1, keepdims=True))


@pytest.mark.parametrize(
    ("estimate", "budget_ms", "method", "cost_ms"),
    [
        (cloud(2000), None, "slow", 100.0),
        (cloud(2000), 100.0, "slow", 100.0),
        (cloud(2000), 99.9, "quick", 10.0),
        (cloud(500), None, "quick", 4.0),
        (cloud(999), None, "quick", 4.0 * 999 / 500),  # nearer to 500, by ratio
        (cloud(1001), None, "slow", 100.0),
        (cloud(10), 4.0, "quick", 4.0),
        (cloud(0), None, "quick", 4.0),
        (cloud(20000), None, "slow", 1000.0),  # ten times the points
        (cloud(20000), 999.0, "quick", 100.0),
        (cloud(2000, 0.05), None, "slow", 100.0),  # as noisy as a clean cloud may be
        (cloud(2000, 0.051), None, "smooth", 200.0),
        (cloud(500, 0.051), 199.0, "quick", 20.0),
    ],
)
def test_the_choice_by_points_noise_and_budget(estimate, budget_ms, method, cost_ms):
    chosen = MADE_UP.choose(estimate, budget_ms)
    assert (chosen.method, chosen.cost_ms) == (method, pytest.approx(cost_ms))


def test_of_equal_scores_the_cheaper_is_taken():
    table = AutoTable(1.0, {9: (Candidate("a", 0.5, 2.0), Candidate("b", 0.5, 1.0))}, {})
    assert table.choose(cloud(9), None).method == "b"


def test_a_budget_below_the_cheapest_names_it_with_a_budget_that_is_enough():
    with pytest.raises(BadInput) as refusal:
        MADE_UP.choose(cloud(2001), 10.0)
    assert str(refusal.value) == (
        "budget 10ms: for a cloud of 2001 points the cheapest method is quick with 10.1 ms for one "
        "image; give at least 10.1ms"
    )
    assert MADE_UP.choose(cloud(2001), 10.1).method == "quick"
    with pytest.raises(BadInput, match="budget 3ms: for any cloud the cheapest method is quick wi"):
        MADE_UP.methods(3.0)
    assert MADE_UP.methods(4.0) == ["quick"]
    assert MADE_UP.methods() == ["quick", "slow", "smooth"]


@pytest.mark.parametrize(
    ("text", "budget_ms"), [("50ms", 50.0), ("0.2s", 200.0), (" 2s ", 2000.0), ("7.5ms", 7.5)]
)
def test_a_budget_is_a_time(text, budget_ms):
    assert budget_ms_of(text) == budget_ms


@pytest.mark.parametrize("text", ["", "50", "0ms", "-5ms", "2m", "fast", "1e3ms", "nanms"])
def test_other_text_is_no_budget(text):
    with pytest.raises(BadInput, match=r"give a time over 0 with its unit, as in 50ms or 0\.2s"):
        find_method(f"auto@{text or ' '}")


def test_the_id_of_a_budget():
    assert (auto_id(None), auto_id(50), auto_id(7.5)) == ("auto", "auto@50ms", "auto@7.5ms")
    assert find_method("auto@50ms").id == "auto@50ms"
    with pytest.raises(BadInput, match=r"budget 0\.001ms: for any cloud the cheapest method is "):
        find_method("auto@0.001ms")


def test_the_table_has_methods_in_grey_that_know_any_object():
    everything = [
        m for cells in (TABLE.clean, TABLE.noisy) for cell in cells.values() for m in cell
    ]
    methods = [find_method(candidate.method) for candidate in everything]
    assert {method.color for method in methods} == {"none"}
    assert {method.trained_on for method in methods} <= {"nothing", "13 classes"}
    assert {method.kind for method in methods} <= {"network", "reconstruction", "splat"}
    assert all(method in METHODS for method in methods)
    assert 0 < TABLE.noisy_from < 1
    for cells in (TABLE.clean, TABLE.noisy):
        for cell in cells.values():
            costs = [candidate.cost_ms for candidate in cell]
            scores = [candidate.score for candidate in cell]
            assert costs == sorted(costs, reverse=True)  # the better, the dearer
            assert scores == sorted(scores, reverse=True)


def test_results_depend_on_the_table_and_on_the_methods_within_the_budget():
    everything, cheap = find_method("auto").identity(), find_method("auto@20ms").identity()
    assert everything != cheap
    for method in TABLE.methods():
        assert f"{method} {find_method(method).version}: {find_method(method).identity()}" in (
            everything
        )
    assert not any(
        f"{method} " in cheap for method in set(TABLE.methods()) - set(TABLE.methods(20))
    )


def test_the_estimate_of_a_cloud():
    clean, noisy = estimate_of(sphere(2048)), estimate_of(sphere(2048, 0.1))
    assert clean.points == noisy.points == 2048
    assert clean.noise < TABLE.noisy_from * clean.spacing
    assert noisy.noise > TABLE.noisy_from * noisy.spacing
    points = sphere(2048, 0.1).points
    assert estimate_of(PointCloud(points[::-1])) == noisy


@pytest.fixture
def loaded():
    return []


@pytest.fixture
def renderer(loaded):
    """Return a renderer that draws clean clouds with splat and noisy ones with splat-fill."""

    def load(method):
        loaded.append(method)
        return find_method(method).load("cpu")

    table = AutoTable(
        TABLE.noisy_from,
        clean={2048: (Candidate("splat", 0.9, 5.0),)},
        noisy={2048: (Candidate("splat-fill", 0.8, 10.0), Candidate("splat", 0.5, 5.0))},
    )
    return AutoRenderer(table, None, load)


def images(renderer, cloud):
    return draw(find_method("auto"), renderer, cloud, VIEWS, generator("test"))


@pytest.mark.parametrize(("noise", "method"), [(0.0, "splat"), (0.1, "splat-fill")])
def test_it_draws_as_the_chosen_method_and_says_which(renderer, loaded, noise, method):
    drawn = images(renderer, sphere(2048, noise))
    expected = draw(
        find_method(method),
        find_method(method).load("cpu"),
        sphere(2048, noise),
        VIEWS,
        generator("test"),
    )
    assert drawn.images.tobytes() == expected.images.tobytes()
    assert drawn.notes.startswith(f"auto: {method} for 2048 points, noise 0.")
    assert loaded == [method]
    again = images(renderer, sphere(2048, noise))
    assert (again.images.tobytes(), again.notes) == (drawn.images.tobytes(), drawn.notes)
    assert loaded == [method]  # once


def test_bad_clouds_are_left_to_the_method(renderer):
    for points in (np.zeros((0, 3)), np.full((50, 3), np.nan)):
        with pytest.raises(StageFailure, match="input: "):
            images(renderer, PointCloud(points))
    few = images(renderer, PointCloud(np.eye(3)))
    assert few.notes == "auto: splat for 3 points, noise 0.000, spacing 0.000"
