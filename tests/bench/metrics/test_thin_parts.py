from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from bench.metrics.silhouette import MOST_ASKED, contrast, foreground, object_boxes
from bench.metrics.thin_parts import evaluated, thin, thin_scores
from data_prep.images import blank
from data_prep.mesh_files import NEUTRAL_GREY

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


def line(width, angle_deg, length=60):
    """A bar through the middle of the frame, of the pixels whose centres it covers."""
    y, x = np.mgrid[:128, :128] - 63.6
    sine, cosine = np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))
    across, along = x * sine - y * cosine, x * cosine + y * sine
    return (np.abs(across) < width / 2) & (np.abs(along) < length / 2), np.abs(along) < 20


def score(truth, drawn):
    """(recall, precision) of one picture."""
    recall, precision = thin_scores(truth[None], drawn[None])
    return recall[0], precision[0]


# --- what is thin ---------------------------------------------------------------------------------


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize(
    ("width", "is_thin"), [(1, True), (2, True), (3, True), (4, False), (5, False)]
)
def test_bars_along_the_axes(width, is_thin, upright):
    bar = box(40, 40 + width, 20, 90)
    bar = bar.T if upright else bar
    found = thin(bar[None])[0]
    assert np.array_equal(found, bar) if is_thin else not found.any()


@pytest.mark.parametrize(("width", "share"), [(2, 1), (2.5, 1), (4.25, 0), (5, 0)])
def test_bars_in_all_directions(width, share):
    for angle in range(0, 180, 15):
        bar, middle = line(width, angle)
        assert thin(bar[None])[0][bar & middle].mean() == share, angle


@pytest.mark.parametrize(("diagonals", "is_thin"), [(3, True), (4, True), (6, False), (7, False)])
def test_diagonal_bars(diagonals, is_thin):
    """k diagonals of pixels are k / sqrt(2) px thick: 2.1, 2.8, 4.2 and 4.9."""
    y, x = np.mgrid[:128, :128]
    for bar in ((x - y >= 0) & (x - y < diagonals), (x + y >= 127) & (x + y < 127 + diagonals)):
        bar[:20], bar[-20:] = False, False
        middle = np.zeros_like(bar)
        middle[30:-30] = True
        assert thin(bar[None])[0][bar & middle].all() == is_thin
        assert thin(bar[None])[0][bar & middle].any() == is_thin


def test_agrees_with_scipy():
    """The opening and the groups, on random blobs that touch the frame."""
    rng = np.random.default_rng(0)
    masks = ndimage.gaussian_filter(rng.standard_normal((6, 64, 64)), (0, 2, 2)) > 0.02
    for mask, found in zip(masks, thin(masks), strict=True):
        padded = np.pad(mask, 5)
        lost = (padded & ~ndimage.binary_opening(padded, DISC))[5:-5, 5:-5]
        groups, count = ndimage.label(lost, np.ones((3, 3)))
        expected = np.zeros_like(mask)
        for group in range(1, count + 1):
            if (groups == group).sum() >= 8:
                expected |= groups == group
        assert 0 < expected.sum() < mask.sum()
        assert np.array_equal(found, expected)


def test_corners_of_what_is_thick_are_not_thin():
    assert not thin(box(20, 60, 30, 90)[None]).any()
    y, x = np.mgrid[:128, :128]
    assert not thin(((x - 64) ** 2 + (y - 64) ** 2 < 30**2)[None]).any()
    assert not thin((np.abs(x - 64) + np.abs(y - 64) < 30)[None]).any()


def test_a_leg_and_its_joint_are_evaluated():
    seat, leg = box(30, 50, 30, 90), box(50, 90, 40, 43)
    found = evaluated(painted(seat, leg)[None])[0]
    assert found[leg].all()
    # The disc reaches one row into the leg, which is thin from there on; E goes back by two.
    assert not thin((seat | leg)[None])[0][:51].any()
    assert found[49, 40:43].all()
    assert not found[48, 30:90].any()
    assert not (found & ~(seat | leg)).any()
    distance = ndimage.distance_transform_edt(~thin((seat | leg)[None])[0])
    assert np.array_equal(found, (distance <= 2) & (seat | leg))


