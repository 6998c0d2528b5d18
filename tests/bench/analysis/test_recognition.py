from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from bench.analysis.recognition import true_gallery
from bench.judges import answers as control
from bench.records.record import GROUND_TRUTH

from ..builders import FeaturesAtHand


def answers(azimuth_deg=0.0, elevation_deg=0.0, code=(), length=1.0):
    """What a judge says who sees these."""
    azimuth = np.radians(azimuth_deg)
    head = [length * np.sin(azimuth), length * np.cos(azimuth), elevation_deg / 40]
    return np.array([[*head, *code]], np.float32)


@pytest.mark.parametrize("length", [1.0, 0.01, 3.0])
@pytest.mark.parametrize(
    ("judged", "true", "error"),
    [
        (10, 10, 0),
        (170, -170, 20),
        (-179, 179, 2),
        (179, -179, 2),
        (0, 180, 180),
        (0, -180, 180),
        (-90, 90, 180),
        (30, 390, 0),
        (45, -45, 90),
    ],
)
def test_azimuth_errors_are_wrapped(judged, true, error, length):
    found = control.azimuth_error_deg(answers(judged, length=length), np.array([float(true)]))
    # sine and cosine in float32: 6e-8 rad, 3.4e-6 degrees
    assert found[0] == pytest.approx(error, abs=1e-5)
    assert 0 <= found[0] <= 180


def test_elevation_errors():
    found = control.elevation_error_deg(answers(elevation_deg=30.0), np.array([-10.0]))
    assert found[0] == pytest.approx(40.0, abs=1e-5)


# --- retrieval ------------------------------------------------------------------------------------

TRUTH = {  # codes by object and view
    ("a", 0): (0.0, 0.0),
    ("a", 1): (2.0, 0.0),
    ("a", 2): (4.0, 0.0),
    ("b", 0): (10.0, 0.0),
    ("b", 1): (10.0, 6.0),
    ("b", 2): (10.0, 0.0),
}


def truth_of(codes):
    rows = [(GROUND_TRUTH, "", "chair", *image) for image in codes]
    values = np.concatenate([answers(code=code) for code in codes.values()])
    index = pd.DataFrame(rows, columns=["method", "condition", "class", "object", "view"])
    return FeaturesAtHand(index, values)


def test_the_gallery_leaves_out_the_view():
    among = true_gallery(truth_of(TRUTH), "chair")
    assert among.objects == ("a", "b")
    np.testing.assert_array_equal(among.without(0), [[3, 0], [10, 3]])
    np.testing.assert_array_equal(among.without(1), [[2, 0], [10, 0]])
    np.testing.assert_array_equal(among.without(7), [[2, 0], [10, 2]])  # there is no such view
    assert control.why_no_retrieval(among) == ""


def test_who_is_found():
    among = true_gallery(truth_of(TRUTH), "chair")
    # view 0 is between (3, 0) and (10, 3): the middle of their x is 6.5; view 1: 6
    judged = {("a", 0): (6.3, 1.5), ("a", 1): (6.1, 0.0), ("b", 0): (6.7, 1.5), ("b", 2): (0, 0)}
    values = np.concatenate([answers(code=code) for code in judged.values()])
    assert control.found(among, values, list(judged)).tolist() == [1, 0, 1, 0]
    backwards = control.found(among, values[::-1], list(judged)[::-1])
    assert backwards.tolist() == [0, 1, 0, 1]


def test_a_image_is_not_found_by_itself():
    """The true picture of `a` from view 0 looks like `b` in all its views: it is taken for b."""
    codes = {("a", 0): (10.0,), ("a", 1): (0.0,), ("b", 0): (10.4,), ("b", 1): (10.4,)}
    among = true_gallery(truth_of(codes), "chair")
    values = np.concatenate([answers(code=code) for code in codes.values()])
    assert control.found(among, values, list(codes)).tolist() == [0, 1, 1, 1]


def test_one_answer_for_all_finds_one_object_in_as_many():
    rng = np.random.default_rng(0)
    codes = {(obj, view): rng.random(3) for obj in "abcde" for view in range(4)}
    among = true_gallery(truth_of(codes), "chair")
    same = np.repeat(answers(code=(0.5, 0.5, 0.5)), len(codes), axis=0)
    assert control.found(among, same, list(codes)).mean() == pytest.approx(1 / 5)


def test_agrees_with_the_plainest_implementation():
    rng = np.random.default_rng(1)
    images = [(obj, view) for obj in "abcdef" for view in range(5)]
    codes = {p: rng.normal(ord(p[0]) / 2, 1, 4).astype(np.float32) for p in images}
    drawn = {p: codes[p] + rng.normal(0, 1, 4).astype(np.float32) for p in images}
    expected = []
    for obj, view in images:
        means = {
            o: np.mean([codes[q].astype(float) for q in images if q[0] == o and q[1] != view], 0)
            for o in "abcdef"
        }
        near = min(means, key=lambda o: np.linalg.norm(drawn[obj, view].astype(float) - means[o]))
        expected.append(float(near == obj))
    values = np.concatenate([answers(code=code) for code in drawn.values()])
    found = control.found(true_gallery(truth_of(codes), "chair"), values, images)
    assert found.tolist() == expected
    assert 0.1 < np.mean(expected) < 0.9


def test_where_nothing_can_be_found():
    one_object = {p: c for p, c in TRUTH.items() if p[0] == "a"}
    one_view = {p: c for p, c in TRUTH.items() if p[1] == 0}
    reasons = [
        control.why_no_retrieval(true_gallery(truth_of(codes), "chair"))
        for codes in (one_object, one_view)
    ]
    assert reasons == [
        "1 object: there is nothing to tell it from; run at least 2",
        "1 view an object: none is left to know it by; run at least 2",
    ]
    assert control.why_no_retrieval(true_gallery(truth_of(TRUTH), "sofa")).startswith("0 obj")
