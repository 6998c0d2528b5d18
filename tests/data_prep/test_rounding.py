from __future__ import annotations

import random
import sys

import numpy as np
import pytest

from data_prep.failures import MissingDependency
from data_prep.rounding import MODES, rounded, rounded_at_random, rounding_modes

ONE, THREE = np.ones(64), np.full(64, 3.0)
BELOW = np.nextafter(1 / 3, 0)  # the nearest double of 1/3 lies below it: 1/3 - nearest > 0


def thirds():
    return np.divide(ONE, THREE)


@pytest.mark.parametrize(
    ("mode", "positive", "negative"),
    [
        ("nearest", 1 / 3, -1 / 3),
        ("down", 1 / 3, -np.nextafter(1 / 3, 1)),
        ("up", np.nextafter(1 / 3, 1), -1 / 3),
        ("toward-zero", 1 / 3, -1 / 3),
    ],
)
def test_a_third_is_rounded_as_the_mode_says(mode, positive, negative):
    with rounded(mode):
        quotient, of_negative = thirds(), np.divide(-ONE, THREE)
    assert {*quotient} == {positive}
    assert {*of_negative} == {negative}
    assert {*thirds()} == {1 / 3}


def test_an_exception_restores_the_mode():
    with pytest.raises(KeyError), rounded("up"):
        raise KeyError
    assert {*thirds()} == {1 / 3}
    with pytest.raises(KeyError), rounded_at_random(random.Random(0)):
        raise KeyError
    assert {*thirds()} == {1 / 3}
    assert sys.getprofile() is None


def test_modes_at_random_are_all_drawn_and_repeat_with_the_seed():
    def sample(seed):
        with rounded_at_random(random.Random(seed)):
            return [float(thirds().max()) for _ in range(40)]

    first = sample(1)
    assert {*first} == {1 / 3, float(np.nextafter(1 / 3, 1))}
    assert sample(1) == first
    assert sample(2) != first


def test_a_machine_without_known_modes_is_refused_in_one_line():
    assert len({*MODES.values()}) == 4
    with pytest.raises(MissingDependency, match=r"its processor is aarch64.* glibc on x86_64; run"):
        rounding_modes("aarch64")