# --- scores, worked by hand -----------------------------------------------------------------------

LEG = box(40, 80, 60, 63)  # 40 x 3 px, all of it thin, hence evaluated


def test_the_truth_itself_scores_one():
    rng = np.random.default_rng(1)
    for color in (BROWN, (254, 254, 255), (250, 245, 200), (0, 0, 0)):
        assert score(painted(LEG, color=color), painted(LEG, color=color)) == (1.0, 1.0)
    edged = painted(LEG)
    edged[40:80, 60] = 255 - (255 - np.array(BROWN)) // 4  # a pixel covered by a quarter
    edged[40:80, 62] = rng.integers(200, 250, (40, 3))
    assert score(edged, edged) == (1.0, 1.0)


def test_half_a_leg_is_half_recalled():
    assert score(painted(LEG), painted(box(40, 60, 60, 63))) == (0.5, 1.0)


def test_a_leg_of_twice_the_width_is_half_precise():
    recall, precision = score(painted(LEG), painted(box(40, 80, 60, 66)))
    assert (recall, precision) == (1.0, 0.5)


def test_a_leg_beside_the_true_one():
    recall, precision = score(painted(LEG), painted(box(40, 80, 61, 64)))
    assert (recall, precision) == pytest.approx((2 / 3, 2 / 3))


def test_what_is_far_from_thin_parts_does_not_count():
    drawn = painted(LEG, box(40, 80, 67, 90))  # 5 px off and more: centres from 62 to 67
    assert score(painted(LEG), drawn) == (1.0, 1.0)
    drawn = painted(LEG, box(40, 80, 66, 90))  # its first column is 4 px off
    assert score(painted(LEG), drawn) == (1.0, 0.75)


def test_painting_everything_is_not_precise():
    recall, precision = score(painted(LEG), painted(np.ones((128, 128), bool)))
    # The leg, 4 px at its sides and ends, and 8 px with x^2 + y^2 <= 16 at each corner.
    assert 120 + 2 * 4 * 40 + 2 * 4 * 3 + 4 * 8 == 496
    assert (recall, precision) == (1.0, pytest.approx(120 / 496))


def test_nothing_drawn():
    recall, precision = score(painted(LEG), blank(1)[0])
    assert recall == 0.0
    assert np.isnan(precision)


@pytest.mark.parametrize(
    "truth", [blank(1)[0], painted(box(20, 60, 30, 90))], ids=["blank", "thick"]
)
def test_without_thin_parts_there_is_no_score(truth):
    assert np.isnan(score(truth, truth)).all()
    assert np.isnan(score(truth, painted(LEG))).all()


# --- contrast -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("color", "level", "recall"),
    [
        # brown has contrast 175, more than is asked for: half of 75 is 37.5, grey 217.5
        (BROWN, 217, 1.0),
        (BROWN, 218, 0.0),
        # a light chair of contrast 20 needs 10
        ((235, 235, 235), 245, 1.0),
        ((235, 235, 235), 246, 0.0),
        # saturated yellow: contrast 85 by the mean, where luma says 29 and the least channel 255
        ((255, 255, 0), 217, 1.0),
        ((255, 255, 0), 218, 0.0),
    ],
)
def test_haze_draws_nothing(color, level, recall):
    truth = painted(LEG, color=color)
    found, precision = score(truth, painted(LEG, color=(level,) * 3))
    assert found == recall
    # All of the frame in that level: recalled as before, and no more precise than any painting.
    found, precision = score(truth, painted(np.ones((128, 128), bool), color=(level,) * 3))
    assert found == recall
    assert precision == pytest.approx(120 / 496) if recall else np.isnan(precision)


