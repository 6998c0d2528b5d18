"""Names of conditions in words."""

from __future__ import annotations

import pytest

from bench.catalogue.suites import SUITES
from studies.wording import condition_in_words


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("2048", "2,048 points"),
        ("512", "512 of 2,048 points"),
        ("noise-0.05", "noise 5\N{NO-BREAK SPACE}% of the radius"),
        ("outliers-0.10", "10\N{NO-BREAK SPACE}% outliers"),
        ("missing-0.50", "50\N{NO-BREAK SPACE}% missing"),
        ("density-10", "density 10 : 1"),
        ("of-a-plug-in", "of-a-plug-in"),
    ],
)
def test_conditions_in_words(condition, words):
    assert condition_in_words(condition) == words


def test_every_condition_of_a_suite_has_words():
    conditions = {condition for suite in SUITES for condition in suite.conditions}
    assert [c for c in conditions if condition_in_words(c) == c] == []
