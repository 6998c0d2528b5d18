from __future__ import annotations

import pickle

import pytest

from data_prep.failures import BadInput, MissingDependency, StageFailure


@pytest.mark.parametrize(
    "failure", [StageFailure("apss", "no faces"), BadInput("x: bad"), MissingDependency("no GL")]
)
def test_failures_cross_process_boundaries(failure: Exception) -> None:
    found = pickle.loads(pickle.dumps(failure))
    assert type(found) is type(failure)
    assert str(found) == str(failure)
    assert vars(found) == vars(failure)


def test_a_stage_failure_names_its_stage_and_is_no_error_of_the_user() -> None:
    failure = StageFailure("apss", "no faces")
    assert (failure.stage, failure.problem, str(failure)) == ("apss", "no faces", "apss: no faces")
    assert issubclass(MissingDependency, BadInput)
    assert issubclass(BadInput, ValueError)
    assert not issubclass(StageFailure, ValueError)