def test_a_grey_method_is_not_asked_for_more_than_its_grey():
    assert contrast(np.array([[[NEUTRAL_GREY]]], np.uint8)).item() == MOST_ASKED
    assert score(painted(LEG, color=(0, 0, 0)), painted(LEG, color=NEUTRAL_GREY)) == (1.0, 1.0)
    # and the pixel that it covers by half
    half = (217, 217, 217)
    assert score(painted(LEG, color=(0, 0, 0)), painted(LEG, color=half)) == (1.0, 1.0)


def test_contrast_is_to_white():
    image = np.array([[[[255, 255, 255], [0, 0, 0], [255, 255, 0], [120, 80, 40]]]], np.uint8)
    assert contrast(image).tolist() == [[[0.0, 255.0, 85.0, 175.0]]]
    assert foreground(image).tolist() == [[[False, True, True, True]]]


# --- invariants -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "turn", [lambda a: a[:, ::-1], lambda a: a[:, :, ::-1], lambda a: a.swapaxes(1, 2)]
)
def test_does_not_depend_on_the_orientation(turn):
    rng = np.random.default_rng(2)
    bars = [box(t, t + h, x, x + w) for t, x, h, w in rng.integers(2, 60, (9, 4))]
    sticks = [box(t, t + 40, x, x + 3) for t, x in rng.integers(5, 80, (5, 2))]
    truth, drawn = painted(*bars[:3], *sticks)[None], painted(*bars[1:5], *sticks[2:])[None]
    expected = thin_scores(truth, drawn)
    assert 0 < expected.recall[0] < 1
    assert 0 < expected.precision[0] < 1
    assert thin_scores(turn(truth), turn(drawn)) == expected


def test_images_do_not_depend_on_each_other():
    truth = np.stack([painted(LEG), blank(1)[0], painted(box(30, 90, 20, 22))])
    drawn = np.stack([painted(box(40, 60, 60, 63)), painted(LEG), painted(box(30, 90, 21, 22))])
    together = thin_scores(truth, drawn)
    alone = [thin_scores(truth[i : i + 1], drawn[i : i + 1]) for i in range(3)]
    np.testing.assert_array_equal(together.recall, [one.recall[0] for one in alone])
    np.testing.assert_array_equal(together.precision, [one.precision[0] for one in alone])
    assert together.recall.tolist()[::2] == [0.5, 0.5]
    assert [values.tolist() for values in thin_scores(blank(0), blank(0))] == [[], []]


def test_names_what_it_refuses():
    with pytest.raises(ValueError, match=r"pictures \[2, 128, 128, 3\] of truths \[1, 128"):
        thin_scores(blank(1), blank(2))
    with pytest.raises(ValueError, match=r"uint8 \[N, H, W, C\], got uint8 \[128, 128, 3\]"):
        thin_scores(blank(1)[0], blank(1)[0])
    # In 0..1 all would be dark, and NaN would pass for white.
    for values in (blank(1) / 255, np.full((1, 128, 128, 3), np.nan), blank(1).astype(np.int64)):
        for arguments in ((values, values), (painted(LEG)[None], values)):
            with pytest.raises(ValueError, match=rf"uint8 \[N, H, W, C\], got {values.dtype}"):
                thin_scores(*arguments)
        for function in (foreground, contrast, object_boxes, evaluated):
            with pytest.raises(ValueError, match=rf"must be uint8.*got {values.dtype}"):
                function(values)
    with pytest.raises(ValueError, match=r"be \[N, H, W, C\], got uint8 \[128, 128, 3\]"):
        object_boxes(blank(1)[0])


# --- boxes ----------------------------------------------------------------------------------------


def test_boxes():
    far = painted(box(10, 12, 100, 101), box(50, 60, 5, 20), color=(254, 255, 255))
    boxes = object_boxes(np.stack([far, blank(1)[0], painted(np.ones((128, 128), bool))]))
    assert boxes.tolist() == [[10, 60, 5, 101], [0, 0, 0, 0], [0, 128, 0, 128]]
    assert object_boxes(blank(0)).shape == (0, 4)
