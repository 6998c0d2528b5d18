"""Silhouettes and the SSIM of what they cover, by their definitions; boxes and haze are in
`test_extreme_inputs`, too."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrics.image_scores import scores
from bench.metrics.silhouette import (
    Pairs,
    object_boxes,
    silhouette_iou,
)
from data_prep.rendering.images import blank


def painted(*boxes, color=(120, 80, 40)):
    """One image with boxes (top, bottom, left, right) on white."""
    image = blank(1)
    for top, bottom, left, right in boxes:
        image[:, top:bottom, left:right] = color
    return image


def by_definition(truth, drawing):
    """Pixel by pixel, in exact whole numbers: three times the contrast, twice the threshold."""
    both = either = 0
    three_contrasts = [
        [765 - int(p.sum()) for p in image.reshape(-1, 3)] for image in (truth, drawing)
    ]
    asked = sorted(c for c in three_contrasts[0] if c > 0)
    n = len(asked)
    median = (asked[(n - 1) // 2] + asked[n // 2]) / 2 if n else 225
    for true, actual in zip(*three_contrasts, strict=True):
        covers = 2 * actual >= min(true if true > 0 else median, 225)
        both += true > 0 and covers
        either += true > 0 or covers
    return both / either if either else 1.0


@pytest.mark.parametrize("level", [0, 150, 230, 250])
def test_agrees_with_its_definition(level):
    """Noise over light and dark objects, with levels at both sides of every threshold."""
    rng = np.random.default_rng(level)
    truth = np.full((6, 24, 20, 3), 255, np.uint8)
    truth[:, 5:15, 4:15] = rng.integers(level, 256, (6, 10, 11, 3))
    drawing = rng.integers(level, 256, truth.shape, dtype=np.uint8)
    drawing[rng.random(truth.shape[:3]) < 0.4] = 255
    expected = [by_definition(t, d) for t, d in zip(truth, drawing, strict=True)]
    assert 0 < min(expected) < max(expected) < 1
    truth.flags.writeable = drawing.flags.writeable = False
    actual = silhouette_iou(truth, drawing)
    np.testing.assert_allclose(actual, expected, rtol=1e-15)
    assert scores(truth, drawing)["silhouette_iou"].tolist() == actual.tolist()


def test_an_empty_part_asks_for_half_of_the_neutral_grey():
    nowhere = np.zeros((2, 128, 128), bool)
    levels = np.concatenate([blank(1) - 37, blank(1) - 38])
    actual = Pairs(blank(2), levels).drawn(nowhere)
    assert actual.all(axis=(1, 2)).tolist() == [False, True]
    assert not actual[0].any()


def test_boxes():
    far = painted((10, 12, 100, 101), (50, 60, 5, 20), color=(254, 255, 255))
    boxes = object_boxes(np.concatenate([far, blank(1), painted((0, 128, 0, 128))]))
    assert boxes.tolist() == [[10, 60, 5, 101], [0, 0, 0, 0], [0, 128, 0, 128]]
    assert object_boxes(blank(0)).shape == (0, 4)
