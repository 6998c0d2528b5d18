from __future__ import annotations

import json
import math

import numpy as np
import pytest
from safetensors.numpy import save_file

from bench.analysis.recognition import ClassHead, read_class_head
from data_prep.failures import BadInput

HEAD = ClassHead(("car", "lamp", "sofa"), np.eye(3)[:, :2], np.array([0.0, 0.0, math.log(2)]))


def test_worked_by_hand():
    features = np.array([[0.0, 0.0], [math.log(4), 0.0]], np.float32)
    # odds 1 : 1 : 2, and 4 : 1 : 2; log 4 in float32 is known to 1e-7
    np.testing.assert_allclose(HEAD.confidence(features, "car"), [1 / 4, 4 / 7], rtol=1e-6)
    np.testing.assert_allclose(HEAD.confidence(features, "lamp"), [1 / 4, 1 / 7], rtol=1e-6)
    np.testing.assert_allclose(HEAD.confidence(features, "sofa"), [2 / 4, 2 / 7], rtol=1e-6)


def test_large_features_do_not_overflow():
    features = np.array([[1e6, 0.0], [0.0, 1e6]])
    assert HEAD.confidence(features, "car").tolist() == [1.0, 0.0]


def test_no_images_and_unknown_classes():
    assert HEAD.confidence(np.empty((0, 2)), "car").shape == (0,)
    with pytest.raises(KeyError, match="rifle"):
        HEAD.confidence(np.empty((0, 2)), "rifle")


def test_a_file_is_read_without_torch(tmp_path):
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
