"""Thin parts by scipy and by hand; `test_extreme_inputs` has scores of a leg, too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from bench.metrics.silhouette import MOST_ASKED, contrast
from bench.metrics.thin_parts import evaluated, thin, thin_scores
from data_prep.rendering.images import blank
from data_prep.scene import NEUTRAL_GREY

BROWN = (120, 80, 40)  # contrast 175
DISC = np.array([[0, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [0, 1, 1, 0]], bool)


def painted(*masks, color=BROWN):
    image = blank(1)[0]
    for mask in masks:
        image[mask] = color
    return image


def box(top, bottom, left, right):
    mask = np.zeros((128, 128), bool)
    mask[top:bottom, left:right] = True
    return mask


def score(truth, drawn):
    """(recall, precision) of one image."""
    recall, precision = thin_scores(truth[None], drawn[None])
    return recall[0], precision[0]


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize(("width", "is_thin"), [(1, True), (3, True), (4, False)])
def test_bars_along_the_axes(width, is_thin, upright):
    bar = box(40, 40 + width, 20, 90)
    bar = bar.T if upright else bar
    actual = thin(bar[None])[0]
    assert np.array_equal(actual, bar) if is_thin else not actual.any()


def test_agrees_with_scipy():
    """The opening and the groups, on random blobs that touch the frame."""
    rng = np.random.default_rng(0)
    masks = ndimage.gaussian_filter(rng.standard_normal((6, 64, 64)), (0, 2, 2)) > 0.02
    for mask, actual in zip(masks, thin(masks), strict=True):
        padded = np.pad(mask, 5)
        lost = (padded & ~ndimage.binary_opening(padded, DISC))[5:-5, 5:-5]
        groups, count = ndimage.label(lost, np.ones((3, 3)))
        expected = np.zeros_like(mask)
        for group in range(1, count + 1):
            if (groups == group).sum() >= 8:
                expected |= groups == group
        assert 0 < expected.sum() < mask.sum()
        assert np.array_equal(actual, expected)


def test_a_leg_and_its_joint_are_evaluated():
    seat, leg = box(30, 50, 30, 90), box(50, 90, 40, 43)
    actual = evaluated(painted(seat, leg)[None])[0]
    assert actual[leg].all()
    # The disc reaches one row into the leg, which is thin from there on; E goes back by two.
    assert not thin((seat | leg)[None])[0][:51].any()
    assert actual[49, 40:43].all()
    assert not actual[48, 30:90].any()
    assert not (actual & ~(seat | leg)).any()
    distance = ndimage.distance_transform_edt(~thin((seat | leg)[None])[0])
    assert np.array_equal(actual, (distance <= 2) & (seat | leg))


LEG = box(40, 80, 60, 63)  # 40 x 3 px, all of it thin, hence evaluated


def test_what_is_far_from_thin_parts_does_not_count():
    drawn = painted(LEG, box(40, 80, 67, 90))  # 5 px off and more: centres from 62 to 67
    assert score(painted(LEG), drawn) == (1.0, 1.0)
    drawn = painted(LEG, box(40, 80, 66, 90))  # its first column is 4 px off
    assert score(painted(LEG), drawn) == (1.0, 0.75)


@pytest.mark.parametrize(
    ("color", "level"),
    [
        (BROWN, 217),  # contrast 175, more than is asked for: half of 75 is 37.5, grey 217.5
        ((235, 235, 235), 245),  # a light chair of contrast 20 needs 10
        ((255, 255, 0), 217),  # contrast 85 by the mean; luma says 29, the least channel 255
    ],
)
def test_haze_draws_nothing(color, level):
    truth = painted(LEG, color=color)
    everywhere = np.ones((128, 128), bool)
    for grey, recall in ((level, 1.0), (level + 1, 0.0)):
        assert score(truth, painted(LEG, color=(grey,) * 3))[0] == recall
        # All of the frame in that level: recalled as before, no more precise than any painting.
        actual, precision = score(truth, painted(everywhere, color=(grey,) * 3))
        assert actual == recall
        assert precision == pytest.approx(120 / 496) if recall else np.isnan(precision)


def test_a_grey_method_is_not_asked_for_more_than_its_grey():
    assert contrast(np.array([[[NEUTRAL_GREY]]], np.uint8)).item() == MOST_ASKED
    for color in (NEUTRAL_GREY, (217, 217, 217)):  # and a pixel that it covers by half
        assert score(painted(LEG, color=(0, 0, 0)), painted(LEG, color=color)) == (1.0, 1.0)


def test_haze_beside_a_light_leg_is_measured_by_the_leg():
    truth = painted(box(10, 34, 20, 100))  # thick and dark, out of reach
    truth[LEG] = 235
    everywhere = painted(np.ones((128, 128), bool), color=(243,) * 3)
    assert score(truth, everywhere) == (1.0, pytest.approx(120 / 496))
