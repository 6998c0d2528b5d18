"""Names of conditions in words, and their places on an axis."""

from __future__ import annotations

import numpy as np
import pytest

from bench.catalogue.conditions import condition_name, listed, places


@pytest.mark.parametrize(
    ("condition", "words", "brief"),
    [
        ("2048", "2,048 points", "2,048"),
        ("512", "512 of 2,048 points", "512"),
        ("noise-0.10", "noise 10 % of the radius", "noise 10 %"),
        ("outliers-0.01", "1 % outliers", "outliers 1 %"),
        ("missing-0.50", "50 % missing on one side", "missing 50 %"),
        ("density-10", "1,024 points, 10 times as dense at one end", "density 10 : 1"),
        ("of-a-plug-in", "of-a-plug-in", "of-a-plug-in"),
    ],
)
def test_conditions_in_words(condition, words, brief):
    name = condition_name(condition)
    assert (name.words, name.brief) == (words, brief)


def test_conditions_of_a_kind_stand_together():
    every = ("2048", "512", "noise-0.05", "noise-0.10", "outliers-0.01")
    assert np.diff(places(every)).tolist() == pytest.approx([1, 1.6, 1, 1.6])
    assert listed(every, every) == "every condition"
    assert listed(every[2:4], every) == "any noise"
    assert listed(every[1:], every) == "every condition but 2,048 points"
    assert listed(every[1:4], every) == "512 of 2,048 points, any noise"
    assert listed(every[:1], every[:1]) == "2,048 points"
