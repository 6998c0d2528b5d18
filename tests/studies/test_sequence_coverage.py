"""The study decides as the tables do, and moves populations where it says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.decided import BOUNDS, EQUAL, DecidedPairs, HeadlinePair
from bench.analysis.sequences import ConfidenceSequence
from studies.sequence_coverage import (
    CLOSED,
    NEVER,
    Decisions,
    coverage,
    decisions,
    ever_missed_by_t,
    false_verdicts,
    moved,
    simulate,
)

PAIR = HeadlinePair("splat-net", "alpha-wrap", "2048", "ssim-object")


@pytest.mark.parametrize(("mean", "spread"), [(0.1, 0.1), (-0.12, 0.1), (0.0, 0.003)])
def test_runs_are_decided_when_the_tables_decide_them(mean, spread):
    rng = np.random.default_rng(0)
    values = rng.normal(mean, spread, (3, 900)).clip(-0.5, 0.5)
    decided = decisions(values, BOUNDS[PAIR.metric], 0.05)
    for run, differences in enumerate(values):
        pairs = DecidedPairs([PAIR], ["chair"])
        (state,) = pairs.states
        for value in differences:
            state.add(value)
        first = {name: int(column[run]) for name, column in decided._asdict().items()}
        assert state.verdict == min(first, key=first.__getitem__) != "open"
        assert state.decided_after == min(first.values()) < NEVER


@pytest.mark.parametrize("mean", [0.0, EQUAL + 0.0005])
def test_moved_populations_have_their_mean_within_bounds(mean):
    values = np.array([0.5, 0.3, 0.1, -0.5, 0.45])
    actual = moved(values, mean, 0.5)
    assert actual.mean() == pytest.approx(mean, abs=1e-9)
    assert abs(actual).max() <= 0.5


@pytest.mark.parametrize(
    ("mean", "expected"),
    [
        (0.2, [False, True, True, False, False]),
        (-0.2, [True, False, True, False, True]),
        (0.005, [False, True, False, False, False]),
        (0.0, [True, True, False, False, True]),
    ],
)
def test_false_verdicts_are_counted(mean, expected):
    """Runs that are ahead, behind, equal, open, and ahead before they are equal."""
    verdicts = Decisions(
        ahead=np.array([10, NEVER, NEVER, NEVER, 10]),
        behind=np.array([NEVER, 10, NEVER, NEVER, NEVER]),
        equal=np.array([NEVER, NEVER, 10, NEVER, 11]),
    )
    assert false_verdicts(verdicts, mean).tolist() == expected


def test_simulated_runs_count_objects():
    other = PAIR._replace(condition="512")
    made = simulate({PAIR: np.full(5, 0.4), other: np.full(5, 0.001)}, 4, 60, 0)
    (first, *_), (last, *_) = made.of_pair.tolist()
    assert first == decisions(np.full((1, 60), 0.4), 0.5, 0.05 / 2).ahead[0] < last == 60
    assert made.of_pair.tolist() == [[first] * 4, [last] * 4]
    assert made.used.tolist() == [60] * 4
    assert made.false == 0
    assert math.isnan(made.by_t)


@pytest.mark.parametrize("name", CLOSED)
def test_true_means_are_as_stated(name):
    draw, mean = CLOSED[name]
    values = draw(np.random.default_rng(1), (1, 200_000))
    assert abs(values).max() <= 0.5
    assert abs(values.mean() - mean) < 5 * values.std() / math.sqrt(200_000)


def test_coverage_counts_what_sequences_leave_out():
    """The rate over 50 runs of 30 objects is that of sequences with a fine grid."""
    rate, by_t = coverage("two values", 30, 50)
    values = CLOSED["two values"][0](np.random.default_rng(30), (50, 30))
    missed = 0
    for run in values:
        sequence = ConfidenceSequence(0.05, 0.5, 0.0125)  # its grid has the mean
        for value in run:
            sequence.add(value)
        missed += sequence.low >= 0.0 or sequence.high <= 0.0
    assert rate == missed / 50
    assert by_t == ever_missed_by_t(values, 0.0, 0.05).mean()


def test_t_intervals_miss_from_eight_objects_on():
    far = np.array([[1.0, -1.0] * 5, [1.0, 1.001] * 5])
    assert ever_missed_by_t(far, 0.0, 0.05).tolist() == [False, True]
