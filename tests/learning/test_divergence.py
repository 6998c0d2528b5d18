from __future__ import annotations

import numpy as np
import pytest

from learning.divergence import FACTOR, FIRST, WINDOW, DivergenceDetector


def verdicts(values, detector=None):
    detector = detector or DivergenceDetector()
    return [detector.add({"loss": value}) for value in values]


def test_a_loss_that_leaps_is_named():
    usual = [2.0] * FIRST
    assert verdicts([*usual, 2 * FACTOR]) == [None] * (FIRST + 1)
    assert verdicts([*usual, 2.01 * FACTOR])[-1] == "loss is 201, 100 times what it was"
    assert verdicts([*usual, -2.01 * FACTOR])[-1] == "loss is -201, 100 times what it was"


@pytest.mark.parametrize(
    "values",
    [
        [1.0] * (FIRST - 1) + [1e9],
        [1.3] * FIRST + [1e-6] * 5 * WINDOW + [5.0],  # a discriminator wins, then does not
        np.geomspace(1, 1e4, 1000),
        [0.0] * 500 + [3.0] * 50,
        # a standard deviation of a factor e: far wider than any loss seen so far
        np.random.default_rng(0).lognormal(sigma=1.0, size=20_000),
    ],
    ids=["too few to compare with", "back from almost nothing", "slow", "left out", "noise"],
)
def test_healthy_losses(values):
    assert not any(verdicts(values))


@pytest.mark.parametrize("left_out", [0, 500])
def test_terms_that_were_left_out_do_not_count(left_out):
    assert verdicts([0.0] * left_out + [3.0] * FIRST + [1e3])[-1] is not None


def test_history_takes_the_place_of_what_was_logged_before_a_resume():
    values = [5.0] * FIRST + [1.0] * 300
    assert verdicts([501.0], DivergenceDetector({"loss": np.array(values)}))[0] is not None
    assert verdicts([499.0], DivergenceDetector({"loss": np.array(values)}))[0] is None
