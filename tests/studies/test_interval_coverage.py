"""The coverage of intervals that the page about the protocol states."""

from __future__ import annotations

import math

import pandas as pd
import pytest

from studies.documents import NUMBERS
from studies.interval_coverage import OBJECTS, SAMPLES, SHAPES, coverage

STATED = pd.read_csv(NUMBERS / "interval-coverage.csv").set_index(["shape", "objects"])["coverage"]
FEW = 2000  # samples of the test


def test_every_shape_is_stated_at_every_number_of_objects():
    assert sorted(STATED.index) == sorted((name, count) for name in SHAPES for count in OBJECTS)


@pytest.mark.parametrize(("name", "objects"), [("normal", 8), ("one-in-twenty-fails", 24)])
def test_the_page_states_what_other_samples_give(name, objects):
    """Two counts of one share differ by four standard errors of both in 1 of 16,000 cases."""
    share = STATED[name, objects]
    error = math.sqrt(share * (1 - share) * (1 / FEW + 1 / SAMPLES))
    assert abs(coverage(name, objects, FEW, seed=1) - share) < 4 * error


def test_a_method_that_never_fails_on_the_sampled_objects_hides_that_it_fails():
    """All samples of 8 objects without a failure miss: at one in ten these are .9^8 = .43."""
    most = 1 - 0.9**8
    assert STATED["one-in-ten-fails", 8] < most + 4 * math.sqrt(most * (1 - most) / SAMPLES)
