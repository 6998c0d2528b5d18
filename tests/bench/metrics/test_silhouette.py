"""Silhouettes, thin parts and the SSIM of what a silhouette covers, by their definitions; boxes,
haze and legs are in `test_extreme_inputs`, too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from skimage.metrics import structural_similarity

from bench.metrics.image_scores import scores
from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.silhouette import MOST_ASKED, Pairs, contrast, object_boxes
from bench.metrics.structural_similarity import ssim_per_image
from bench.metrics.thin_parts import evaluated, thin, thin_scores
from data_prep.rendering.images import blank
from data_prep.scene import NEUTRAL_GREY

BROWN = (120, 80, 40)  # contrast 175
DISC = np.array([[0, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [0, 1, 1, 0]], bool)
TOLERANCE = 1e-10  # a window of the SSIM map errs by 1e-12, here and in scikit-image


def box(top, bottom, left, right):
    mask = np.zeros((128, 128), bool)
    mask[top:bottom, left:right] = True
    return mask


def painted(*masks, color=BROWN):
    image = blank(1)[0]
    for mask in masks:
        image[mask] = color
    return image


EVERYWHERE = box(0, 128, 0, 128)
LEG = box(40, 80, 60, 63)  # 40 x 3 px, all of it thin, hence evaluated


def silhouettes(truth, drawing):
    """The pixels shown and drawn, in whole numbers: three times the contrast, twice the threshold;
    half of the median of what is shown where the truth is white."""
    true, actual = (765 - image.astype(int).sum(axis=-1) for image in (truth, drawing))
    shown = true > 0
    median = np.median(true[shown]) if shown.any() else 225
    return shown, 2 * actual >= np.minimum(np.where(shown, true, median), 225)


@pytest.mark.parametrize("level", [0, 150, 230, 250])
def test_the_overlap_agrees_with_its_definition(level):
    """Noise over light and dark objects, with levels at both sides of every threshold."""
    rng = np.random.default_rng(level)
    truth = np.full((6, 24, 20, 3), 255, np.uint8)
    truth[:, 5:15, 4:15] = rng.integers(level, 256, (6, 10, 11, 3))
    drawing = rng.integers(level, 256, truth.shape, dtype=np.uint8)
    drawing[rng.random(truth.shape[:3]) < 0.4] = 255
    masks = [silhouettes(*pair) for pair in zip(truth, drawing, strict=True)]
    expected = [(shown & drawn).sum() / (shown | drawn).sum() for shown, drawn in masks]
    assert 0 < min(expected) < max(expected) < 1
    truth.flags.writeable = drawing.flags.writeable = False
    actual = scores(truth, drawing)["silhouette_iou"]
    np.testing.assert_allclose(actual, expected, rtol=1e-15)


def test_an_empty_part_asks_for_half_of_the_neutral_grey():
    nowhere = np.zeros((2, 128, 128), bool)
    levels = np.concatenate([blank(1) - 37, blank(1) - 38])
    actual = Pairs(blank(2), levels).drawn(nowhere)
    assert actual.all(axis=(1, 2)).tolist() == [False, True]
    assert not actual[0].any()


def test_boxes():
    far = painted(box(10, 12, 100, 101), box(50, 60, 5, 20), color=(254, 255, 255))
    boxes = object_boxes(np.stack([far, blank(1)[0], painted(EVERYWHERE)]))
    assert boxes.tolist() == [[10, 60, 5, 101], [0, 0, 0, 0], [0, 128, 0, 128]]
    assert object_boxes(blank(0)).shape == (0, 4)


# --- scores of a run ------------------------------------------------------------------------------


def ssim_object_by_definition(truth, drawing):
    """One pair uint8 [H, W, 3]: scikit-image's map over the dilated union of silhouettes."""
    shown, drawn = silhouettes(truth, drawing)
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    options |= {"data_range": 255, "channel_axis": -1, "full": True}
    _, full = structural_similarity(truth, drawing, **options)
    near = ndimage.binary_dilation(shown | drawn, np.ones((11, 11)))
    return full.mean(axis=-1)[5:-5, 5:-5][near[5:-5, 5:-5]].mean()


def chair(shift=0, color=BROWN):
    """A seat with two legs and a back, far from the frame; [128, 128, 3]."""
    parts = ((30, 58, 44, 50), (54, 60, 44, 80), (60, 88, 46, 49), (60, 88, 75, 78))
    return painted(*(box(*(place + shift for place in part)) for part in parts), color=color)


def hazy(image, level):
    return np.minimum(image, np.uint8(level))


