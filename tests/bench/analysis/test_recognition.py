"""Who is recognised: retrieval by the judge's codes, and the class. Errors of angles are in
`tests.bench.metrics.test_extreme_inputs`."""

from __future__ import annotations

import json
import math

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import save_file

from bench.analysis.sets import ClassHead, read_class_head, true_gallery
from bench.judges.answers import found, why_no_retrieval
from bench.records.job import GROUND_TRUTH
from data_prep.failures import BadInput

from ..builders import FeaturesAtHand

TRUTH = {  # codes by object and view
    ("a", 0): (0.0, 0.0),
    ("a", 1): (2.0, 0.0),
    ("a", 2): (4.0, 0.0),
    ("b", 0): (10.0, 0.0),
    ("b", 1): (10.0, 6.0),
    ("b", 2): (10.0, 0.0),
}


def answers(codes):
    """What a judge says who sees these, all from the front."""
    return np.array([[0.0, 1.0, 0.0, *code] for code in codes], np.float32)


def gallery_of(codes, class_name="chair"):
    rows = [(GROUND_TRUTH, "", "chair", *image) for image in codes]
    index = pd.DataFrame(rows, columns=["method", "condition", "class", "object", "view"])
    return true_gallery(FeaturesAtHand(index, answers(codes.values())), class_name)


def test_the_gallery_leaves_out_the_view():
    among = gallery_of(TRUTH)
    assert among.objects == ("a", "b")
    np.testing.assert_array_equal(among.without(0), [[3, 0], [10, 3]])
    np.testing.assert_array_equal(among.without(1), [[2, 0], [10, 0]])
    np.testing.assert_array_equal(among.without(7), [[2, 0], [10, 2]])  # there is no such view
    assert why_no_retrieval(among) == ""


def test_of_objects_equally_near_the_first_by_name_is_meant():
    alike = dict.fromkeys(TRUTH, (1.0,))
    expected = [float(obj == "a") for obj, _ in alike]
    assert found(gallery_of(alike), answers(alike.values()), list(alike)).tolist() == expected


@pytest.mark.parametrize("at_once", [1, 2**16])
def test_agrees_with_the_plainest_implementation(at_once, monkeypatch):
    monkeypatch.setattr("bench.judges.answers.AT_ONCE", at_once)
    rng = np.random.default_rng(1)
    images = [(obj, view) for obj in "abcdef" for view in range(5)]
    codes = {p: rng.normal(ord(p[0]) / 2, 1, 4).astype(np.float32) for p in images}
    drawn = {p: codes[p] + rng.normal(0, 1, 4).astype(np.float32) for p in images}
    asked = [images[i] for i in rng.permutation(len(images))]
    expected = []
    for obj, view in asked:
        means = {
            o: np.mean([codes[q].astype(float) for q in images if q[0] == o and q[1] != view], 0)
            for o in "abcdef"
        }
        near = min(means, key=lambda o: np.linalg.norm(drawn[obj, view].astype(float) - means[o]))
        expected.append(float(near == obj))
    assert found(gallery_of(codes), answers(drawn[p] for p in asked), asked).tolist() == expected
    assert 0.1 < np.mean(expected) < 0.9


def test_where_nothing_can_be_found():
    one_object = {p: c for p, c in TRUTH.items() if p[0] == "a"}
    one_view = {p: c for p, c in TRUTH.items() if p[1] == 0}
    assert [why_no_retrieval(gallery_of(codes)) for codes in (one_object, one_view)] == [
        "1 object: there is nothing to tell it from; run at least 2",
        "1 view an object: none is left to know it by; run at least 2",
    ]
    assert why_no_retrieval(gallery_of(TRUTH, "sofa")).startswith("0 obj")


HEAD = ClassHead(("car", "lamp", "sofa"), np.eye(3)[:, :2], np.array([0.0, 0.0, math.log(2)]))


def test_confidence_worked_by_hand():
    features = np.array([[0.0, 0.0], [math.log(4), 0.0], [1e6, 0.0], [0.0, 1e6]])
    # odds 1 : 1 : 2, and 4 : 1 : 2; log 4 in float32 is known to 1e-7; large ones do not overflow
    for name, expected in (
        ("car", [1 / 4, 4 / 7, 1, 0]),
        ("lamp", [1 / 4, 1 / 7, 0, 1]),
        ("sofa", [2 / 4, 2 / 7, 0, 0]),
    ):
        confidence = HEAD.confidence(features.astype(np.float32), name)
        np.testing.assert_allclose(confidence, expected, rtol=1e-6)
    assert HEAD.confidence(np.empty((0, 2)), "car").shape == (0,)
    with pytest.raises(KeyError, match="rifle"):
        HEAD.confidence(np.empty((0, 2)), "rifle")


def test_a_head_is_read_from_its_file(tmp_path):
    path = tmp_path / "views.safetensors"
    labels = {"classes": ["car", "lamp"], "families": [], "backs": []}
    weight = np.array([[1.5, -2.0], [0.25, 4.0]], np.float32)
    tensors = {"heads.class.weight": weight, "heads.class.bias": np.ones(2, np.float32)}
    save_file(tensors, path, {"labels": json.dumps(labels)})
    head = read_class_head(path)
    assert head.classes == ("car", "lamp")
    assert np.array_equal(head.weight, weight.astype(float))
    assert head.bias.tolist() == [1.0, 1.0]
    assert head.weight.dtype == head.bias.dtype == np.float64
    save_file(tensors, path)
    for refused in (path, tmp_path / "missing"):
        with pytest.raises(BadInput) as error:
            read_class_head(refused)
        assert str(error.value).startswith(f"{refused}: not the weights of fd-views (")
