from __future__ import annotations

import numpy as np
import pytest

from bench.metrics.image_scores import scores
from bench.metrics.silhouette import contrast, drawn, foreground, silhouette_iou
from bench.suites.stability.image_cases import SILHOUETTE, SILHOUETTE_CASES
from bench.suites.stability.metric_cases import Refused
from data_prep.images import blank

BROWN = (120, 80, 40)  # contrast 175: half of 75 is asked for, 37.5


def painted(*boxes, color=BROWN):
    """One picture with boxes (top, bottom, left, right) on white."""
    image = blank(1)
    for top, bottom, left, right in boxes:
        image[:, top:bottom, left:right] = color
    return image


def iou(truth, drawing):
    (value,) = silhouette_iou(truth, drawing)
    return value


# --- closed form ----------------------------------------------------------------------------------

SQUARE = (40, 60, 30, 50)


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        (SQUARE, 1.0),
        ((40, 60, 35, 50), 15 / 20),  # within it
        ((40, 60, 30, 60), 20 / 30),  # around it
        ((50, 70, 40, 60), 100 / 700),  # 10 x 10 px of 400 + 400 - 100
        ((60, 80, 30, 50), 0.0),  # below it, touching
        ((0, 128, 0, 128), 400 / 128**2),
    ],
)
def test_two_boxes(box, expected):
    assert iou(painted(SQUARE), painted(box)) == pytest.approx(expected, rel=1e-15)


def test_what_is_inside_does_not_count():
    truth = painted(SQUARE)
    drawing = truth.copy()
    rng = np.random.default_rng(0)
    drawing[:, 40:60, 30:50] = rng.integers(0, 200, (20, 20, 3))
    assert iou(truth, drawing) == 1.0
    drawing[:, 45:50, 35:40] = 255  # but a hole does
    assert iou(truth, drawing) == 375 / 400


def test_blank_images():
    assert iou(blank(1), blank(1)) == 1.0
    assert iou(painted(SQUARE), blank(1)) == 0.0
    assert iou(blank(1), painted(SQUARE)) == 0.0


# --- what counts as drawn -------------------------------------------------------------------------


def by_definition(truth, drawing):
    """Pixel by pixel, in exact whole numbers: three times the contrast, twice the threshold."""
    both = either = 0
    three_contrasts = [
        [765 - int(p.sum()) for p in image.reshape(-1, 3)] for image in (truth, drawing)
    ]
    asked = sorted(c for c in three_contrasts[0] if c > 0)
    n = len(asked)
    median = (asked[(n - 1) // 2] + asked[n // 2]) / 2 if n else 225
    for true, found in zip(*three_contrasts, strict=True):
        covers = 2 * found >= min(true if true > 0 else median, 225)
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
    np.testing.assert_allclose(silhouette_iou(truth, drawing), expected, rtol=1e-15)


def test_haze_of_a_network_is_no_object():
    truth = painted(SQUARE)
    haze = blank(1)
    haze[...] = np.random.default_rng(1).integers(218, 256, haze.shape)
    assert foreground(haze).mean() > 0.99
    # contrast 37 at most, where 37.5 is asked for
    np.testing.assert_array_equal(silhouette_iou(truth, np.minimum(truth, haze)), [1.0])
    assert iou(truth, haze) == 0.0
    # a light object asks for less: contrast 18 of 20 x 20 px is half of it or more
    light = painted(SQUARE, color=(235, 235, 235))
    assert iou(light, painted(SQUARE, color=(237, 237, 237))) == 1.0
    assert iou(light, painted(SQUARE, color=(245, 245, 245))) == 1.0
    assert iou(light, painted(SQUARE, color=(246, 246, 246))) == 0.0


def test_beside_the_object_its_median_contrast_is_asked_for():
    # 300 px of contrast 20 and 100 px of 75 or more: the median is 20, and 10 is drawn
    truth = painted((40, 60, 30, 45), color=(235, 235, 235))
    truth[:, 40:60, 45:50] = BROWN
    beside = truth.copy()
    beside[:, 80:90, 30:50] = 245
    assert iou(truth, beside) == 400 / 600
    beside[:, 80:90, 30:50] = 246
    assert iou(truth, beside) == 1.0
    # within it, of each pixel as much as half of its own
    beside[:, 40:60, 45:50] = 245
    assert iou(truth, beside) == 300 / 400


def test_an_empty_part_asks_for_half_of_the_neutral_grey():
    nowhere = np.zeros((2, 128, 128), bool)
    levels = np.concatenate([blank(1) - 37, blank(1) - 38])
    assert contrast(levels)[:, 0, 0].tolist() == [37.0, 38.0]
    found = drawn(blank(2), levels, nowhere)
    assert found.all(axis=(1, 2)).tolist() == [False, True]
    assert not found[0].any()


# --- invariants -----------------------------------------------------------------------------------


def scribbles(seed, count=5):
    rng = np.random.default_rng(seed)
    boxes = [
        [(t, t + h, x, x + w) for t, x, h, w in rng.integers(5, 60, (4, 4))] for _ in range(count)
    ]
    return np.concatenate([painted(*some, color=tuple(rng.integers(0, 240, 3))) for some in boxes])


@pytest.mark.parametrize(
    "turn", [lambda a: a[:, ::-1], lambda a: a[:, :, ::-1], lambda a: a.swapaxes(1, 2)]
)
def test_does_not_depend_on_the_orientation(turn):
    truth, drawing = scribbles(1), scribbles(2)
    expected = silhouette_iou(truth, drawing)
    assert np.all((expected > 0) & (expected < 1))
    np.testing.assert_array_equal(silhouette_iou(turn(truth), turn(drawing)), expected)


def test_images_do_not_depend_on_each_other():
    truth, drawing = scribbles(1), scribbles(2)
    together = silhouette_iou(truth, drawing)
    assert together.dtype == np.float64
    alone = [iou(truth[i : i + 1], drawing[i : i + 1]) for i in range(len(truth))]
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(scores(truth, drawing)["silhouette_iou"], together)


def test_identical_images_score_exactly_one():
    rng = np.random.default_rng(0)
    for images in (scribbles(3), rng.integers(0, 256, (3, 30, 40, 3), np.uint8), blank(2)):
        np.testing.assert_array_equal(silhouette_iou(images, images.copy()), 1.0)


def test_dark_silhouettes_may_be_exchanged():
    truth, drawing = scribbles(1), scribbles(2)
    truth[truth < 255] = 0
    drawing[drawing < 255] = 100
    np.testing.assert_array_equal(silhouette_iou(truth, drawing), silhouette_iou(drawing, truth))


def test_leaves_its_input_alone():
    truth, drawing = scribbles(1), scribbles(2)
    before = truth.copy(), drawing.copy()
    for images in (truth, drawing):
        images.flags.writeable = False
    silhouette_iou(truth, drawing)
    np.testing.assert_array_equal(truth, before[0])
    np.testing.assert_array_equal(drawing, before[1])


# --- the cases of the suite `stability` -----------------------------------------------------------


@pytest.mark.parametrize("case", SILHOUETTE_CASES, ids=lambda case: case.id)
def test_extremes_are_as_stated(case):
    stated = case.stated[SILHOUETTE]
    if isinstance(stated, Refused):
        with pytest.raises(stated.error) as error:
            silhouette_iou(*case.given())
        assert stated.says in str(error.value)
        return
    given = case.given()
    value = stated.value(*given) if callable(stated.value) else stated.value
    found = silhouette_iou(*given)
    assert isinstance(stated.within, float)
    np.testing.assert_allclose(found, np.full(found.shape, value), rtol=0, atol=stated.within)
