from __future__ import annotations

import pytest

from bench.catalogue.methods import METHODS
from bench.suites.stability.cases import CASES, VIEWS
from bench.suites.stability.expectations import (
    EXPECTED,
    Agrees,
    Changes,
    Draws,
    Either,
    Fails,
    NoExpectation,
    expectation,
)
from bench.suites.stability.outcomes import Observation, outcomes_of, verdict
from data_prep.scene import View

IMAGES = Observation("plain", "splat", "", "", 0.25)
FAILED = Observation("plain", "splat", "apss: no faces", "")
BY_ID = {case.id: case for case in CASES}


def changed(mean, most=0):
    return IMAGES._replace(mean_change=mean, most_change=most)


def test_cases_are_about_others_that_are_there():
    assert len(BY_ID) == len(CASES)
    for case in (case for case in CASES if case.like is not None):
        assert len(case.views) % len(BY_ID[case.like].views) == 0
        assert BY_ID[case.like].like is None
    # a method that chooses draws what the chosen one draws
    assert EXPECTED.keys() == {method.id for method in METHODS}
    for stated in EXPECTED.values():
        for case, expected in stated.items():
            assert BY_ID[case].like or not isinstance(expected, Agrees | Changes)


def test_views_that_should_agree_are_the_same_direction():
    for case in ("azimuth+180", "azimuth+720"):
        for view, other in zip(BY_ID[case].views, BY_ID[BY_ID[case].like].views, strict=True):
            assert (view.azimuth_deg - other.azimuth_deg) % 360 == 0
            assert view.elevation_deg == other.elevation_deg
            assert view != other
    assert BY_ID["batch-doubled"].views == VIEWS + VIEWS
    assert {view.elevation_deg for view in BY_ID["elevation+90"].views} == {90.0}
    assert View(30.0, -90.0) in BY_ID["elevation-90"].views
    assert BY_ID["last-bit"].conditions[:2] == ("last-bit", "last-bit-2")
    assert len({condition for case in CASES for condition in case.conditions}) == len(CASES) + 29


@pytest.mark.parametrize(
    ("method", "case", "expected"),
    [
        ("splat", "plain", Draws()),
        ("splat", "shuffled", Agrees(0.01, 1)),
        ("splat", "millimetres", Agrees(1.0)),
        ("surface-apss", "last-bit", Agrees(0.5)),
        ("splat", "0-points", Fails("input: no points")),
        ("other", "shuffled", NoExpectation()),
    ],
)
def test_what_is_expected(method, case, expected):
    assert expectation(method, BY_ID[case]) == expected


@pytest.mark.parametrize(
    ("expected", "seen", "kind"),
    [
        (Draws(), IMAGES, "holds"),
        (Draws(), FAILED, "unexpected"),
        (Agrees(0.5), changed(0.5, 255), "holds"),
        (Agrees(0.5), changed(0.51), "unexpected"),
        (Agrees(0.5, 1), changed(0.1, 1), "holds"),
        (Agrees(0.5, 1), changed(0.1, 2), "unexpected"),
        (Agrees(0.5), IMAGES, "unexpected"),  # nothing to compare with
        (Agrees(0.5), FAILED, "unexpected"),
        (Changes(0.5, "why"), changed(0.51), "differs"),
        (Changes(0.5, "why"), changed(0.5), "unexpected"),  # it has been fixed
        (Changes(0.5, "why"), FAILED, "unexpected"),
        (Fails("apss: "), FAILED, "refused"),
        (Fails("no faces"), FAILED, "unexpected"),  # a reason has to begin so
        (Fails("apss: "), IMAGES, "unexpected"),
        (Fails("timeout: ", "contained"), FAILED._replace(reason="timeout: 60 s"), "contained"),
        (Either((Draws(), Fails("apss: ")), "why"), IMAGES, "holds"),
        (Either((Draws(), Fails("apss: ")), "why"), FAILED, "refused"),
        (Either((Draws(), Fails("draw: ")), "why"), FAILED, "unexpected"),
        (NoExpectation(), IMAGES, "holds"),
        (NoExpectation(), FAILED, "refused"),
        (NoExpectation(), changed(0.9), "holds"),
        (NoExpectation(), changed(1.1), "differs"),
        *(
            (NoExpectation(), FAILED._replace(reason=reason), "unexpected")
            for reason in ("ValueError: 3", "timeout: 60 s", "crash: SIGSEGV", "memory: 4 GiB")
        ),
    ],
)
def test_verdicts(expected, seen, kind):
    assert verdict(expected, seen) == kind


def test_outcomes_say_what_was_expected_and_what_came():
    moved = changed(0.5, 9)._replace(ssim_change=0.00123, lpips_change=0.0456)
    observations = [
        changed(1.25, 7)._replace(case="shuffled", notes="3 faces"),
        moved._replace(case="last-bit", method="surface-apss"),
        FAILED._replace(case="coplanar", method="surface-apss"),
    ]
    shuffled, last_bit, coplanar = outcomes_of(observations).itertuples(index=False, name=None)
    assert shuffled == (
        *("shuffled", "metamorphic", "splat"),
        "as plain: mean change up to 0.01 grey levels, at most 1",
        "images, 25.0 % not white; change 1.25, at most 7; 3 faces",
        "unexpected",
    )
    assert last_bit[4].endswith("change 0.5, at most 9; ssim moves by up to 0.0012, lpips by 0.046")
    assert coplanar[4:] == ("failed: apss: no faces", "refused")
