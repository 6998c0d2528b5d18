"""Errors of Fréchet distances, where the true one is known."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis import intervals
from bench.metrics.frechet import frechet_distance
from studies.frechet_error import Sets, errors, estimates


def made(objects: int, rng: np.random.Generator) -> Sets:
    """Two views an object, normal features; the two sets are shifted by 1 in one feature of 4."""
    names = np.repeat(np.arange(objects), 2)
    shift = np.array([1.0, 0.0, 0.0, 0.0])
    drawn, true = (rng.normal(size=(len(names), 4)) for _ in range(2))
    return Sets(drawn + shift, true, names)


def test_estimates_are_of_the_chosen_objects_alone():
    sets = made(12, np.random.default_rng(0))
    raw, debiased = estimates(sets, np.arange(9))
    assert raw == pytest.approx(frechet_distance(sets.drawn[:18], sets.true[:18]), rel=1e-9)
    without = [
        frechet_distance(sets.drawn[:18][keep], sets.true[:18][keep])
        for keep in (np.arange(18) // 2 != i for i in range(9))
    ]
    assert debiased == pytest.approx(9 * raw - 8 * np.mean(without), rel=1e-9)


def test_debiased_errors_are_the_smaller_ones(monkeypatch):
    """The true distance is 1, of infinite sets. Sets of 12 are too far apart by covariances."""
    monkeypatch.setattr(intervals, "FEWEST", 2)
    found = errors(made(400, np.random.default_rng(1)), 6, 200, reference=1.0)
    assert found.shape == (200, 2)
    raw, debiased = found.mean(axis=0)
    error = found.std(axis=0) / np.sqrt(200)
    # E|m1 - m2|^2 alone is 1 + 4 features * 2 / 12: a bias of 2/3
    assert raw > 2 / 3 - 5 * error[0]
    assert abs(debiased) < raw / 2