def pairs():
    """Objects that miss each other, haze that counts and haze that does not, objects at the frame,
    noise, light and dark colours."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (2, 128, 128, 3), np.uint8)
    cut = chair()[34:, 46:].repeat(2, axis=0)[:128].repeat(2, axis=1)[:, :128]
    result = [
        (chair(), chair(3)),
        (chair(), chair(30)),
        (chair(), chair(color=(185, 180, 175))),
        (chair(), hazy(chair(2), 218)),
        (chair(), hazy(chair(2), 217)),
        (chair(color=(240, 244, 250)), hazy(chair(1), 251)),
        (chair(), blank(1)[0]),
        (blank(1)[0], chair()),
        (cut, chair()),
        (noise[0], noise[1]),
        (chair(), np.where(rng.random((128, 128, 1)) < 0.01, 0, chair(1)).astype(np.uint8)),
        # what is drawn beside the object, where the true image is white, counts
        (chair(), np.minimum(chair(), np.roll(chair(), 40, axis=1))),
    ]
    return [np.stack(side) for side in zip(*result, strict=True)]


def test_scores_are_by_their_definitions_and_those_of_each_metric_by_itself():
    """Bit for bit, and an image's do not depend on its neighbours."""
    truth, drawing = pairs()
    actual = scores(truth, drawing)
    expected = [ssim_object_by_definition(t, d) for t, d in zip(truth, drawing, strict=True)]
    assert min(expected) < 0.01
    assert max(expected) > 0.7
    np.testing.assert_allclose(actual["ssim_object"], expected, rtol=0, atol=TOLERANCE)
    alone = ssim_per_image(truth, drawing)._asdict()
    alone |= {"psnr": psnr(truth, drawing)}
    alone |= {f"thin_{k}": v for k, v in thin_scores(Pairs(truth, drawing))._asdict().items()}
    assert actual.keys() == {*alone, "silhouette_iou", "ssim_object"}
    for name, values in alone.items():
        np.testing.assert_array_equal(actual[name], values)
    for i in range(len(truth)):
        first = scores(truth[i : i + 1], drawing[i : i + 1])
        for name, values in first.items():
            np.testing.assert_array_equal(actual[name][i : i + 1], values)


@pytest.mark.parametrize("drawing", [chair(3), blank(1)[0]], ids=["moved", "white"])
def test_white_around_the_object_does_not_count(drawing):
    """The ssim of the same object rises in larger frames, ssim-object stays."""
    wide = [
        np.pad(x[None], ((0, 0), (40, 60), (50, 50), (0, 0)), constant_values=255)
        for x in (chair(), drawing)
    ]
    near, far = scores(chair()[None], drawing[None]), scores(*wide)
    assert far["ssim"] > near["ssim"] + 0.05
    assert far["ssim_object"] == pytest.approx(near["ssim_object"], abs=TOLERANCE)


# --- thin parts -----------------------------------------------------------------------------------


def score(truth, drawn):
    """(recall, precision) of one image."""
    recall, precision = thin_scores(Pairs(truth[None], drawn[None]))
    return recall[0], precision[0]


def test_what_is_thin_agrees_with_scipy():
    """The opening and the groups, on random blobs that touch the frame."""
    rng = np.random.default_rng(0)
    masks = ndimage.gaussian_filter(rng.standard_normal((6, 64, 64)), (0, 2, 2)) > 0.02
    for mask, actual in zip(masks, thin(masks), strict=True):
        padded = np.pad(mask, 5)
        lost = (padded & ~ndimage.binary_opening(padded, DISC))[5:-5, 5:-5]
        groups, count = ndimage.label(lost, np.ones((3, 3)))
        large = [group for group in range(1, count + 1) if (groups == group).sum() >= 8]
        expected = np.isin(groups, large)
        assert 0 < expected.sum() < mask.sum()
        assert np.array_equal(actual, expected)


def test_a_leg_and_its_joint_are_evaluated():
    """The disc reaches one row into the leg, which is thin from there on; E goes back by two."""
    seat, leg = box(30, 50, 30, 90), box(50, 90, 40, 43)
    actual = evaluated(painted(seat, leg)[None])[0]
    distance = ndimage.distance_transform_edt(~thin((seat | leg)[None])[0])
    assert np.array_equal(actual, (distance <= 2) & (seat | leg))
    assert actual[leg].all()
    assert actual[49, 40:43].all()
    assert not actual[48, 30:90].any()


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
    for grey, recall in ((level, 1.0), (level + 1, 0.0)):
        assert score(truth, painted(LEG, color=(grey,) * 3))[0] == recall
        # All of the frame in that level: recalled as before, no more precise than any painting.
        actual, precision = score(truth, painted(EVERYWHERE, color=(grey,) * 3))
        assert actual == recall
        assert precision == pytest.approx(120 / 496) if recall else np.isnan(precision)


def test_thin_parts_of_a_grey_method_and_beside_what_is_dark():
    assert contrast(np.array([[[NEUTRAL_GREY]]], np.uint8)).item() == MOST_ASKED
    for color in (NEUTRAL_GREY, (217, 217, 217)):  # and a pixel that it covers by half
        assert score(painted(LEG, color=(0, 0, 0)), painted(LEG, color=color)) == (1.0, 1.0)
    truth = painted(box(10, 34, 20, 100))  # thick and dark, out of reach
    truth[LEG] = 235  # haze is measured by the light leg
    hazed = painted(EVERYWHERE, color=(243,) * 3)
    assert score(truth, hazed) == (1.0, pytest.approx(120 / 496))
